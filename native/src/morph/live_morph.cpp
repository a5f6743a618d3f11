#include "pointmorph/morph/live_morph.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "morph/found_map.hpp"
#include "morph/input_checks.hpp"
#include "morph/mesh_side.hpp"
#include "morph/prepared_shape.hpp"
#include "morph/product_route.hpp"
#include "morph/routes.hpp"
#include "morph/words.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/components.hpp"
#include "pointmorph/registration/live_map.hpp"
#include "registration/pinning.hpp"

namespace pointmorph {

namespace {

using Clock = std::chrono::steady_clock;

void check_can_be_bent(const MorphInput& input, const MorphOptions& options) {
    if (options.method != Method::kAuto)
        throw OptionError("method", "auto, since only its maps can be updated", "paper",
                          "Use method auto, or compute the morph again.");
    if (options.domain != Domain::kAuto)
        throw OptionError("domain", "auto, since only its maps can be updated", "another domain",
                          "Use domain auto, or compute the morph again.");
    check_shapes(input, options);
    check_start(input.start, input.source, input.target);
    if (input.start.source_images.rows() == 0)
        throw CloudError("start", "the maps of the morph to update", "none",
                         "Compute the morph first.");
}

bool is_same(const Feature& a, const Feature& b) {
    return a.kind == b.kind && a.source.rows == b.source.rows && a.target.rows == b.target.rows &&
           a.source.weights == b.source.weights && a.target.weights == b.target.weights &&
           a.closed == b.closed && a.hard == b.hard && (a.hard || a.weight == b.weight);
}

bool has_all(const std::vector<Feature>& a, const std::vector<Feature>& b) {
    return std::ranges::all_of(b, [&](const Feature& feature) {
        return std::ranges::any_of(a, [&](const Feature& f) { return is_same(feature, f); });
    });
}

/// In any order.
bool are_same(const std::vector<Feature>& a, const std::vector<Feature>& b) {
    return a.size() == b.size() && has_all(a, b) && has_all(b, a);
}

/// What is known of a map that nobody has judged.
Diagnostics unjudged() {
    Diagnostics unknown;
    unknown.confidence = std::numeric_limits<double>::quiet_NaN();
    return unknown;
}

/// A surface as tangent planes at samples: all, or every so many, which is enough for how high
/// places lie above it that were on it before.
class TangentPlanes {
public:
    explicit TangentPlanes(const PreparedShape& shape)
        : places_(gather(shape.positions, some_of(shape.size()))),
          normals_(gather(shape.normals, some_of(shape.size()))),
          tree_(places_) {}
    TangentPlanes(const TangentPlanes&) = delete;
    TangentPlanes& operator=(const TangentPlanes&) = delete;

    struct Height {
        double above;
        Eigen::RowVector3d normal;
    };

    /// How far a place lies above the plane of its nearest sample.
    Height height(const Eigen::RowVector3d& place) const {
        Index nearest = 0;
        double squared = 0.0;
        tree_.nearest(place.data(), {&nearest, 1}, {&squared, 1});
        const Eigen::RowVector3d normal = normals_.row(nearest);
        return {normal.dot(place - tree_.points().row(nearest)), normal};
    }

private:
    /// In spatial order, so that they are spread evenly.
    static std::vector<Index> some_of(Index count) {
        constexpr Index kMost = 25000;
        const Index step = std::max<Index>(1, count / kMost);
        std::vector<Index> rows;
        for (Index i = 0; i < count; i += step) rows.push_back(i);
        return rows;
    }

    Positions places_;
    Normals normals_;
    KdTree<3> tree_;
};

struct BothClouds {
    const Cloud &source, &target;
    double spacing;  ///< of the source's samples
};

/// Where a hard point is to go, and how far around it others go along.
struct HardMark {
    Eigen::RowVector3d place, offset;
    double squared_reach;
};

/// How far marks take a place: by the offset of the nearest, where they are close to each other
/// (Shepard's interpolation), fading out around them.
Eigen::RowVector3d shift_by(const std::vector<HardMark>& marks, const Eigen::RowVector3d& place) {
    constexpr double kFloor = 1e-9;
    Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
    double weights = 0.0, largest = 0.0;
    for (const HardMark& mark : marks) {
        const double ratio = (place - mark.place).squaredNorm() / mark.squared_reach;
        if (ratio >= 1.0) continue;
        const double fade = (1.0 - ratio) * (1.0 - ratio), weight = fade / (ratio + kFloor);
        sum += weight * mark.offset;
        weights += weight;
        largest = std::max(largest, fade);
    }
    if (!(weights > 0.0)) return Eigen::RowVector3d::Zero();
    return largest / weights * sum;
}

/// Images so moved that hard points meet exactly, each with as much around it as it has to go.
Positions met(Positions images, const BothClouds& clouds, const std::vector<Feature>& features,
              Progress& progress) {
    constexpr double kReach = 6.0;
    constexpr double kSlope = 0.5;  // of the offset, so that nothing folds
    const Positions &from = clouds.source.positions, &onto = clouds.target.positions;
    std::vector<IndexPair> pairs = pinned_pairs(features);
    std::ranges::sort(pairs);  // sums are the same for any order of the features
    std::vector<HardMark> marks;
    for (const IndexPair& pair : pairs) {
        const Eigen::RowVector3d offset = onto.row(pair.target) - images.row(pair.source);
        const double reach = kReach * std::max(clouds.spacing, kSlope * offset.norm());
        marks.push_back({from.row(pair.source), offset, reach * reach});
    }
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) images.row(i) += shift_by(marks, from.row(i));
    });
    for (const IndexPair& pair : pairs) images.row(pair.source) = onto.row(pair.target);
    return images;
}

}  // namespace

struct LiveMorph::State {
    MorphOptions options;
    MorphInput input;                        ///< with the map as its start
    std::shared_ptr<const MeshSides> sides;  ///< null where both clouds are bare
    Cloud source, target;                    ///< samples of faces, or the clouds
    PreparedShapes shapes;
    std::optional<ComponentGroups> groups{};  ///< where there are several components
    std::optional<LiveMap> map{};
    RefinementStart offsets{};  ///< of vertices from where samples carry them
    std::optional<FollowingPoints> points{};
    std::optional<TangentPlanes> planes{};  ///< of the target
    Values heights{};                       ///< of images above these
    Diagnostics judged{};                   ///< what is known of the map, in given rows
    std::vector<std::string> warnings{};    ///< of the shapes, whatever is marked
    Diagnostics found_loose{};              ///< pieces that these tell of, unless `judged` has them
    double spacing = 0.0;                   ///< of the source's samples

    std::vector<Feature> sorted(const std::vector<Feature>& features) const;
    void find_groups(const RefinementStart& start, Progress& progress);
    void find_offsets(const RefinementStart& start, Progress& progress);
    void follow(Progress& progress);
    Refinement apart(Refinement found, const std::vector<Feature>& features,
                     Progress& progress) const;
    bool joins_groups(const std::vector<Feature>& features) const;
    MorphInput input_with(std::vector<Feature> features) const;
    Morph from_scratch(std::vector<Feature> features, const std::string& why,
                       Progress& progress) const;
    FoundMap found(MorphInput changed, Refinement refined, Clock::time_point began) const;
};

/// In canonical order and rows of the prepared shapes.
std::vector<Feature> LiveMorph::State::sorted(const std::vector<Feature>& features) const {
    std::vector<Feature> here = features;
    for (Feature& feature : here) {
        if (sides && sides->source)
            feature.source = sides->source->sampled(feature, feature.source);
        if (sides && sides->target)
            feature.target = sides->target->sampled(feature, feature.target);
    }
    std::vector<Feature> result =
        canonical(here, shapes.source.sorted_rows, shapes.target.sorted_rows);
    // Marks next to each other may have the same sample.
    if (!sides) check_places(result, shapes.source, shapes.target);
    return result;
}

void LiveMorph::State::find_groups(const RefinementStart& start, Progress& progress) {
    const PreparedShape &s = shapes.source, &t = shapes.target;
    if (s.topology.main().size() == 1 && t.topology.main().size() == 1) return;
    const ComponentView source_view{s.topology, s.positions, s.normals, start.source_images},
        target_view{t.topology, t.positions, t.normals, start.target_images};
    const Similarity alignment = fit_similarity(t.positions, start.target_images);
    ComponentMatching matching =
        match_components(source_view, target_view, joining_marks(sorted(input.features)), alignment,
                         options.components, progress);
    if (matching.matched.empty()) return;
    match_rest(matching, source_view, target_view, alignment, options.components, progress);
    groups = group_components(source_view, target_view, matching, options.components, progress);
    for (std::string& words :
         components_in_words(matching, *groups, {s.topology, s.name}, {t.topology, t.name}))
        warnings.push_back(std::move(words));
    found_loose.source_loose = groups->source.loose;
    found_loose.target_loose = groups->target.loose;
}

void LiveMorph::State::find_offsets(const RefinementStart& start, Progress& progress) {
    if (!sides) return;
    const auto carried = [&](const std::optional<MeshSide>& side, const PreparedShape& here,
                             const PreparedShape& there, const Positions& given,
                             const Positions& sorted_images) -> Positions {
        if (!side) return Positions::Zero(given.rows(), 3);
        const Positions of_samples = there.unit.restore(gather(sorted_images, here.sorted_rows));
        return given - side->images(of_samples, progress);
    };
    offsets = {carried(sides->source, shapes.source, shapes.target, input.start.source_images,
                       start.source_images),
               carried(sides->target, shapes.target, shapes.source, input.start.target_images,
                       start.target_images)};
}

/// Makes the source's points follow.
void LiveMorph::State::follow(Progress& progress) {
    const PreparedShape &s = shapes.source, &t = shapes.target;
    Normals normals = gather(s.normals, s.sorted_rows);
    if (sides && sides->source) {
        normals = sides->source->completed(input.source).normals;
        normals.rowwise().normalize();
        spacing = sides->source->spacing();
    } else {
        spacing = s.unit.scale * local_spacing(s.positions, s.nearest).mean();
    }
    points = map->follow(s.unit.apply(input.source.positions), normals, progress);
    planes.emplace(t);
    const Positions images = t.unit.apply(input.start.source_images);
    heights.resize(images.rows());
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) heights[i] = planes->height(images.row(i)).above;
    });
}

LiveMorph::LiveMorph(MorphInput input, const MorphOptions& options, const Morph* judged,
                     Progress& progress) {
    const ThreadCount threads(options.threads);
    progress.enter("cloud");
    check_can_be_bent(input, options);
    auto state = std::make_unique<State>();
    state->options = options;
    MeshSides sides = mesh_sides(input, options, progress);
    MorphInput sampled;
    if (sides.any()) {
        state->warnings = turned_faces(input, sides);
        sampled = sampled_input(input, sides);
        state->sides = std::make_shared<const MeshSides>(std::move(sides));
    } else {
        sampled = input;
    }
    state->shapes = prepare_both(sampled, preparation(options), progress);
    for (std::string& words : preparation_warnings(state->shapes, true))
        state->warnings.push_back(std::move(words));
    if (!sampled.source_counts.empty())
        for (std::string& words : handle_warnings(state->shapes))
            state->warnings.push_back(std::move(words));
    const RefinementStart start = *earlier_map(state->shapes, sampled);
    state->source = std::move(sampled.source);
    state->target = std::move(sampled.target);
    state->input = std::move(input);
    state->find_groups(start, progress);
    const PreparedShapes& shapes = state->shapes;
    state->map.emplace(
        RefinementCloud{shapes.source.positions, shapes.source.normals, &shapes.source.nearest},
        RefinementCloud{shapes.target.positions, shapes.target.normals, &shapes.target.nearest},
        state->sorted(state->input.features), start, options.refinement, progress);
    progress.enter("vertices");
    state->find_offsets(start, progress);
    state->follow(progress);
    state->judged = judged ? judged->report_.diagnostics : unjudged();
    // The morph's clouds are as it has made them: only it knows what was amiss with them.
    if (judged) {
        state->warnings = judged->warnings_of_shapes();
        state->found_loose = {};
    }
    progress.finish();
    state_ = std::move(state);
}

LiveMorph::LiveMorph(MorphInput input, const MorphOptions& options, Progress& progress)
    : LiveMorph(std::move(input), options, nullptr, progress) {}

LiveMorph::LiveMorph(const Morph& morph, Progress& progress)
    : LiveMorph(morph.input(), morph.options(), &morph, progress) {}

LiveMorph::~LiveMorph() = default;
LiveMorph::LiveMorph(LiveMorph&&) noexcept = default;

MorphInput LiveMorph::State::input_with(std::vector<Feature> features) const {
    MorphInput changed = input;
    changed.features = std::move(features);
    return changed;
}

Positions LiveMorph::source_to_target(const std::vector<Feature>& features,
                                      Progress& progress) const {
    const State& state = *state_;
    const ThreadCount threads(state.options.threads);
    const Positions& before = state.input.start.source_images;
    validate(features, state.input.source, state.input.target);
    if (are_same(features, state.input.features)) return before;
    const Positions shifts = state.map->shifts(*state.points, state.sorted(features), progress);
    const Normalization& unit = state.shapes.target.unit;
    progress.enter("landing");
    constexpr double kHardly = 1e-3;  // in √area, about
    Positions images = before;
    // Not lifted off the surface by the shift: as high above it as before.
    parallel_for(to_index(images.rows()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            if (shifts.row(i).norm() < kHardly) {
                images.row(i) += unit.scale * shifts.row(i);
                continue;
            }
            const Eigen::RowVector3d place =
                (before.row(i) - unit.center.transpose()) / unit.scale + shifts.row(i);
            const auto [height, normal] = state.planes->height(place);
            images.row(i) += unit.scale * (shifts.row(i) + (state.heights[i] - height) * normal);
        }
    });
    images = met(std::move(images), {state.input.source, state.input.target, state.spacing},
                 features, progress);
    progress.finish();
    return images;
}

Morph LiveMorph::State::from_scratch(std::vector<Feature> features, const std::string& why,
                                     Progress& progress) const {
    MorphInput changed = input_with(std::move(features));
    changed.start = {};
    return {std::move(changed), options, progress, why};
}

/// The components of the shapes kept apart.
Refinement LiveMorph::State::apart(Refinement found, const std::vector<Feature>& features,
                                   Progress& progress) const {
    if (!groups) return found;
    const PreparedShape &s = shapes.source, &t = shapes.target;
    const RefinementStart images{found.source_images, found.target_images};
    return kept_apart(std::move(found), {s.topology, s.positions, s.normals, images.source_images},
                      {t.topology, t.positions, t.normals, images.target_images},
                      {*groups, features}, progress);
}

/// Whether a mark asks for another match of the components.
bool LiveMorph::State::joins_groups(const std::vector<Feature>& features) const {
    if (!groups) return false;
    return std::ranges::any_of(joining_marks(features), [&](const IndexPair& mark) {
        return groups->source.groups[to_size(mark.source)] !=
               groups->target.groups[to_size(mark.target)];
    });
}

FoundMap LiveMorph::State::found(MorphInput changed, Refinement refined,
                                 Clock::time_point began) const {
    RouteResult result;
    result.domain = "product";
    result.source_domain = refined.source_product;
    result.target_domain = refined.target_product;
    result.pairs = std::move(refined.pairs);
    result.images = {std::move(refined.source_images), std::move(refined.target_images)};
    result.facts.diagnostics = std::move(refined.diagnostics);
    result.facts.diagnostics.source_loose = found_loose.source_loose;
    result.facts.diagnostics.target_loose = found_loose.target_loose;
    result.warnings = warnings;
    judge_normals(refined.inside_out, shapes.source, shapes.target, result);
    PreparedShapes outward = shapes;
    reverse_normals(outward, result);
    const bool is_same_map = are_same(changed.features, input.features);
    return {.input = std::move(changed),
            .source = source,
            .target = target,
            .correspondence = {std::move(outward), std::move(result)},
            .sides = sides,
            .offsets = offsets,
            .judged = judged,
            .images = is_same_map ? input.start : RefinementStart{},
            .began = began};
}

Morph LiveMorph::updated(std::vector<Feature> features, Progress& progress) const {
    const State& state = *state_;
    const ThreadCount threads(state.options.threads);
    const auto began = Clock::now();
    validate(features, state.input.source, state.input.target);
    const std::vector<Feature> marked = state.sorted(features);
    const FarFeature far = state.map->farthest(marked);
    if (far.distance > state.options.refinement.trusted_distance)
        return state.from_scratch(std::move(features), mark_went_far(far.name, far.distance),
                                  progress);
    if (state.joins_groups(marked))
        return state.from_scratch(std::move(features), marks_join_other_parts(), progress);
    LiveUpdate update = state.map->updated(marked, progress);
    if (update.newly_torn > state.options.refinement.registration.most_torn)
        return state.from_scratch(std::move(features), update_would_tear(), progress);
    return {state.found(state.input_with(std::move(features)),
                        state.apart(std::move(update.refinement), marked, progress), began),
            state.options, progress};
}

}  // namespace pointmorph
