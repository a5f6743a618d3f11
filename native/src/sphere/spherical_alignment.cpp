#include "pointmorph/sphere/spherical_alignment.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"
#include "sphere/sphere_descent.hpp"
#include "sphere/sphere_embedding.hpp"

namespace pointmorph {

namespace {

Vector3 row_of(const Positions& rows, Index i) {
    return rows.row(i).transpose();
}

double area_of(const SphericalMesh& mesh) {
    double sum = 0.0;
    for (const auto& [a, b, c] : mesh.triangles) {
        const Eigen::RowVector3d ab = mesh.positions.row(b) - mesh.positions.row(a),
                                 ac = mesh.positions.row(c) - mesh.positions.row(a);
        sum += 0.5 * ab.cross(ac).norm();
    }
    return sum;
}

/// How much the map from the source through the sphere onto the target stretches: the mean of
/// tr JᵀJ / D, which is 2 where angles are kept, and `area_weight` times D + 1/D, which is 2 where
/// areas are; J, with D = det J, between triangles of the source and the triangles between where
/// their corners go (after Schmidt et al. 2019).
class Stretch {
public:
    Stretch(const SphericalMesh& source, const SphericalMesh& target, double area_weight)
        : source_(source),
          target_(target),
          locator_(target.triangles, target.images),
          hints_(to_size(source.size())),
          round_(source.triangles, kRound / (4.0 * std::numbers::pi)),
          images_(source.size(), 3),
          by_image_(source.size(), 3),
          triangle_images_(source.triangles.size()),
          on_target_(target.triangles.size()),
          area_weight_(area_weight),
          target_scale_(1.0 / std::sqrt(area_of(target))) {
        const double scale = 1.0 / std::sqrt(area_of(source));
        for (const auto& [a, b, c] : source.triangles) {
            constexpr double kWorst = 0.3;  // shape of triangles that count as they are
            const Vector3 x = scale * row_of(source.positions, a),
                          y = scale * row_of(source.positions, b),
                          z = scale * row_of(source.positions, c);
            const double area = 0.5 * (y - x).cross(z - x).norm();
            Vector3 squared((z - y).squaredNorm(), (x - z).squaredNorm(), (y - x).squaredNorm());
            const double shape = 4.0 * std::numbers::sqrt3 * area / squared.sum();
            Rest rest;
            rest.area = std::max(area, 1e-3 / static_cast<double>(source.triangles.size()));
            // Half the cotangents; slivers count as equilateral to some part.
            const double real = std::min(1.0, shape / kWorst);
            for (int k = 0; k < 3; ++k) {
                const double cotangent = (squared.sum() - 2.0 * squared[k]) / (4.0 * rest.area);
                rest.weights[k] = 0.5 * (real * cotangent + (1.0 - real) * std::numbers::inv_sqrt3);
            }
            rests_.push_back(rest);
        }
        for (std::size_t t = 0; t < on_target_.size(); ++t) {
            const auto& [a, b, c] = target.triangles[t];
            on_target_[t].corners << row_of(target.positions, a), row_of(target.positions, b),
                row_of(target.positions, c);
        }
    }

    /// Has to be called before all else, and again when the target's places have moved.
    void look_at_target() {
        locator_.move_to(target_.images);
        std::ranges::fill(hints_, 0);
        for (std::size_t t = 0; t < on_target_.size(); ++t) {
            const auto& [a, b, c] = target_.triangles[t];
            OnTarget& under = on_target_[t];
            Matrix3 on_sphere;
            on_sphere << row_of(target_.images, a), row_of(target_.images, b),
                row_of(target_.images, c);
            under.inverse = on_sphere.inverse();
            under.slope = target_scale_ * under.corners * under.inverse;
            under.sums = under.inverse.colwise().sum();
        }
    }

    double at(const Positions& places) {
        const double round = round_.at(places);
        if (round == kInfinity) return kInfinity;
        for (Index v = 0; v < source_.size(); ++v) {
            const auto [triangle, shares] = locator_.find(row_of(places, v), hints_[to_size(v)]);
            hints_[to_size(v)] = triangle;
            images_.row(v) =
                (target_scale_ * (on_target_[to_size(triangle)].corners * shares)).transpose();
        }
        constexpr double kFloor = 1e-3;  // of D
        double sum = 0.0;
        for (std::size_t t = 0; t < rests_.size(); ++t) {
            const auto& [a, b, c] = source_.triangles[t];
            const Rest& rest = rests_[t];
            const Vector3 p = row_of(images_, a), q = row_of(images_, b), r = row_of(images_, c);
            Image& image = triangle_images_[t];
            image.across = (q - p).cross(r - p);
            image.norm = image.across.norm();
            image.dirichlet = rest.weights[0] * (r - q).squaredNorm() +
                              rest.weights[1] * (p - r).squaredNorm() +
                              rest.weights[2] * (q - p).squaredNorm();
            image.d = 0.5 * image.norm / rest.area + kFloor;
            image.by_d = 1.0 / image.d;
            sum += area_weight_ * rest.area * (image.d + image.by_d);
            sum += image.dirichlet * image.by_d;
        }
        return sum + round;
    }

    /// At the places of the last at().
    void add_gradient(const Positions& places, Positions& gradient) {
        round_.add_gradient(places, gradient);
        by_image_.setZero();
        for (std::size_t t = 0; t < rests_.size(); ++t) {
            const auto& [a, b, c] = source_.triangles[t];
            const Rest& rest = rests_[t];
            const Image& image = triangle_images_[t];
            const Vector3 p = row_of(images_, a), q = row_of(images_, b), r = row_of(images_, c);
            const Vector3 facing =
                image.norm > 0.0 ? Vector3(image.across / image.norm) : Vector3::Zero();
            const double d = image.d, g = image.by_d;
            const double by_d =
                -image.dirichlet / (d * d * rest.area) + area_weight_ * (1.0 - 1.0 / (d * d));
            by_image_.row(a) += (2.0 * g * (rest.weights[1] * (p - r) + rest.weights[2] * (p - q)) +
                                 by_d * 0.5 * facing.cross(r - q))
                                    .transpose();
            by_image_.row(b) += (2.0 * g * (rest.weights[2] * (q - p) + rest.weights[0] * (q - r)) +
                                 by_d * 0.5 * facing.cross(p - r))
                                    .transpose();
            by_image_.row(c) += (2.0 * g * (rest.weights[0] * (r - q) + rest.weights[1] * (r - p)) +
                                 by_d * 0.5 * facing.cross(q - p))
                                    .transpose();
        }
        for (Index v = 0; v < source_.size(); ++v) {
            const Vector3 place = row_of(places, v), image = row_of(images_, v);
            const OnTarget& under = on_target_[to_size(hints_[to_size(v)])];
            const Matrix3 slope =
                (under.slope - image * under.sums) / Vector3(under.inverse * place).sum();
            gradient.row(v) += by_image_.row(v) * slope;
        }
    }

    /// How stiff the edges across from each triangle's corners are at present: about the energy's
    /// second derivative (after Rabinovich et al. 2017).
    std::vector<Vector3> stiffness(const Positions& places) {
        Positions images(places.rows(), 3);
        for (Index v = 0; v < to_index(places.rows()); ++v) {
            const auto [triangle, shares] = locator_.find(row_of(places, v), hints_[to_size(v)]);
            images.row(v).setZero();
            for (Index k = 0; k < 3; ++k)
                images.row(v) +=
                    target_scale_ * shares[k] *
                    target_.positions.row(target_.triangles[to_size(triangle)][to_size(k)]);
        }
        std::vector<Vector3> result;
        for (std::size_t t = 0; t < rests_.size(); ++t) {
            const auto& [a, b, c] = source_.triangles[t];
            const Eigen::RowVector3d ab = images.row(b) - images.row(a),
                                     ac = images.row(c) - images.row(a);
            const double shrunk =
                1.0 / std::sqrt(std::max(0.5 * ab.cross(ac).norm() / rests_[t].area, 0.01));
            result.push_back((1.0 + shrunk * (1.0 + shrunk * (1.0 + shrunk))) * rests_[t].weights);
        }
        return result;
    }

    /// How much longer ways are on the target than on the sphere, at each source vertex.
    Values scales(const Positions& places) {
        Values result(places.rows());
        for (Index v = 0; v < to_index(places.rows()); ++v) {
            const auto [triangle, shares] = locator_.find(row_of(places, v), hints_[to_size(v)]);
            const auto& [a, b, c] = target_.triangles[to_size(triangle)];
            const auto area = [&](const Positions& p) {
                return Eigen::RowVector3d(p.row(b) - p.row(a)).cross(p.row(c) - p.row(a)).norm();
            };
            result[v] = target_scale_ *
                        std::sqrt(area(target_.positions) / std::max(area(target_.images), 1e-12));
        }
        return result;
    }

private:
    static constexpr double kRound = 1e-3;  // keeps triangles on the sphere from turning over
    struct Rest {
        double area;
        Vector3 weights;  ///< of the edges across from the corners
    };
    /// A triangle of the target: how places on the sphere go onto it.
    struct OnTarget {
        Matrix3 corners;  ///< on the target, as columns
        Matrix3 inverse;  ///< of the matrix of the corners on the sphere
        Matrix3 slope;    ///< of the scaled place, but for the projection
        Eigen::RowVector3d sums;
    };
    /// What a triangle of the source becomes.
    struct Image {
        Vector3 across;  ///< twice the area, along the normal
        double norm;     ///< of that
        double dirichlet, d, by_d;
    };
    const SphericalMesh& source_;
    const SphericalMesh& target_;
    SphereLocator locator_;
    std::vector<Index> hints_;  ///< triangle of the target in which each vertex lies
    Roundness round_;
    Positions images_;    ///< of vertices, on the scaled target
    Positions by_image_;  ///< of the energy
    std::vector<Image> triangle_images_;
    std::vector<OnTarget> on_target_;
    std::vector<Rest> rests_;
    double area_weight_;
    double target_scale_;
};

std::vector<Index> side_of(std::span<const IndexPair> features, Index IndexPair::*side) {
    std::vector<Index> result;
    for (const IndexPair& f : features) result.push_back(f.*side);
    return result;
}

/// The source rotated so that features come near each other.
void rotate_to_features(SphericalMesh& source, const SphericalMesh& target,
                        std::span<const IndexPair> features) {
    Matrix3 covariance = Matrix3::Zero();
    for (const auto& [s, t] : features)
        covariance += row_of(target.images, t) * row_of(source.images, s).transpose();
    source.images = source.images * best_rotation(covariance).rotation.transpose();
}

/// Unmarked extremities that belong together: by where they lie on the sphere, too.
std::vector<IndexPair> paired_extremities(const SphericalMesh& source, const SphericalMesh& target,
                                          std::span<const IndexPair> features, Index most,
                                          Progress& progress) {
    constexpr double kLargest = 0.5;
    if (features.empty() || most == 0) return {};
    UnmarkedExtremities on_source, on_target;
    on_both(progress, [&](bool is_source, Progress& its) {
        const SurfaceGraph& graph = (is_source ? source : target).graph;
        const auto side = is_source ? &IndexPair::source : &IndexPair::target;
        const Eigen::MatrixXd from = distances_from(graph, 1.0, side_of(features, side));
        (is_source ? on_source : on_target) =
            unmarked_extremities(graph, 1.0, from, {.most = most}, its);
    });
    return paired_extremities(on_source, on_target, kLargest, [&](Index s, Index t) {
        return (source.images.row(s) - target.images.row(t)).norm();
    });
}

/// The k-th of `count` nodes that lie all over the surface: nodes stand in spatial order.
Index spread_node(const SphericalMesh& mesh, Index k, Index count) {
    return to_index(std::int64_t{k} * mesh.size() / count);
}

/// Mean distance along the surface from every node to the whole of it, in √area.
Values remoteness(const SphericalMesh& mesh, Progress& progress) {
    constexpr Index kSamples = 60;
    GeodesicSearch search(mesh.graph);
    Values sum = Values::Zero(mesh.size());
    const Index samples = std::min(kSamples, mesh.size());
    for (Index k = 0; k < samples; ++k) {
        const Index from = spread_node(mesh, k, samples);
        for (const auto& [i, distance] : search.reached(from)) sum[i] += distance;
        progress.throw_if_cancelled();
    }
    return sum / samples;
}

/// Evenly spread rotations (super-Fibonacci spirals, Alexa 2022).
Matrix3 spread_rotation(Index k, Index count) {
    constexpr double kPhi = std::numbers::sqrt2, kPsi = 1.533751168755204288118041;
    const double s = k + 0.5, t = s / count, d = 2.0 * std::numbers::pi * s;
    const double r = std::sqrt(t), rest = std::sqrt(1.0 - t);
    const double alpha = d / kPhi, beta = d / kPsi;
    return Eigen::Quaterniond(rest * std::cos(beta), r * std::sin(alpha), r * std::cos(alpha),
                              rest * std::sin(beta))
        .normalized()
        .toRotationMatrix();
}

/// Turns of the source under which both agree most in how remote places are, and in the features.
std::vector<Matrix3> likely_rotations(const SphericalMesh& source, const SphericalMesh& target,
                                      std::span<const IndexPair> features,
                                      const SphericalAlignmentOptions& options,
                                      Progress& progress) {
    constexpr Index kSamples = 200;
    constexpr double kFeatures = 10.0;  // weight of a feature's squared distance
    constexpr double kAlike = 2.5;  // trace from which on two rotations are one: some 40 degrees
    const Values s = remoteness(source, progress), t = remoteness(target, progress);
    const KdTree<3> tree(target.images);
    const Index samples = std::min(kSamples, source.size());
    std::vector<std::pair<double, Index>> costs(to_size(options.rotations));
    parallel_for(
        options.rotations, progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k) {
                const Matrix3 rotation = spread_rotation(k, options.rotations);
                double sum = 0.0;
                for (Index i = 0; i < samples; ++i) {
                    const Index v = spread_node(source, i, samples);
                    const Vector3 place = rotation * row_of(source.images, v);
                    Index nearest;
                    double squared;
                    tree.nearest(place.data(), {&nearest, 1}, {&squared, 1});
                    sum += (s[v] - t[nearest]) * (s[v] - t[nearest]);
                }
                for (const IndexPair& f : features)
                    sum += kFeatures * (rotation * row_of(source.images, f.source) -
                                        row_of(target.images, f.target))
                                           .squaredNorm();
                costs[to_size(k)] = {sum, k};
            }
        },
        0.0, 0.1, 16);
    std::ranges::sort(costs);
    std::vector<Matrix3> rotations;
    for (const auto& [cost, k] : costs) {
        if (to_index(rotations.size()) == options.finalists) break;
        const Matrix3 rotation = spread_rotation(k, options.rotations);
        if (std::ranges::none_of(rotations, [&](const Matrix3& other) {
                return (other.transpose() * rotation).trace() > kAlike;
            }))
            rotations.push_back(rotation);
    }
    return rotations;
}

/// Moves fixed vertices on their way to `goals`, everything with them, without a fold; then evens
/// out the others. Returns the largest distance left.
double approach(SphericalMesh& mesh, const Smoother& smooth, std::span<const Index> fixed,
                const Positions& goals, Progress& progress) {
    constexpr double kLongest = 0.3, kWorse = 3.0;
    constexpr int kHalvings = 12, kEven = 8;
    Positions moves = Positions::Zero(mesh.size(), 3);
    double farthest = 0.0;
    for (std::size_t k = 0; k < fixed.size(); ++k) {
        moves.row(fixed[k]) = goals.row(Index(k)) - mesh.images.row(fixed[k]);
        farthest = std::max(farthest, moves.row(fixed[k]).norm());
    }
    if (farthest == 0.0) return 0.0;
    const Positions all = smooth.extended(moves);
    const Roundness roundness(mesh.triangles, 1.0);
    const double before = roundness.at(mesh.images);
    double share = std::min(1.0, kLongest / farthest);
    for (int k = 0; k < kHalvings; ++k, share *= 0.5) {
        Positions there = (mesh.images + share * all).rowwise().normalized();
        if (share == 1.0)  // to the bit
            for (std::size_t i = 0; i < fixed.size(); ++i)
                there.row(fixed[i]) = goals.row(Index(i));
        if (!(roundness.at(there) < kWorse * before)) continue;
        mesh.images = std::move(there);
        farthest *= 1.0 - share;
        break;
    }
    descend(mesh.images, mesh.triangles, smooth, kEven, roundness, progress);
    return farthest;
}

/// Brings both together halfway. Returns how far apart the farthest are, 0 where all have met.
double meet(SphericalMesh& source, SphericalMesh& target, std::span<const IndexPair> pairs,
            Index most, Index& steps, Progress& progress) {
    const std::vector<Index> on_source = side_of(pairs, &IndexPair::source),
                             on_target = side_of(pairs, &IndexPair::target);
    std::array<std::optional<Smoother>, 2> smooth;
    parallel_invoke(2, [&](int k, bool) {
        const SphericalMesh& mesh = k == 0 ? source : target;
        smooth[to_size(k)].emplace(mesh.triangles, mesh.size(), k == 0 ? on_source : on_target);
    });
    double apart = kInfinity;
    for (Index step = 0; apart > 0.0 && step < most; ++step, ++steps) {
        Positions goals(static_cast<Eigen::Index>(pairs.size()), 3);
        for (std::size_t k = 0; k < pairs.size(); ++k) {
            const auto [s, t] = pairs[k];
            goals.row(Index(k)) = source.images.row(s);
            if (source.images.row(s) != target.images.row(t))
                goals.row(Index(k)) = (source.images.row(s) + target.images.row(t)).normalized();
        }
        std::array<double, 2> left;
        on_both(progress, [&](bool is_source, Progress& its) {
            left[is_source ? 0 : 1] = is_source
                                          ? approach(source, *smooth[0], on_source, goals, its)
                                          : approach(target, *smooth[1], on_target, goals, its);
        });
        apart = std::max(left[0], left[1]);
    }
    return apart;
}

/// Evens out both sides by turns: from one side, then from the other, as triangles of one see what
/// lies between the corners of the other's.
class EveningOut {
public:
    EveningOut(SphericalMesh& source, SphericalMesh& target, std::span<const IndexPair> features,
               double area_weight) {
        parallel_invoke(2, [&](int k, bool) {
            if (k == 0)
                of_source_.emplace(source, target, side_of(features, &IndexPair::source),
                                   area_weight);
            else
                of_target_.emplace(target, source, side_of(features, &IndexPair::target),
                                   area_weight);
        });
    }

    /// Until two rounds hardly gain. Returns the energy.
    double run(Index rounds, Progress& progress) {
        constexpr double kGain = 1e-3;  // of two rounds that are worth going on
        double energy = 0.0, of_both = 0.0, before = kInfinity;
        for (Index round = 0; round < rounds; ++round) {
            const bool from_source = round % 2 == 0;
            energy = (from_source ? of_source_ : of_target_)->even_out(progress);
            progress.report(static_cast<double>(round + 1) / rounds);
            of_both += energy;
            if (from_source) continue;
            if (!(of_both < (1.0 - kGain) * before)) break;
            before = std::exchange(of_both, 0.0);
        }
        return energy;
    }

private:
    /// The side whose places move.
    class Side {
    public:
        Side(SphericalMesh& moving, const SphericalMesh& other, std::span<const Index> fixed,
             double area_weight)
            : moving_(moving),
              fixed_(fixed.begin(), fixed.end()),
              stretch_(moving, other, area_weight) {}

        double even_out(Progress& progress) {
            constexpr int kSteps = 30;
            stretch_.look_at_target();
            const std::vector<Vector3> weights = stretch_.stiffness(moving_.images);
            if (smooth_)
                smooth_->set_weights(weights);
            else
                smooth_.emplace(moving_.triangles, moving_.size(), fixed_, weights);
            smooth_->set_scales(stretch_.scales(moving_.images));
            return descend(moving_.images, moving_.triangles, *smooth_, kSteps, stretch_, progress);
        }

    private:
        SphericalMesh& moving_;
        std::vector<Index> fixed_;
        Stretch stretch_;
        std::optional<Smoother> smooth_;
    };
    std::optional<Side> of_source_, of_target_;
};

/// The turn of the source, of the likely ones, after which features meet and least is stretched.
Matrix3 best_of_likely_rotations(const SphericalMesh& source, const SphericalMesh& target,
                                 std::span<const IndexPair> features,
                                 const SphericalAlignmentOptions& options, Progress& progress) {
    constexpr Index kRounds = 2;
    const auto rotations = likely_rotations(source, target, features, options, progress);
    std::vector<double> energies(rotations.size(), kInfinity);
    const Progress::Part part(progress, 0.1, 0.4);
    parallel_invoke(static_cast<int>(rotations.size()), progress, [&](int k, Progress& its) {
        SphericalMesh s = source, t = target;
        s.images = source.images * rotations[to_size(k)].transpose();
        Index unused = 0;
        if (meet(s, t, features, options.max_steps, unused, its) > 0.0) return;
        energies[to_size(k)] = EveningOut(s, t, features, options.area_weight).run(kRounds, its);
    });
    const auto least = std::ranges::min_element(energies) - energies.begin();
    const bool any = !energies.empty() && energies[to_size(least)] < kInfinity;
    return any ? rotations[to_size(least)] : Matrix3(Matrix3::Identity());
}

}  // namespace

SphereLocator::SphereLocator(std::span<const Triangle> triangles, const Positions& images)
    : triangles_(triangles), facing_(triangles.size()), across_(triangles.size()) {
    move_to(images);
    struct Side {
        Index low, high, triangle, corner;
        auto operator<=>(const Side&) const = default;
    };
    std::vector<Side> sides;
    for (Index t = 0; t < to_index(triangles.size()); ++t)
        for (Index k = 0; k < 3; ++k) {
            const Index a = triangles[to_size(t)][to_size(k)],
                        b = triangles[to_size(t)][to_size((k + 1) % 3)];
            sides.push_back({std::min(a, b), std::max(a, b), t, k});
        }
    std::ranges::sort(sides);
    for (std::size_t i = 0; i + 1 < sides.size(); i += 2) {
        across_[to_size(sides[i].triangle)][to_size(sides[i].corner)] = sides[i + 1].triangle;
        across_[to_size(sides[i + 1].triangle)][to_size(sides[i + 1].corner)] = sides[i].triangle;
    }
}

void SphereLocator::move_to(const Positions& images) {
    for (std::size_t t = 0; t < facing_.size(); ++t) {
        const auto& [a, b, c] = triangles_[t];
        const Vector3 p = row_of(images, a), q = row_of(images, b), r = row_of(images, c);
        facing_[t] = {q.cross(r), r.cross(p), p.cross(q)};
    }
}

PlaceInMesh SphereLocator::find(const Vector3& place, Index start) const {
    const auto sides = [&](Index triangle) -> Vector3 {
        const auto& [a, b, c] = facing_[to_size(triangle)];
        return {a.dot(place), b.dot(place), c.dot(place)};
    };
    const auto found = [&](Index triangle, const Vector3& side) {
        const Vector3 inside = side.cwiseMax(0.0);
        return PlaceInMesh{triangle, inside / inside.sum()};
    };
    const auto count = to_index(triangles_.size());
    Index triangle = start;
    for (Index step = 0; step < count; ++step) {
        const Vector3 side = sides(triangle);
        if (side[0] >= 0.0 && side[1] >= 0.0 && side[2] >= 0.0)
            return {triangle, side / side.sum()};
        Index least = 0;
        side.minCoeff(&least);
        triangle = across_[to_size(triangle)][to_size((least + 1) % 3)];
    }
    // Walks end but for rounding.
    double best = -kInfinity;
    for (Index t = 0; t < count; ++t) {
        const Vector3 side = sides(t);
        const double inside = side.minCoeff() / side.sum();
        if (!(side.sum() > 0.0) || inside <= best) continue;
        best = inside;
        triangle = t;
    }
    return found(triangle, sides(triangle));
}

SphericalAlignment align_on_sphere(SphericalMesh& source, SphericalMesh& target,
                                   std::span<const IndexPair> features,
                                   const SphericalAlignmentOptions& options, Progress& progress,
                                   const WorkBeside& beside) {
    SphericalAlignment result;
    result.searched = to_index(features.size()) < options.features_that_fix_the_rotation;
    if (result.searched) {
        const Matrix3 turn = best_of_likely_rotations(source, target, features, options, progress);
        source.images = source.images * turn.transpose();
    } else {
        rotate_to_features(source, target, features);
    }
    const double apart = meet(source, target, features, options.max_steps, result.steps, progress);
    if (apart > 0.0)
        throw ConvergenceError("features", "features that meet on the sphere without a fold",
                               "some that stay " + std::to_string(apart) + " sphere radii apart",
                               "Check that they mark the same places on both models, that left and "
                               "right are not swapped, and that no two coincide.");
    // Extremities come as near as they can, and the descent may take them on from there.
    if (const auto extremities =
            paired_extremities(source, target, features, options.extremities, progress);
        !extremities.empty()) {
        std::vector<IndexPair> all(features.begin(), features.end());
        all.insert(all.end(), extremities.begin(), extremities.end());
        meet(source, target, all, options.max_extremity_steps, result.steps, progress);
        result.extremities = extremities;
    }
    EveningOut evening_out(source, target, features, options.area_weight);
    const Progress::Part part(progress, 0.4, 1.0);
    parallel_invoke(static_cast<int>(1 + beside.size()), progress, [&](int k, Progress& its) {
        if (k == 0)
            result.energy = evening_out.run(options.descent_rounds, its);
        else
            beside[to_size(k - 1)](its);
    });
    return result;
}

}  // namespace pointmorph
