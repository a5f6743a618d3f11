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

ElasticSheet::ElasticSheet(const Positions& rest, const Triangles& triangles, Progress& progress,
                           double scale)
    : rest_(&rest),
      triangles_(&triangles),
      scale_(scale),
      kept_(to_size(triangles.rows())),
      corners_(to_index(rest.rows()), [&](auto&& take) {
          for (Index c = 0; c < triangles.size(); ++c) take(triangles(c / 3, c % 3), c);
      }) {
    // What works with it has the time.
    const Progress::Part part(progress, 0.0, 0.0);
    parallel_for(to_index(triangles.rows()), progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            Triangle& t = kept_[to_size(f)];
            t.metric << 1.0f, 0.0f, 1.0f;
            const Corners p = places(rest, f);
            for (int k = 0; k < 3; ++k) {
                const int next = (k + 1) % 3, across = (k + 2) % 3;
                t.weights[k] = static_cast<float>(
                    half_cotangent(p.col(k) - p.col(across), p.col(next) - p.col(across)));
            }
        }
    });
    find_laplacian(progress);
}

void ElasticSheet::find_laplacian(Progress& progress) {
    struct Side {
        Index to, triangle;
        double weight;
    };
    const auto count = to_index(rest_->rows());
    /// Both sides of each corner at a vertex; of both ends of an edge in the same order.
    const auto find_sides = [&](Index v, std::vector<Side>& sides) {
        sides.clear();
        for (const Index c : around(v)) {
            const Index f = c / 3, k = c % 3;
            const auto& weights = kept_[to_size(f)].weights;
            sides.push_back({(*triangles_)(f, (k + 1) % 3), f, weights[k]});
            sides.push_back({(*triangles_)(f, (k + 2) % 3), f, weights[(k + 2) % 3]});
        }
        std::ranges::sort(sides, {}, [](const Side& s) { return std::pair(s.to, s.triangle); });
    };
    const auto is_new = [](const std::vector<Side>& sides, std::size_t i) {
        return i == 0 || sides[i].to != sides[i - 1].to;
    };
    laplacian_.offsets.assign(to_size(count) + 1, 0);
    laplacian_.sums.assign(to_size(count), 0.0);
    parallel_for(count, progress, [&](Index begin, Index end) {
        std::vector<Side> sides;
        for (Index v = begin; v < end; ++v) {
            find_sides(v, sides);
            for (std::size_t i = 0; i < sides.size(); ++i) {
                laplacian_.offsets[to_size(v) + 1] += is_new(sides, i);
                laplacian_.sums[to_size(v)] += sides[i].weight;
            }
        }
    });
    for (std::size_t v = 1; v < laplacian_.offsets.size(); ++v)
        laplacian_.offsets[v] += laplacian_.offsets[v - 1];
    laplacian_.neighbors.resize(to_size(laplacian_.offsets.back()));
    laplacian_.weights.resize(laplacian_.neighbors.size());
    parallel_for(count, progress, [&](Index begin, Index end) {
        std::vector<Side> sides;
        for (Index v = begin; v < end; ++v) {
            find_sides(v, sides);
            std::size_t at = to_size(laplacian_.offsets[to_size(v)]);
            for (std::size_t i = 0; i < sides.size(); ++i) {
                if (is_new(sides, i)) {
                    laplacian_.neighbors[at] = sides[i].to;
                    laplacian_.weights[at++] = sides[i].weight;
                } else {
                    laplacian_.weights[at - 1] += sides[i].weight;
                }
            }
        }
    });
}

ElasticSheet::Rest ElasticSheet::at_rest(Index f) const {
    const Corners p = places(*rest_, f);
    const Vector3 u = scale_ * (p.col(1) - p.col(0)), v = scale_ * (p.col(2) - p.col(0));
    Rest rest;
    rest.frame << u.normalized().transpose(), u.cross(v).cross(u).normalized().transpose();
    rest.sides << rest.frame * u, rest.frame * v;
    return rest;
}

Matrix2 ElasticSheet::stretch(Index f) const {
    const auto& m = kept_[to_size(f)].metric;
    Matrix2 result;
    result << m[0], m[1], m[1], m[2];
    return result;
}

ElasticSheet::Corners ElasticSheet::places(const Positions& x, Index f) const {
    Corners corners;
    for (Index k = 0; k < 3; ++k) corners.col(k) = x.row((*triangles_)(f, k)).transpose();
    return corners;
}

Normals ElasticSheet::normals(const Positions& x, Progress& progress) const {
    Normals result(x.rows(), 3);
    const auto sum_around = [&](const Positions& places_now, Index v) {
        Vector3 sum = Vector3::Zero();
        for (const Index c : around(v)) {
            const Corners p = places(places_now, c / 3);
            sum += (p.col(1) - p.col(0)).cross(p.col(2) - p.col(0));
        }
        return sum;
    };
    parallel_for(to_index(x.rows()), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            Vector3 sum = sum_around(x, v);
            if (!(sum.norm() > 0.0)) sum = sum_around(*rest_, v);
            const double length = sum.norm();
            result.row(v) =
                (length > 0.0 ? Vector3(sum / length) : Vector3(Vector3::UnitZ())).transpose();
        }
    });
    return result;
}

/// Of each triangle, instead of its metric: the logarithm of JᵀJ.
void ElasticSheet::set_log_stretch(const Positions& x, Progress& progress) {
    const double most = 2.0 * std::log(kLargestStretch);
    parallel_for(to_index(kept_.size()), progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            const Corners p = places(x, f);
            Eigen::Matrix<double, 3, 2> sides;
            sides << p.col(1) - p.col(0), p.col(2) - p.col(0);
            const Eigen::Matrix<double, 3, 2> jacobian = sides * at_rest(f).sides.inverse();
            const Matrix2 log =
                of_eigenvalues(Matrix2(jacobian.transpose() * jacobian), [&](double value) {
                    return std::clamp(std::log(std::max(value, 1e-30)), -most, most);
                });
            kept_[to_size(f)].metric =
                Eigen::Vector3d(log(0, 0), log(0, 1), log(1, 1)).cast<float>();
        }
    });
}

/// Of the vertices: as tensors in space, isotropic parts across the surface as well, so that they
/// keep to it where it bends.
std::vector<ElasticSheet::Tensor> ElasticSheet::smoothed_log(int sweeps, Progress& progress) const {
    const auto count = to_index(rest_->rows());
    std::vector<Tensor> now(to_size(count), Tensor::Zero());
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            Matrix3 sum = Matrix3::Zero();
            double areas = 0.0;
            for (const Index c : around(v)) {
                const Rest rest = at_rest(c / 3);
                const Matrix2 log = stretch(c / 3);
                const Vector3 normal = rest.frame.row(0).cross(rest.frame.row(1)).transpose();
                const double area = std::abs(rest.sides.determinant());
                sum += area * (rest.frame.transpose() * log * rest.frame +
                               0.5 * log.trace() * normal * normal.transpose());
                areas += area;
            }
            if (!(areas > 0.0)) continue;
            sum /= areas;
            Eigen::Matrix<double, 6, 1> upper;
            upper << sum(0, 0), sum(0, 1), sum(0, 2), sum(1, 1), sum(1, 2), sum(2, 2);
            now[to_size(v)] = upper.cast<float>();
        }
    });
    std::vector<Tensor> next(now.size());
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        parallel_for(count, progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                Tensor sum = Tensor::Zero();
                const Index first = laplacian_.offsets[to_size(v)];
                const Index last = laplacian_.offsets[to_size(v) + 1];
                for (Index k = first; k < last; ++k)
                    sum += now[to_size(laplacian_.neighbors[to_size(k)])];
                const auto share = 0.5f / static_cast<float>(std::max<Index>(last - first, 1));
                next[to_size(v)] =
                    last > first ? Tensor(0.5f * now[to_size(v)] + share * sum) : now[to_size(v)];
            }
        });
        now.swap(next);
    }
    return now;
}

void ElasticSheet::set_metric(const Positions& x, int sweeps, Progress& progress) {
    set_log_stretch(x, progress);
    const std::vector<Tensor> logs = smoothed_log(sweeps, progress);
    parallel_for(to_index(kept_.size()), progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            Eigen::Matrix<double, 6, 1> mean = Eigen::Matrix<double, 6, 1>::Zero();
            for (Index k = 0; k < 3; ++k)
                mean += logs[to_size((*triangles_)(f, k))].cast<double>() / 3.0;
            Matrix3 tensor;
            tensor << mean[0], mean[1], mean[2], mean[1], mean[3], mean[4], mean[2], mean[4],
                mean[5];
            const auto frame = at_rest(f).frame;
            const Matrix2 stretch =
                of_eigenvalues(Matrix2(frame * tensor * frame.transpose()),
                               [](double value) { return std::exp(0.5 * value); });
            kept_[to_size(f)].metric =
                Eigen::Vector3d(stretch(0, 0), stretch(0, 1), stretch(1, 1)).cast<float>();
        }
    });
}

double ElasticSheet::area_ratio(Index triangle) const {
    return stretch(triangle).determinant();
}

void ElasticSheet::turn_vertices(const Positions& x, Progress& progress) {
    const auto faces = to_index(kept_.size());
    std::vector<Matrix3> of_faces(to_size(faces));
    parallel_for(faces, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) {
            const Triangle& t = kept_[to_size(f)];
            const Corners p = places(x, f);
            Corners q = Corners::Zero();
            const Rest rest = at_rest(f);
            q.rightCols<2>() = rest.frame.transpose() * (stretch(f) * rest.sides);
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
    parallel_for(to_index(x.rows()), progress, [&](Index begin, Index end) {
        for (Index v = begin; v < end; ++v) {
            Matrix3 cross = Matrix3::Zero();
            for (const Index c : around(v)) cross += of_faces[to_size(c / 3)];
            turns_[to_size(v)] = have_turned ? rotation_near(cross, turns_[to_size(v)])
                                             : best_rotation(cross).rotation;
        }
    });
}

/// The triangle that it would be, in the plane across `normal`, turned there to where it is.
ElasticSheet::Corners ElasticSheet::in_plane(const Corners& now, Index f,
                                             const Vector3& normal) const {
    const Triangle& t = kept_[to_size(f)];
    const Vector3 first = normal.unitOrthogonal(), second = normal.cross(first);
    Eigen::Matrix<double, 2, 3> flat = Eigen::Matrix<double, 2, 3>::Zero();
    flat.rightCols<2>() = metric_sides(f);
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
        Corners corners = Corners::Zero();
        if (flat < 1.0) {
            Matrix3 turn = Matrix3::Zero();
            for (Index k = 0; k < 3; ++k) turn += turns_[to_size((*triangles_)(f, k))] / 3.0;
            const Rest rest = at_rest(f);
            corners.rightCols<2>() = turn * rest.frame.transpose() * (stretch(f) * rest.sides);
        }
        if (flat > 0.0) {
            Vector3 normal = Vector3::Zero();
            for (Index k = 0; k < 3; ++k) normal += normals.row((*triangles_)(f, k)).transpose();
            const double length = normal.norm();
            constexpr double kCancelled = 1e-6;
            const Corners now = places(x, f);
            corners = (1.0 - flat) * corners +
                      flat * (length > kCancelled ? in_plane(now, f, normal / length) : now);
        }
        return corners;
    };
    return forces_toward<float>(would, progress);
}

}  // namespace pointmorph
