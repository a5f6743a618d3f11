#include "pointmorph/frames/motion.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <type_traits>
#include <utility>

#include "base/angle.hpp"
#include "base/compiler.hpp"
#include "cloud/normalized_rows.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/prolongation.hpp"

namespace pointmorph {

namespace {

Matrix3 share_of(const Eigen::AngleAxisd& whole, double t) {
    return Eigen::AngleAxisd(t * whole.angle(), whole.axis()).toRotationMatrix();
}

}  // namespace

Similarity GradualSimilarity::at(double t) const {
    Similarity part;
    part.scale = std::pow(whole.scale, t);
    part.rotation = share_of(angle_axis(whole.rotation), t);
    const Vector3 end = whole.scale * (whole.rotation * center) + whole.translation;
    part.translation = (1.0 - t) * center + t * end - part.scale * (part.rotation * center);
    return part;
}

GradualSimilarity GradualSimilarity::reversed() const {
    return {whole.inverse(), whole.scale * (whole.rotation * center) + whole.translation};
}

GradualSimilarity whole_motion(const Positions& positions, const Positions& images,
                               const Positions& other) {
    constexpr double kMost = 1e6;
    GradualSimilarity motion{fit_similarity(positions, images),
                             positions.colwise().mean().transpose()};
    const double expected = normalization(other).scale / normalization(positions).scale;
    if (!(expected > 0.0 && std::isfinite(expected))) return motion;  // coincident points
    Similarity& whole = motion.whole;
    const double scale = std::clamp(whole.scale, expected / kMost, expected * kMost);
    if (scale == whole.scale) return motion;
    whole.translation += (whole.scale - scale) * (whole.rotation * motion.center);
    whole.scale = scale;
    return motion;
}

struct MotionGround::Nodes {
    CoarseShape shape;
    DeformationSolver solver;
    std::optional<Prolongation> prolongation;  ///< of all points; found last

    explicit Nodes(CoarseShape coarse)
        : shape(std::move(coarse)), solver(shape.positions, graph()) {
        solver.factorize(1.0, {});
    }

    const DeformationGraph& graph() const { return shape.levels.front(); }
};

MotionGround::MotionGround(const Positions& positions, const Normals& normals, PathKind path,
                           Progress& progress)
    : unit_(normalization(positions)),
      positions_(unit_.apply(positions)),
      normals_(normals.cast<float>()) {
    if (path != PathKind::kRigid) return;
    constexpr Index kNodes = 1000;
    CoarseShapeOptions options;
    options.nodes = {kNodes};
    const KdTree<3> tree(positions_);
    nodes_ = std::make_unique<Nodes>(coarse_shape(tree, normals, {}, options, progress));
}

MotionGround::~MotionGround() = default;
MotionGround::MotionGround(MotionGround&&) noexcept = default;

void MotionGround::follow(const Normals& normals, Progress& progress) {
    if (nodes_ && !nodes_->prolongation)
        nodes_->prolongation.emplace(nodes_->shape, positions_, normals, progress);
}

/// What the nodes do by t = 1.
struct Motion::Bend {
    const MotionGround::Nodes& nodes;
    Deformation whole;
    std::vector<Eigen::AngleAxisd> turns;  ///< of its rotations
    Positions residual;  ///< nodes' images less where their own turns and scales would put them

    Bend(const MotionGround::Nodes& of, const Positions& images) : nodes(of) {
        constexpr int kSmoothing = 1;
        constexpr double kLargestScale = 10.0;
        const CoarseShape& shape = nodes.shape;
        whole.positions = gather(gather(images, shape.cloud_rows), nodes.graph().node_rows);
        fit_similarities(shape.positions, nodes.graph(), kSmoothing, kLargestScale, whole);
        for (const Matrix3& rotation : whole.rotations) turns.push_back(angle_axis(rotation));
        residual = whole.positions - placed(whole);
    }

    /// Places that follow from the turns and scales, about the center of the nodes' images.
    Positions placed(Deformation deformation) const {
        nodes.solver.solve({}, deformation);
        return deformation.positions.rowwise() - deformation.positions.colwise().mean();
    }

    DeformedCloud at(double t) const {
        Deformation part;
        for (const Eigen::AngleAxisd& turn : turns) part.rotations.push_back(share_of(turn, t));
        part.scales = whole.scales.array().pow(t);
        part.positions = placed(part) + t * residual;
        const Positions rest = gather(nodes.shape.positions, nodes.graph().node_rows);
        part.positions.rowwise() += (1.0 - t) * rest.colwise().mean();
        return deformed_places(nodes.shape.positions, nodes.graph(), part);
    }
};

Motion::Motion(const Positions& positions, const Normals& normals, const Positions& images,
               const GradualSimilarity& similarity, PathKind path, Progress& progress)
    : Motion({positions, normals, images, similarity}, path, progress) {
    follow(normals, progress);
}

Motion::BothWays Motion::both_ways(Ends there, Ends back, PathKind path, Progress& progress) {
    std::array<std::unique_ptr<Motion>, 2> found;
    {
        const Progress::Part part(progress, 0.0, 0.5);
        on_both(progress, [&](bool is_source, Progress& its) {
            found[is_source ? 0 : 1].reset(
                new Motion(std::move(is_source ? there : back), path, its));
        });
    }
    for (const double k : {0.0, 1.0}) {
        const Progress::Part part(progress, 0.5 + 0.25 * k, 0.75 + 0.25 * k);
        found[k > 0.0 ? 1 : 0]->follow(k > 0.0 ? back.normals : there.normals, progress);
    }
    return {std::move(*found[0]), std::move(*found[1])};
}

Motion::Motion(Ends&& ends, PathKind path, Progress& progress)
    : ground_(ends.ground ? std::move(*ends.ground)
                          : MotionGround(ends.positions, ends.normals, path, progress)),
      similarity_(path == PathKind::kLinear ? GradualSimilarity{{}, ground_.unit_.center}
                                            : ends.similarity) {
    offsets_ = ground_.unit_.apply(similarity_.whole.inverse().apply(ends.images));
    if (ground_.nodes_)
        bend_ = std::make_unique<Bend>(*ground_.nodes_, offsets_);
    else
        offsets_ -= ground_.positions_;
}

/// Lets all points follow the nodes, if there are any. Until then, `offsets_` are the images.
void Motion::follow(const Normals& normals, Progress& progress) {
    if (!bend_) return;
    ground_.follow(normals, progress);
    const Prolongation& prolongation = *ground_.nodes_->prolongation;
    // Found backward: what has to be added at rest so that the end is the image. Where blended
    // turns cancel, nothing at rest would do: there it is added to the end, without any turn.
    const DeformedCloud end = bend_->at(1.0);
    const CoarseMoves moves(ground_.nodes_->shape, end);
    unturned_ = Positions::Zero(offsets_.rows(), 3);
    constexpr double kSingular = 1e-3;
    OrientedPoints moved{ground_.positions_, normals};
    parallel_for(to_index(offsets_.rows()), progress, [&](Index first, Index last) {
        prolongation.move(first, last, moves, moved);
        for (Index i = first; i < last; ++i) {
            const Vector3 lacking = (offsets_.row(i) - moved.positions.row(i)).transpose();
            const Matrix3 linear = prolongation.linear(i, end);
            const double scale = linear.norm();
            if (linear.determinant() > kSingular * scale * scale * scale) {
                offsets_.row(i) = linear.inverse() * lacking;
            } else {
                unturned_.row(i) = lacking;
                offsets_.row(i).setZero();
            }
        }
    });
    if (unturned_.isZero(0.0)) unturned_.resize(0, 3);
}

Motion::~Motion() = default;
Motion::Motion(Motion&&) noexcept = default;

/// What all points have in common at one time.
struct Motion::State {
    double t;
    std::optional<CoarseMoves> moves;  ///< where parts turn; with the similarity
    Matrix3 linear, rotation;          ///< of the similarity, from normalized points
    Vector3 translation;
};

Motion::State Motion::state(double t) const {
    State state;
    state.t = t;
    const Similarity part = similarity_.at(t);
    state.rotation = part.rotation;
    const double scale = ground_.unit_.scale * part.scale;
    state.linear = scale * part.rotation;
    state.translation = part.scale * (part.rotation * ground_.unit_.center) + part.translation;
    if (bend_) {
        state.moves.emplace(ground_.nodes_->shape, bend_->at(t));
        state.moves->then({scale, part.rotation, state.translation});
    }
    return state;
}

void Motion::place(const State& state, Index begin, Index end,
                   std::span<OrientedPoint> places) const {
    if (bend_)
        ground_.nodes_->prolongation->move(
            begin, end, *state.moves, {ground_.positions_, ground_.normals_, offsets_, state.t},
            places);
    for (Index i = begin; i < end && !bend_; ++i) {
        const Vector3 from = (ground_.positions_.row(i) + state.t * offsets_.row(i)).transpose();
        const Vector3 place = state.linear * from + state.translation;
        const Eigen::Vector3f normal =
            (state.rotation * ground_.normals_.row(i).transpose().cast<double>()).cast<float>();
        places[to_size(i)] = {{place[0], place[1], place[2]},
                              {normal[0], normal[1], normal[2], 0.0F}};
    }
    for (Index i = begin; i < end && unturned_.rows() > 0; ++i) {
        const Vector3 lacking = state.t * (state.linear * unturned_.row(i).transpose());
        for (int d = 0; d < 3; ++d) places[to_size(i)].position[to_size(d)] += lacking[d];
    }
}

OrientedPoints as_arrays(std::span<const OrientedPoint> points) {
    const auto count = to_index(points.size());
    OrientedPoints result{Positions(count, 3), Normals(count, 3)};
    Progress silent;
    parallel_for(count, silent, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const auto& [position, normal] = points[to_size(i)];
            result.positions.row(i) << position[0], position[1], position[2];
            result.normals.row(i) << normal[0], normal[1], normal[2];
        }
    });
    return result;
}

OrientedPoints Motion::at(double t) const {
    const State state = this->state(t);
    std::vector<OrientedPoint> places(to_size(offsets_.rows()));
    Progress silent;
    parallel_for(to_index(places.size()), silent,
                 [&](Index begin, Index end) { place(state, begin, end, places); });
    return as_arrays(places);
}

void find_midway(const Motion& forth, const Motion& back, double t, Midway& midway) {
    midway.t = -1.0;
    std::array<std::optional<Motion::State>, 2> states;
    parallel_invoke(2, [&](int k, bool) {
        states[to_size(k)] = k == 0 ? forth.state(t) : back.state(1.0 - t);
    });
    const auto sources = to_index(forth.offsets_.rows());
    const auto targets = to_index(back.offsets_.rows());
    midway.source.resize(to_size(sources));
    midway.target.resize(to_size(targets));
    Progress silent;
    parallel_for(sources + targets, silent, [&](Index begin, Index end) {
        forth.place(*states[0], std::min(begin, sources), std::min(end, sources), midway.source);
        back.place(*states[1], std::max(begin, sources) - sources, std::max(end, sources) - sources,
                   midway.target);
    });
    midway.t = t;
}

namespace {

/// So many normals, each with a number after it, from the one to the other.
template <class Scalar>
using NormalBlock = std::array<Scalar, 4 * to_size(kNormalizedAtOnce)>;

/// Normalizes the first `count` into rows of three, floats eight at a time where registers are
/// wide, with the same bits. One that cancels becomes what `otherwise` has for its number.
template <class Scalar, class Otherwise>
void put_normalized(const NormalBlock<Scalar>& normals, std::size_t count, Scalar* to,
                    Otherwise&& otherwise) {
    constexpr auto kCancelled = static_cast<Scalar>(1e-6);
    if constexpr (std::is_same_v<Scalar, float>)
        if (count % 8 == 0 && has_wide_registers() &&
            put_units_wide(normals.data(), kCancelled, to, count))
            return;
    alignas(16) std::array<Scalar, to_size(kNormalizedAtOnce)> lengths, factors;
    for (std::size_t i = 0; i < count; ++i) {
        const Scalar* const n = normals.data() + 4 * i;
        lengths[i] = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    }
    using Array = Eigen::Array<Scalar, Eigen::Dynamic, 1>;
    const auto size = static_cast<Eigen::Index>(count);
    auto its_lengths = Array::MapAligned(lengths.data(), size);
    its_lengths = its_lengths.sqrt();
    Array::MapAligned(factors.data(), size) = its_lengths.inverse();
    for (std::size_t i = 0; i < count; ++i) {
        if (lengths[i] > kCancelled) {
            for (std::size_t d = 0; d < 3; ++d) to[3 * i + d] = factors[i] * normals[4 * i + d];
        } else {
            const OrientedPoint& instead = otherwise(i);
            std::copy_n(instead.normal.begin(), 3, to + 3 * i);
        }
    }
}

}  // namespace

template <class Scalar>
void fade(const Midway& midway, std::span<const IndexPair> pairs, double t,
          std::span<Scalar> positions, std::span<Scalar> normals) {
    const double share = t * t * (3.0 - 2.0 * t), rest = 1.0 - share;
    const auto normal_share = static_cast<Scalar>(share), normal_rest = static_cast<Scalar>(rest);
    const auto source_of = [&](std::size_t pair) -> const OrientedPoint& {
        return midway.source[to_size(pairs[pair].source)];
    };
    const auto target_of = [&](std::size_t pair) -> const OrientedPoint& {
        return midway.target[to_size(pairs[pair].target)];
    };
    constexpr std::size_t kAhead = 16;  // while so many pairs are placed, memory answers
    constexpr auto kBlock = to_size(kNormalizedAtOnce);
    Progress silent;
    parallel_for(to_index(pairs.size()), silent, [&](Index begin, Index end) {
        alignas(16) NormalBlock<Scalar> block;
        for (std::size_t first = to_size(begin); first < to_size(end); first += kBlock) {
            const std::size_t count = std::min(kBlock, to_size(end) - first);
            for (std::size_t i = 0; i < count; ++i) {
                const std::size_t pair = first + i;
                if (pair + kAhead < pairs.size()) {
                    const OrientedPoint& soon = target_of(pair + kAhead);
                    fetch_early(&soon);
                    fetch_early(&soon.normal.back());  // mostly another cache line
                }
                const OrientedPoint &from = source_of(pair), &to = target_of(pair);
                for (std::size_t d = 0; d < 3 && !positions.empty(); ++d)
                    positions[3 * pair + d] =
                        static_cast<Scalar>(rest * from.position[d] + share * to.position[d]);
                for (std::size_t d = 0; d < 4; ++d)
                    block[4 * i + d] = normal_rest * static_cast<Scalar>(from.normal[d]) +
                                       normal_share * static_cast<Scalar>(to.normal[d]);
            }
            if (!normals.empty())
                put_normalized<Scalar>(block, count, normals.data() + 3 * first,
                                       [&](std::size_t i) -> const OrientedPoint& {
                                           return share < 0.5 ? source_of(first + i)
                                                              : target_of(first + i);
                                       });
        }
    });
}

template void fade<float>(const Midway&, std::span<const IndexPair>, double, std::span<float>,
                          std::span<float>);
template void fade<double>(const Midway&, std::span<const IndexPair>, double, std::span<double>,
                           std::span<double>);

}  // namespace pointmorph
