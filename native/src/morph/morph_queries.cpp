// What a Morph answers.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <type_traits>

#include "morph/input_checks.hpp"
#include "morph/mesh_side.hpp"
#include "morph/morph_caches.hpp"
#include "morph/product_route.hpp"
#include "morph/wrapped_mesh.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/surface/transfer.hpp"

namespace pointmorph {

namespace {

std::span<double> span_of(Positions& rows) {
    return {rows.data(), to_size(rows.size())};
}

/// Gives the first points their share of the radius and takes out those without any.
template <class Scalar>
void hide(const Values& shares, ResampledFrame<Scalar>& frame) {
    std::size_t to = 0;
    for (std::size_t from = 0; from < frame.ids.size(); ++from) {
        const auto row = static_cast<Eigen::Index>(from);
        const double share = row < shares.size() ? shares[row] : 1.0;
        if (!(share > 0.0)) continue;
        const auto move = [&](std::vector<Scalar>& values, std::size_t width) {
            std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(width * from), width,
                        values.begin() + static_cast<std::ptrdiff_t>(width * to));
        };
        move(frame.positions, 3);
        move(frame.normals, 3);
        move(frame.colors, 4);
        move(frame.velocities, 3);
        frame.radii[to] = static_cast<Scalar>(share * static_cast<double>(frame.radii[from]));
        frame.ids[to++] = frame.ids[from];
    }
    frame.positions.resize(3 * to);
    frame.normals.resize(3 * to);
    frame.colors.resize(4 * to);
    frame.velocities.resize(3 * to);
    frame.radii.resize(to);
    frame.ids.resize(to);
}

}  // namespace

Positions Morph::source_to_target(Progress& progress) const {
    return through_domain(source_images_, source_domain_, target_domain_, target_, progress);
}

Positions Morph::target_to_source(Progress& progress) const {
    return through_domain(target_images_, target_domain_, source_domain_, source_, progress);
}

/// Without a copy where they are known, else in `own`.
const Positions& Morph::images_of(bool of_source, Positions& own, Progress& progress) const {
    const Positions& known = of_source ? source_images_ : target_images_;
    if (known.rows() > 0) return known;
    own = of_source ? source_to_target(progress) : target_to_source(progress);
    return own;
}

Positions Morph::through_domain(const Positions& images, const DomainPoints& from,
                                const DomainPoints& to, const Cloud& other,
                                Progress& progress) const {
    if (images.rows() > 0) return images;
    const ThreadCount threads(options_.threads);
    progress.enter("transfer");
    Positions result;
    if (to.cols() == 2) {
        const DiskPoints disk = to;
        result = transfer<2>(KdTree<2>(disk), other.positions, from, options_.transfer, progress);
    } else {
        const KdTree<3>::Points sphere = to;
        result = transfer<3>(KdTree<3>(sphere), other.positions, from, options_.transfer, progress);
    }
    progress.finish();
    return result;
}

bool Morph::has_mesh_of(bool is_source) const noexcept {
    if ((is_source ? caches_->wrapped_source : caches_->wrapped_target).kept) return true;
    return meshes_ && (is_source ? meshes_->sides().source : meshes_->sides().target).has_value();
}

bool Morph::has_mesh() const noexcept {
    return has_mesh_of(true);
}

bool Morph::has_target_mesh() const noexcept {
    return has_mesh_of(false);
}

void Morph::Wrapped::keep(const Cloud& cloud, const Cloud& other, Positions vertex_ends) {
    if (vertex_ends.rows() == 0) return;
    if (vertex_ends.rows() != cloud.size() || cloud.faces.size() == 0 ||
        !lie_around(vertex_ends, other))
        throw CloudError(cloud.name,
                         "faces, and a finite position around " + other.name + " per vertex",
                         std::to_string(cloud.faces.size()) + " faces and " +
                             std::to_string(vertex_ends.rows()) + " positions",
                         "Use what the morph's wrapped() returned.");
    kept = make_mesh(cloud);
    ends = std::move(vertex_ends);
}

Morph::WrappedSides Morph::wrapped_sides(bool is_source) const {
    const Cloud &from = is_source ? source_ : target_, &to = is_source ? target_ : source_;
    if ((is_source ? caches_->wrapped_source : caches_->wrapped_target).kept)
        throw CloudError(from.name, "a morph with all its data",
                         "only what frames need, from a file or an earlier morph",
                         "Compute the morph again.");
    if (!has_mesh_of(is_source))
        throw CloudError(from.name, "faces to wrap onto " + to.name, "none",
                         "Give the faces of the mesh, and use method auto.");
    const auto& [shared, source_images, target_images, source_holds, target_holds] = *meshes_;
    const MeshSides& sides = *shared;
    const auto& mesh = is_source ? sides.source : sides.target;
    const auto& other = is_source ? sides.target : sides.source;
    std::vector<IndexPair> pinned = pinned_pairs(features_);
    if (!is_source)
        for (IndexPair& pair : pinned) std::swap(pair.source, pair.target);
    return {{from, is_source ? source_holds : target_holds, *mesh,
             is_source ? source_images : target_images, is_source ? source_images_ : target_images_,
             leaves_missing(options_,
                            sides.source ? sides.source->samples().positions : source_.positions,
                            sides.target ? sides.target->samples().positions : target_.positions)},
            {to, other ? &*other : nullptr, is_source ? target_images : source_images},
            std::move(pinned)};
}

const Mesh& Morph::own_mesh(bool is_source) const {
    const Wrapped& wrapped = is_source ? caches_->wrapped_source : caches_->wrapped_target;
    return wrapped.kept ? *wrapped.kept : wrapped_sides(is_source).source.mesh.mesh();
}

/// Where the vertices of one side are once they have gone so much of the way to the other.
Positions Morph::on_the_way(bool is_source, double share, Progress& progress) const {
    if (!(share >= 0.0 && share <= 1.0))
        throw OptionError("t", "a number from 0 to 1",
                          std::to_string(is_source ? share : 1.0 - share),
                          "Choose a value from that range.");
    const std::scoped_lock lock(caches_->wrapping_mutex);
    const ThreadCount threads(options_.threads);
    Wrapped& wrapped = is_source ? caches_->wrapped_source : caches_->wrapped_target;
    if (!wrapped.ends) {
        const WrappedSides sides = wrapped_sides(is_source);
        progress.enter("wrapping");
        wrapped.ends =
            wrapped_vertices(sides.source, sides.target, sides.pinned, options_.wrapping, progress);
        progress.finish();
    }
    const Positions &starts = (is_source ? source_ : target_).positions, &ends = *wrapped.ends;
    if (share == 0.0) return starts;
    if (share == 1.0) return ends;
    return delays_.size() > 0 ? staggered(is_source, share, progress)
                              : along_path(is_source, share, progress);
}

/// All vertices of a wrapped mesh at once, between its ends. The caller holds wrapping_mutex.
Positions Morph::along_path(bool is_source, double share, Progress& progress) const {
    Wrapped& wrapped = is_source ? caches_->wrapped_source : caches_->wrapped_target;
    const Cloud& cloud = is_source ? source_ : target_;
    const Positions &starts = cloud.positions, &ends = *wrapped.ends;
    if (options_.path_kind() == PathKind::kLinear) return (1.0 - share) * starts + share * ends;
    progress.enter("motion");
    if (!wrapped.motion) {
        const GradualSimilarity similarity{fit_similarity(starts, ends),
                                           starts.colwise().mean().transpose()};
        const Normals normals = cloud.normals.rowwise().normalized();
        wrapped.motion.emplace(own_mesh(is_source), OrientedView{starts, normals}, ends, similarity,
                               options_.path_kind(), progress);
    }
    Positions result = wrapped.motion->at(share, progress);
    progress.finish();
    return result;
}

/// The same, each vertex at its own time.
Positions Morph::staggered(bool is_source, double share, Progress& progress) const {
    Wrapped& wrapped = is_source ? caches_->wrapped_source : caches_->wrapped_target;
    const Positions& starts = is_source ? source_.positions : target_.positions;
    if (!wrapped.pointwise)
        wrapped.pointwise.emplace(
            OrientedPoints{starts, {}}, OrientedPoints{*wrapped.ends, {}}, [&](double at) {
                return OrientedPoints{along_path(is_source, at, progress), {}};
            });
    const Values times = vertex_times(is_source, is_source ? share : 1.0 - share);
    return wrapped.pointwise->at(is_source ? times : Values(1.0 - times.array())).positions;
}

/// One of the target is at the mean time of its pairs.
Values Morph::vertex_times(bool of_source, double t) const {
    if (delays_.size() == 0)
        return Values::Constant(of_source ? source_.size() : target_.size(), t);
    Values times = Values::Zero(of_source ? source_.size() : target_.size());
    if (of_source) {
        for (Eigen::Index i = 0; i < times.size(); ++i)
            times[i] = local_time(t, delays_[i], options_.stagger);
        return times;
    }
    const Values by_pair = pair_times(t);
    Values count = Values::Zero(times.size());
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
        times[pairs_[i].target] += by_pair[static_cast<Eigen::Index>(i)];
        count[pairs_[i].target] += 1.0;
    }
    return times.array() / count.array();
}

/// The time of each pair while that of the whole is t.
Values Morph::pair_times(double t) const {
    Values times(static_cast<Eigen::Index>(pairs_.size()));
    for (std::size_t i = 0; i < pairs_.size(); ++i)
        times[static_cast<Eigen::Index>(i)] =
            local_time(t, delays_[pairs_[i].source], options_.stagger);
    return times;
}

DenserMesh Morph::denser(bool of_source, const DensityOptions& options, Progress& progress) const {
    const WrappedSides sides = wrapped_sides(of_source);
    const ThreadCount threads(options_.threads);
    progress.enter("wrapping");
    DenserMesh result =
        denser_mesh(sides.source, sides.target, sides.pinned, options_.wrapping, options, progress);
    progress.finish();
    return result;
}

Positions Morph::wrapped(double t, Progress& progress) const {
    return on_the_way(true, t, progress);
}

Positions Morph::wrapped_target(double t, Progress& progress) const {
    return on_the_way(false, 1.0 - t, progress);
}

template <class Scalar>
const StraightPath<Scalar>& Morph::straight_path() const {
    const std::scoped_lock lock(caches_->paths_mutex);
    auto& path = [this]() -> std::optional<StraightPath<Scalar>>& {
        if constexpr (std::is_same_v<Scalar, float>)
            return caches_->single_path;
        else
            return caches_->double_path;
    }();
    if (!path) path.emplace(source_, target_, pairs_);
    return *path;
}

template const StraightPath<float>& Morph::straight_path<float>() const;
template const StraightPath<double>& Morph::straight_path<double>() const;

void Morph::lay_out_paths(Progress& progress) const {
    for (const auto& leg : legs_) leg->lay_out_paths(progress);
    if (options_.path_kind() == PathKind::kLinear || !legs_.empty()) return;
    const ThreadCount threads(options_.threads);
    const std::scoped_lock lock(caches_->paths_mutex);
    if (caches_->source_motion) return;
    Positions own_images, own_back;
    const Positions& images = images_of(true, own_images, progress);
    const Positions& back = images_of(false, own_back, progress);
    progress.enter("motion");
    GradualSimilarity similarity;
    std::array<Normals, 2> normals;
    parallel_invoke(3, [&](int k, bool) {
        if (k == 0)  // takes as long as both others
            similarity = whole_motion(source_.positions, images, target_.positions);
        else
            normals[to_size(k - 1)] = (k == 1 ? source_ : target_).normals.rowwise().normalized();
    });
    auto [forth, reverse] =
        Motion::both_ways({source_.positions, normals[0], images, similarity,
                           caches_->source_ground.taken(normals[0])},
                          {target_.positions, normals[1], back, similarity.reversed(),
                           caches_->target_ground.taken(normals[1])},
                          options_.path_kind(), progress);
    caches_->target_motion.emplace(std::move(reverse));
    caches_->source_motion.emplace(std::move(forth));
    progress.finish();
}

template <class Scalar>
void Morph::frame(double t, const FrameView<Scalar>& out) const {
    const ThreadCount threads(options_.threads);
    const bool at_end = t == 0.0 || t == 1.0;
    if (!legs_.empty() && t > 0.0 && t < 1.0) {
        chained_frame<Scalar>(t, out);
        return;
    }
    if (delays_.size() > 0 && t > 0.0 && t < 1.0) {
        frame_at<Scalar>(pair_times(t), out);
        return;
    }
    if (at_end || options_.path_kind() == PathKind::kLinear ||
        (out.positions.empty() && out.normals.empty())) {
        straight_path<Scalar>().frame(t, out);
        return;
    }
    check_frame(to_index(pairs_.size()), out);
    // It also refuses places that a float can't hold.
    if (std::is_same_v<Scalar, float> || !out.colors.empty() || !out.radii.empty())
        straight_path<Scalar>().frame(t, {{}, {}, out.colors, out.radii});
    Progress silent;
    lay_out_paths(silent);
    const Caches::LentMidway midway(*caches_, t);
    fade(*midway, pairs_, t, out.positions, out.normals);
}

Positions Morph::source_at(double t, Progress& progress) const {
    if (!(t >= 0.0 && t <= 1.0))
        throw OptionError("t", "a number from 0 to 1", std::to_string(t),
                          "Choose a value from that range.");
    if (!legs_.empty())
        throw CloudError(source_.name, "one morph", "a chain of several",
                         "Ask the morphs that it was made of.");
    if (t == 0.0) return source_.positions;
    if (t == 1.0) return source_to_target(progress);
    if (options_.path_kind() == PathKind::kLinear)
        return (1.0 - t) * source_.positions + t * source_to_target(progress);
    lay_out_paths(progress);
    const ThreadCount threads(options_.threads);
    const Caches::LentMidway midway(*caches_, t);
    return as_arrays((*midway).source).positions;
}

/// With pairs that needn't be at the same time.
template <class Scalar>
void Morph::frame_at(const Values& times, const FrameView<Scalar>& out) const {
    straight_path<Scalar>().frame({times.data(), to_size(times.size())}, out);
    if (options_.path_kind() == PathKind::kLinear) return;
    if (out.positions.empty() && out.normals.empty()) return;

    const OrientedPoints cloud = pointwise_path().at(times);
    const auto put = [](const auto& rows, std::span<Scalar> to) {
        if (to.empty()) return;
        using Rows = Eigen::Matrix<Scalar, Eigen::Dynamic, 3, Eigen::RowMajor>;
        Eigen::Map<Rows>(to.data(), rows.rows(), 3) = rows.template cast<Scalar>();
    };
    put(cloud.positions, out.positions);
    put(cloud.normals, out.normals);
}

/// Of several morphs in a row, between the ends: each pair is in one of them.
template <class Scalar>
void Morph::chained_frame(double t, const FrameView<Scalar>& out) const {
    const auto rows = static_cast<Eigen::Index>(pairs_.size());
    const auto count = static_cast<double>(legs_.size());
    const Values along =
        count * (delays_.size() > 0 ? pair_times(t) : Values(Values::Constant(rows, t)));
    std::vector<Scalar> positions(out.positions.size()), normals(out.normals.size()),
        colors(out.colors.size()), radii(out.radii.size());
    for (std::size_t leg = 0; leg < legs_.size(); ++leg) {
        const Values times = (along.array() - static_cast<double>(leg)).min(1.0).max(0.0);
        const auto is_in = [&](Eigen::Index pair) {
            return std::min(static_cast<std::size_t>(along[pair]), legs_.size() - 1) == leg;
        };
        legs_[leg]->frame_at<Scalar>(times, {positions, normals, colors, radii});
        const auto put = [&](const std::vector<Scalar>& from, std::span<Scalar> to) {
            const std::size_t width = from.size() / pairs_.size();
            for (Eigen::Index pair = 0; pair < rows; ++pair)
                if (is_in(pair))
                    std::copy_n(from.data() + width * to_size(pair), width,
                                to.data() + width * to_size(pair));
        };
        put(positions, out.positions);
        put(normals, out.normals);
        put(colors, out.colors);
        put(radii, out.radii);
    }
}

/// The pairs' way, for times of their own; laid out when first asked for.
const PointwisePath& Morph::pointwise_path() const {
    Progress silent;
    lay_out_paths(silent);
    const std::scoped_lock lock(caches_->paths_mutex);
    if (!caches_->pointwise) {
        const auto ends = [this](const Cloud& cloud, Index IndexPair::*side) {
            std::vector<Index> rows(pairs_.size());
            std::ranges::transform(pairs_, rows.begin(), side);
            return OrientedPoints{gather(cloud.positions, rows), gather(cloud.normals, rows)};
        };
        caches_->pointwise.emplace(
            ends(source_, &IndexPair::source), ends(target_, &IndexPair::target), [this](double t) {
                const auto rows = static_cast<Eigen::Index>(pairs_.size());
                OrientedPoints cloud{Positions(rows, 3), Normals(rows, 3)};
                const Caches::LentMidway midway(*caches_, t);
                fade<double>(*midway, pairs_, t, span_of(cloud.positions), span_of(cloud.normals));
                return cloud;
            });
    }
    return *caches_->pointwise;
}

template void Morph::frame<float>(double, const FrameView<float>&) const;
template void Morph::frame<double>(double, const FrameView<double>&) const;

const Resampling& Morph::resampling(Progress& progress) const {
    const std::scoped_lock lock(caches_->resampling_mutex);
    auto& resampling = caches_->resampling;
    if (!resampling) {
        lay_out_paths(progress);
        const ThreadCount threads(options_.threads);
        progress.enter("resampling");
        const auto frame_at = [this](double t) {
            const auto rows = static_cast<Eigen::Index>(pairs_.size());
            OrientedPoints cloud{Positions(rows, 3), Normals(rows, 3)};
            frame<double>(t, {span_of(cloud.positions), span_of(cloud.normals), {}, {}});
            return cloud;
        };
        static_assert(Resampling::kNeighbors == kNeighborsToMeasure);
        constexpr std::array kShares = {0.0, 0.1, 0.2, 1.0};  // of the time
        std::array<const OrderedNeighbors*, 2> known;
        for (const std::size_t k : {0U, 1U}) {
            const Progress::Part part(progress, kShares[k], kShares[k + 1]);
            known[k] = &neighbors(k == 0, progress);
        }
        const Progress::Part part(progress, kShares[2], kShares[3]);
        resampling.emplace(Resampling::End(source_, known[0]), Resampling::End(target_, known[1]),
                           pairs_, frame_at, options_.resampling, progress);
        progress.finish();
    }
    return *resampling;
}

/// Change of the pairs' places with t.
Positions Morph::velocities(double t) const {
    const auto rows = static_cast<Eigen::Index>(pairs_.size());
    Positions before(rows, 3), after(rows, 3);
    // On straight paths the whole way; else a piece short enough, from where the frame is, but not
    // from the ends themselves, whose own numbers differ from the path's by rounding.
    const bool straight =
        options_.path_kind() == PathKind::kLinear && delays_.size() == 0 && legs_.empty();
    constexpr double kStep = 1e-5, kInside = 1e-6;
    const double first = straight ? 0.0 : std::clamp(t, kInside, 1.0 - kInside);
    const double last = straight ? 1.0 : first + (first < 0.5 ? kStep : -kStep);
    frame<double>(first, {span_of(before), {}, {}, {}});
    frame<double>(last, {span_of(after), {}, {}, {}});
    return (after - before) / (last - first);
}

template <class Scalar>
ResampledFrame<Scalar> Morph::resampled_frame(double t, Progress& progress) const {
    const Resampling& resampling = this->resampling(progress);
    const ThreadCount threads(options_.threads);
    const std::size_t pairs = pairs_.size();
    ResampledFrame<Scalar> result;
    const auto make_room = [&](std::vector<Scalar>& numbers, std::size_t width) {
        numbers.reserve(width * (pairs + resampling.points().size()));  // so it needn't move later
        numbers.resize(width * pairs);
    };
    make_room(result.positions, 3);
    make_room(result.normals, 3);
    make_room(result.colors, 4);
    make_room(result.radii, 1);
    make_room(result.velocities, 3);
    frame<Scalar>(t, {result.positions, result.normals, result.colors, result.radii});

    progress.enter("resampled frame");
    insert_points(result, t, progress);
    if (!resampling.hidden().empty()) hide(resampling.pair_shares(t), result);
    progress.finish();
    return result;
}

/// Adds velocities and ids to a frame's pairs, and the points that live at t.
template <class Scalar>
void Morph::insert_points(ResampledFrame<Scalar>& frame, double t, Progress& progress) const {
    const Resampling& resampling = *caches_->resampling;
    const std::size_t pairs = pairs_.size();
    using Rows = Eigen::Matrix<Scalar, Eigen::Dynamic, 3, Eigen::RowMajor>;
    const auto rows = static_cast<Eigen::Index>(pairs);
    frame.ids.resize(pairs);
    std::iota(frame.ids.begin(), frame.ids.end(), 0);

    OrientedPoints cloud{
        Eigen::Map<const Rows>(frame.positions.data(), rows, 3).template cast<double>(),
        Eigen::Map<const Rows>(frame.normals.data(), rows, 3).template cast<double>()};
    cloud.normals.rowwise().normalize();  // at the ends they have the length that was given
    Positions velocities;
    const Resampling::Alive alive = resampling.at(t, cloud, progress, [&] {
        velocities = this->velocities(t);
        Eigen::Map<Rows>(frame.velocities.data(), rows, 3) = velocities.template cast<Scalar>();
    });
    const std::size_t count = pairs + alive.ids.size();
    frame.positions.resize(3 * count);
    frame.normals.resize(3 * count);
    frame.colors.resize(4 * count);
    frame.radii.resize(count);
    frame.velocities.resize(3 * count);
    frame.ids.resize(count);
    parallel_for(to_index(alive.ids.size()), progress, [&](Index begin, Index end) {
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            const InsertedPoint& point = resampling.points()[to_size(alive.ids[i])];
            const auto row = static_cast<Eigen::Index>(i);
            const std::size_t to = pairs + i;
            const auto mean = [&](auto&& value) {
                double sum = 0.0;
                for (std::size_t c = 0; c < 3; ++c)
                    sum += point.weights[c] * static_cast<double>(value(to_size(point.pairs[c])));
                return sum;
            };
            for (std::size_t d = 0; d < 3; ++d) {
                const auto axis = static_cast<Eigen::Index>(d);
                frame.positions[3 * to + d] = static_cast<Scalar>(alive.positions(row, axis));
                frame.normals[3 * to + d] = static_cast<Scalar>(alive.normals(row, axis));
                frame.velocities[3 * to + d] = static_cast<Scalar>(mean([&](std::size_t pair) {
                    return velocities(static_cast<Eigen::Index>(pair), axis);
                }));
            }
            for (std::size_t d = 0; d < 4; ++d)
                frame.colors[4 * to + d] = static_cast<Scalar>(
                    mean([&](std::size_t pair) { return frame.colors[4 * pair + d]; }));
            frame.radii[to] = static_cast<Scalar>(
                alive.share[row] * mean([&](std::size_t pair) { return frame.radii[pair]; }));
            frame.ids[to] = to_index(pairs) + alive.ids[i];
        }
    });
}

template ResampledFrame<float> Morph::resampled_frame<float>(double, Progress&) const;
template ResampledFrame<double> Morph::resampled_frame<double>(double, Progress&) const;

}  // namespace pointmorph
