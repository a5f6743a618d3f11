#include "mesh/elastic_sheet.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

/// Half of the cotangents between these; thin triangles would be stiff, or pull apart.
constexpr double kLeastCotangent = 0.05, kLargestCotangent = 3.0;
/// The metric stretches by no more.
constexpr double kLargestStretch = 8.0;

double half_cotangent(const Vector3& u, const Vector3& v) {
    const double sine = u.cross(v).norm();
    const double cotangent = sine > 0.0 ? u.dot(v) / sine : kLargestCotangent;
    return 0.5 * std::clamp(cotangent, kLeastCotangent, kLargestCotangent);
}

/// f of the eigenvalues of a symmetric matrix.
template <class Function>
Matrix2 of_eigenvalues(const Matrix2& m, Function&& function) {
    const double mean = 0.5 * (m(0, 0) + m(1, 1)), half = 0.5 * (m(0, 0) - m(1, 1));
    const double radius = Eigen::Vector2d(half, m(0, 1)).norm();
    const double high = function(mean + radius), low = function(mean - radius);
    if (!(radius > 0.0)) return high * Matrix2::Identity();
    const Matrix2 deviation = (m - mean * Matrix2::Identity()) / radius;
    return 0.5 * (high + low) * Matrix2::Identity() + 0.5 * (high - low) * deviation;
}

/// The rotation nearest to `linear`, from a rotation near it (Müller et al., A Robust Method to
/// Extract the Rotational Part of Deformations, 2016).
Matrix3 rotation_near(const Matrix3& linear, Matrix3 rotation) {
    constexpr int kMost = 8;
    constexpr double kEnough = 1e-6, kTiny = 1e-12;
    for (int i = 0; i < kMost; ++i) {
        Vector3 turn = Vector3::Zero();
        double scale = 0.0;
        for (int c = 0; c < 3; ++c) {
            turn += rotation.col(c).cross(linear.col(c));
            scale += rotation.col(c).dot(linear.col(c));
        }
        turn /= std::abs(scale) + kTiny * linear.norm() + std::numeric_limits<double>::min();
        const double angle = turn.norm();
        if (angle < kEnough) break;
        rotation = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix() * rotation;
    }
    return rotation;
}

}  // namespace

ElasticSheet::ElasticSheet(const Positions& rest, const Triangles& triangles)
    : triangles_(&triangles),
      rest_(to_size(triangles.rows())),
      areas_(Values::Zero(rest.rows())),
      offsets_(to_size(rest.rows()) + 1, 0),
      corners_(to_size(triangles.size())) {
    const auto count = static_cast<Index>(rest.rows());
    std::vector<std::array<Index, 2>> ends;
    std::vector<double> weights;
    for (Index f = 0; f < triangles.rows(); ++f) {
        Triangle& t = rest_[to_size(f)];
        const Corners p = places(rest, f);
        const Vector3 u = p.col(1) - p.col(0), v = p.col(2) - p.col(0);
        const Vector3 first = u.normalized();
        const Vector3 second = u.cross(v).cross(u).normalized();
        t.frame << first.transpose(), second.transpose();
        t.sides << t.frame * u, t.frame * v;
        t.metric_sides = t.sides;
        for (int k = 0; k < 3; ++k) {
            const int next = (k + 1) % 3, across = (k + 2) % 3;
            t.weights[k] = half_cotangent(p.col(k) - p.col(across), p.col(next) - p.col(across));
            ends.push_back({triangles(f, k), triangles(f, next)});
            ends.push_back({triangles(f, next), triangles(f, k)});
            weights.insert(weights.end(), 2, t.weights[k]);
            areas_[triangles(f, k)] += u.cross(v).norm() / 6.0;
            ++offsets_[to_size(triangles(f, k)) + 1];
        }
    }
    for (std::size_t v = 1; v < offsets_.size(); ++v) offsets_[v] += offsets_[v - 1];
    std::vector<Index> next(offsets_.begin(), offsets_.end() - 1);
    for (Index c = 0; c < triangles.size(); ++c)
        corners_[to_size(next[to_size(triangles(c / 3, c % 3))]++)] = c;

    // By the end they start from, then each few by the other one.
    std::vector<Index> firsts(to_size(count) + 1, 0);
    for (const auto& [from, to] : ends) ++firsts[to_size(from) + 1];
    for (std::size_t v = 1; v < firsts.size(); ++v) firsts[v] += firsts[v - 1];
    std::vector<Index> order(ends.size());
    std::vector<Index> free(firsts.begin(), firsts.end() - 1);
    for (std::size_t e = 0; e < ends.size(); ++e)
        order[to_size(free[to_size(ends[e][0])]++)] = static_cast<Index>(e);
    laplacian_.sums.assign(to_size(count), 0.0);
    for (Index v = 0; v < count; ++v) {
        const auto first = order.begin() + firsts[to_size(v)];
        const auto last = order.begin() + firsts[to_size(v) + 1];
        std::sort(first, last, [&](Index e, Index g) {
            return std::pair(ends[to_size(e)][1], e) < std::pair(ends[to_size(g)][1], g);
        });
        for (auto at = first; at != last; ++at) {
            const Index to = ends[to_size(*at)][1];
            const double weight = weights[to_size(*at)];
            if (at != first && ends[to_size(*(at - 1))][1] == to) {
                laplacian_.weights.back() += weight;
            } else {
                laplacian_.neighbors.push_back(to);
                laplacian_.weights.push_back(weight);
            }
            laplacian_.sums[to_size(v)] += weight;
        }
        laplacian_.offsets.push_back(static_cast<Index>(laplacian_.neighbors.size()));
    }
    rest_normals_ = Normals::Zero(count, 3);
    rest_normals_.col(2).setOnes();
    Progress silent;
    rest_normals_ = normals(rest, silent);
}

ElasticSheet::Corners ElasticSheet::places(const Positions& x, Index f) const {
    Corners corners;
    for (Index k = 0; k < 3; ++k) corners.col(k) = x.row((*triangles_)(f, k)).transpose();
    return corners;
}

Normals ElasticSheet::normals(const Positions& x, Progress& progress) const {
    Normals result(x.rows(), 3);
    parallel_for(static_cast<Index>(x.rows()), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            Vector3 sum = Vector3::Zero();
            for (const Index c : around(v)) {
                const Corners p = places(x, c / 3);
                sum += (p.col(1) - p.col(0)).cross(p.col(2) - p.col(0));
            }
            const double length = sum.norm();
            if (length > 0.0)
                result.row(v) = (sum / length).transpose();
            else
                result.row(v) = rest_normals_.row(v);
        }
    });
    return result;
}

void ElasticSheet::set_metric(const Positions& x, int sweeps, Progress& progress) {
    // Logarithms of JᵀJ as tensors in space, isotropic parts across the surface as well, so that
    // they keep to it where it bends.
    const auto faces = static_cast<Index>(rest_.size());
    const auto count = static_cast<Index>(x.rows());
    std::vector<Matrix3> now(to_size(count), Matrix3::Zero());
    const double most = 2.0 * std::log(kLargestStretch);
    parallel_for(faces, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            Triangle& t = rest_[to_size(f)];
            const Corners p = places(x, f);
            Eigen::Matrix<double, 3, 2> sides;
            sides << p.col(1) - p.col(0), p.col(2) - p.col(0);
            const Eigen::Matrix<double, 3, 2> jacobian = sides * t.sides.inverse();
            // Kept there until the metric is known.
            t.metric_sides =
                of_eigenvalues(Matrix2(jacobian.transpose() * jacobian), [&](double value) {
                    return std::clamp(std::log(std::max(value, 1e-30)), -most, most);
                });
        }
    });
    const auto in_space = [&](Index f) -> Matrix3 {
        const Triangle& t = rest_[to_size(f)];
        const Vector3 normal = t.frame.row(0).cross(t.frame.row(1)).transpose();
        return t.frame.transpose() * t.metric_sides * t.frame +
               0.5 * t.metric_sides.trace() * normal * normal.transpose();
    };
    const auto face_area = [&](Index f) { return std::abs(rest_[to_size(f)].sides.determinant()); };
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            double sum = 0.0;
            for (const Index c : around(v)) {
                now[to_size(v)] += face_area(c / 3) * in_space(c / 3);
                sum += face_area(c / 3);
            }
            if (sum > 0.0) now[to_size(v)] /= sum;
        }
    });
    std::vector<Matrix3> next(now.size());
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        parallel_for(count, progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                Matrix3 sum = Matrix3::Zero();
                const Index first = laplacian_.offsets[to_size(v)];
                const Index last = laplacian_.offsets[to_size(v) + 1];
                for (Index k = first; k < last; ++k)
                    sum += now[to_size(laplacian_.neighbors[to_size(k)])];
                next[to_size(v)] = last > first
                                       ? Matrix3(0.5 * now[to_size(v)] + 0.5 / (last - first) * sum)
                                       : now[to_size(v)];
            }
        });
        now.swap(next);
    }
    parallel_for(faces, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            Triangle& t = rest_[to_size(f)];
            Matrix3 mean = Matrix3::Zero();
            for (Index k = 0; k < 3; ++k) mean += now[to_size((*triangles_)(f, k))] / 3.0;
            const Matrix2 log = t.frame * mean * t.frame.transpose();
            t.metric_sides =
                of_eigenvalues(log, [](double value) { return std::exp(0.5 * value); }) * t.sides;
        }
    });
}

double ElasticSheet::area_ratio(Index triangle) const {
    const Triangle& t = rest_[to_size(triangle)];
    return t.metric_sides.determinant() / t.sides.determinant();
}

void ElasticSheet::turn_vertices(const Positions& x, Progress& progress) {
    const auto faces = static_cast<Index>(rest_.size());
    std::vector<Matrix3> of_faces(to_size(faces));
    parallel_for(faces, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            const Triangle& t = rest_[to_size(f)];
            const Corners p = places(x, f);
            Corners q = Corners::Zero();
            q.rightCols<2>() = t.frame.transpose() * t.metric_sides;
            Matrix3 cross = Matrix3::Zero();
            for (int k = 0; k < 3; ++k) {
                const int next = (k + 1) % 3;
                cross +=
                    t.weights[k] * (p.col(next) - p.col(k)) * (q.col(next) - q.col(k)).transpose();
            }
            of_faces[to_size(f)] = cross;
        }
    });
    const bool have_turned = !turns_.empty();
    turns_.resize(to_size(x.rows()), Matrix3::Identity());
    parallel_for(static_cast<Index>(x.rows()), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            Matrix3 cross = Matrix3::Zero();
            for (const Index c : around(v)) cross += of_faces[to_size(c / 3)];
            turns_[to_size(v)] = have_turned ? rotation_near(cross, turns_[to_size(v)])
                                             : best_rotation(cross).rotation;
        }
    });
}

/// The triangle that it would be, in the plane across `normal`, turned there to where it is.
ElasticSheet::Corners ElasticSheet::in_plane(const Corners& now, const Triangle& t,
                                             const Vector3& normal) const {
    const Vector3 first = normal.unitOrthogonal(), second = normal.cross(first);
    Eigen::Matrix<double, 2, 3> flat = Eigen::Matrix<double, 2, 3>::Zero();
    flat.rightCols<2>() = t.metric_sides;
    double along = 0.0, across = 0.0;
    for (int k = 0; k < 3; ++k) {
        const int next = (k + 1) % 3;
        const Vector3 side = now.col(next) - now.col(k);
        const Eigen::Vector2d is(first.dot(side), second.dot(side));
        const Eigen::Vector2d would = flat.col(next) - flat.col(k);
        along += t.weights[k] * would.dot(is);
        across += t.weights[k] * (would[0] * is[1] - would[1] * is[0]);
    }
    const double length = Eigen::Vector2d(along, across).norm();
    const double cosine = length > 0.0 ? along / length : 1.0;
    const double sine = length > 0.0 ? across / length : 0.0;
    Eigen::Matrix<double, 3, 2> axes;
    axes << cosine * first + sine * second, cosine * second - sine * first;
    return axes * flat;
}

Positions ElasticSheet::forces(const Positions& x, const Normals& normals, double flat,
                               Progress& progress) {
    if (flat < 1.0) turn_vertices(x, progress);
    const auto would = [&](Index f) {
        const Triangle& t = rest_[to_size(f)];
        Corners corners = Corners::Zero();
        if (flat < 1.0) {
            Matrix3 turn = Matrix3::Zero();
            for (Index k = 0; k < 3; ++k) turn += turns_[to_size((*triangles_)(f, k))] / 3.0;
            corners.rightCols<2>() = turn * t.frame.transpose() * t.metric_sides;
        }
        if (flat > 0.0) {
            Vector3 normal = Vector3::Zero();
            for (Index k = 0; k < 3; ++k) normal += normals.row((*triangles_)(f, k)).transpose();
            const double length = normal.norm();
            constexpr double kCancelled = 1e-6;
            const Corners now = places(x, f);
            corners = (1.0 - flat) * corners +
                      flat * (length > kCancelled ? in_plane(now, t, normal / length) : now);
        }
        return corners;
    };
    return forces_towards(would, progress);
}

}  // namespace pointmorph
