#include "pointmorph/frames/motion.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

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

/// The nodes and what they do by t = 1.
struct Motion::Bend {
    CoarseShape shape;
    DeformationSolver solver;
    Deformation whole;
    std::vector<Eigen::AngleAxisd> turns;  ///< of its rotations
    Positions residual;  ///< nodes' images less where their own turns and scales would put them
    std::optional<Prolongation> prolongation;  ///< of all points; found last

    Bend(CoarseShape coarse, const Positions& images)
        : shape(std::move(coarse)), solver(shape.positions, graph()) {
        constexpr int kSmoothing = 1;
        constexpr double kLargestScale = 10.0;
        whole.positions = gather(gather(images, shape.cloud_rows), graph().node_rows);
        fit_similarities(shape.positions, graph(), kSmoothing, kLargestScale, whole);
        for (const Matrix3& rotation : whole.rotations) turns.push_back(angle_axis(rotation));
        solver.factorize(1.0, {});
        residual = whole.positions - placed(whole);
    }

    const DeformationGraph& graph() const { return shape.levels.front(); }

    /// Places that follow from the turns and scales, about the center of the nodes' images.
    Positions placed(Deformation deformation) const {
        solver.solve({}, deformation);
        return deformation.positions.rowwise() - deformation.positions.colwise().mean();
    }

    DeformedCloud at(double t) const {
        Deformation part;
        for (const Eigen::AngleAxisd& turn : turns) part.rotations.push_back(share_of(turn, t));
        part.scales = whole.scales.array().pow(t);
        part.positions = placed(part) + t * residual;
        const Positions rest = gather(shape.positions, graph().node_rows);
        part.positions.rowwise() += (1.0 - t) * rest.colwise().mean();
        return deformed_places(shape.positions, graph(), part);
    }
};

Motion::Motion(const Positions& positions, const Normals& normals, const Positions& images,
               const GradualSimilarity& similarity, PathKind path, Progress& progress)
    : Motion({positions, normals, images, similarity}, path, progress) {
    follow(progress);
}

Motion::BothWays Motion::both_ways(const Ends& there, const Ends& back, PathKind path,
                                   Progress& progress) {
    std::array<std::unique_ptr<Motion>, 2> found;
    {
        const Progress::Part part(progress, 0.0, 0.5);
        on_both(progress, [&](bool is_source, Progress& its) {
            found[is_source ? 0 : 1].reset(new Motion(is_source ? there : back, path, its));
        });
    }
    for (const double k : {0.0, 1.0}) {
        const Progress::Part part(progress, 0.5 + 0.25 * k, 0.75 + 0.25 * k);
        found[k > 0.0 ? 1 : 0]->follow(progress);
    }
    return {std::move(*found[0]), std::move(*found[1])};
}

Motion::Motion(const Ends& ends, PathKind path, Progress& progress)
    : unit_(normalization(ends.positions)),
      positions_(unit_.apply(ends.positions)),
      normals_(ends.normals),
      similarity_(path == PathKind::kLinear ? GradualSimilarity{{}, unit_.center}
                                            : ends.similarity) {
    offsets_ = unit_.apply(similarity_.whole.inverse().apply(ends.images));
    if (path != PathKind::kRigid) {
        offsets_ -= positions_;
        return;
    }
    constexpr Index kNodes = 1000;
    CoarseShapeOptions options;
    options.nodes = {kNodes};
    const KdTree<3> tree(positions_);
    bend_ = std::make_unique<Bend>(coarse_shape(tree, normals_, {}, options, progress), offsets_);
}

/// Lets all points follow the nodes, if there are any. Until then, `offsets_` are the images.
void Motion::follow(Progress& progress) {
    if (!bend_) return;
    const Prolongation& prolongation =
        bend_->prolongation.emplace(bend_->shape, positions_, normals_, progress);
    // Found backward: what has to be added at rest so that the end is the image. Where blended
    // turns cancel, nothing at rest would do: there it is added to the end, without any turn.
    const DeformedCloud end = bend_->at(1.0);
    const CoarseMoves moves(bend_->shape, end);
    unturned_ = Positions::Zero(offsets_.rows(), 3);
    constexpr double kSingular = 1e-3;
    OrientedPoints moved{positions_, normals_};
    parallel_for(to_index(positions_.rows()), progress, [&](Index first, Index last) {
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
    const double scale = unit_.scale * part.scale;
    state.linear = scale * part.rotation;
    state.translation = part.scale * (part.rotation * unit_.center) + part.translation;
    if (bend_) {
        state.moves.emplace(bend_->shape, bend_->at(t));
        state.moves->then({scale, part.rotation, state.translation});
    }
    return state;
}

void Motion::place(const State& state, Index begin, Index end, OrientedPoints& places) const {
    constexpr Index kBlock = 256;  // stays in the caches from step to step
    for (Index first = begin; first < end; first += kBlock) {
        const Index count = std::min(kBlock, end - first);
        const auto rows = [&](auto& of) { return of.middleRows(first, count); };
        auto positions = rows(places.positions), normals = rows(places.normals);
        positions = rows(positions_) + state.t * rows(offsets_);
        normals = rows(normals_);
        if (bend_) {
            bend_->prolongation->move(first, first + count, *state.moves, places);
        } else {
            positions *= state.linear.transpose();
            positions.rowwise() += state.translation.transpose();
            normals *= state.rotation.transpose();
        }
        if (unturned_.rows() > 0) positions += state.t * rows(unturned_) * state.linear.transpose();
    }
}

OrientedPoints Motion::at(double t) const {
    const State state = this->state(t);
    const auto count = to_index(positions_.rows());
    OrientedPoints result{Positions(count, 3), Normals(count, 3)};
    Progress silent;
    parallel_for(count, silent, [&](Index begin, Index end) { place(state, begin, end, result); });
    return result;
}

void find_midway(const Motion& forth, const Motion& back, double t, Midway& midway) {
    midway.t = -1.0;
    std::array<std::optional<Motion::State>, 2> states;
    parallel_invoke(2, [&](int k, bool) {
        states[to_size(k)] = k == 0 ? forth.state(t) : back.state(1.0 - t);
    });
    const auto sources = to_index(forth.positions_.rows());
    const auto targets = to_index(back.positions_.rows());
    for (OrientedPoints* places : {&midway.source, &midway.target}) {
        const Index count = places == &midway.source ? sources : targets;
        places->positions.resize(count, 3);
        places->normals.resize(count, 3);
    }
    Progress silent;
    parallel_for(sources + targets, silent, [&](Index begin, Index end) {
        forth.place(*states[0], std::min(begin, sources), std::min(end, sources), midway.source);
        back.place(*states[1], std::max(begin, sources) - sources, std::max(end, sources) - sources,
                   midway.target);
    });
    midway.t = t;
}

template <class Scalar>
void fade(const Midway& midway, std::span<const IndexPair> pairs, double t,
          std::span<Scalar> positions, std::span<Scalar> normals) {
    using Rows = Eigen::Matrix<Scalar, Eigen::Dynamic, 3, Eigen::RowMajor>;
    using Block = Eigen::Matrix<double, kNormalizedAtOnce, 3, Eigen::RowMajor>;
    const OrientedPoints &source = midway.source, &target = midway.target;
    const double share = t * t * (3.0 - 2.0 * t);
    const auto faded = [share](const Positions& from, const Positions& to, IndexPair pair) {
        return (1.0 - share) * from.row(pair.source) + share * to.row(pair.target);
    };
    constexpr std::size_t kAhead = 16;  // while so many pairs are placed, memory answers
    constexpr double kCancelled = 1e-6;
    Progress silent;
    parallel_for(to_index(pairs.size()), silent, [&](Index begin, Index end) {
        Block block;
        for (Index first = begin; first < end; first += kNormalizedAtOnce) {
            const Index count = std::min(kNormalizedAtOnce, end - first);
            const auto those = pairs.subspan(to_size(first), to_size(count));
            const auto ahead = pairs.subspan(std::min(to_size(first) + kAhead, pairs.size()));
            auto rows = block.topRows(count);
            const auto fill = [&](const Positions& from, const Positions& to) {
                for (Index i = 0; i < count; ++i) {
                    if (to_size(i) < ahead.size()) fetch_early(&to(ahead[to_size(i)].target, 0));
                    rows.row(i) = faded(from, to, those[to_size(i)]);
                }
            };
            const auto put = [&](std::span<Scalar> to) {
                Eigen::Map<Rows>(to.data() + 3 * first, count, 3) = rows.template cast<Scalar>();
            };
            if (!positions.empty()) {
                fill(source.positions, target.positions);
                put(positions);
            }
            if (normals.empty()) continue;
            fill(source.normals, target.normals);
            normalize_rows(rows, kCancelled, [&](Index i) -> Eigen::RowVector3d {
                const auto [s, r] = those[to_size(i)];
                if (share < 0.5) return source.normals.row(s);
                return target.normals.row(r);
            });
            put(normals);
        }
    });
}

template void fade<float>(const Midway&, std::span<const IndexPair>, double, std::span<float>,
                          std::span<float>);
template void fade<double>(const Midway&, std::span<const IndexPair>, double, std::span<double>,
                           std::span<double>);

}  // namespace pointmorph
