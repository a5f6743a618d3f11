#include "pointmorph/morph/options.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "pointmorph/base/error.hpp"

namespace pointmorph {

namespace {

std::string range_of(const Option& option) {
    if (option.kind == Option::Kind::kChoice) {
        std::string all;
        for (const auto& choice : option.choices) all += (all.empty() ? "" : ", ") + choice;
        return "one of " + all;
    }
    return std::string(option.kind == Option::Kind::kInteger ? "a whole number" : "a number") +
           " from " + in_short(option.minimum) + " to " + in_short(option.maximum);
}

template <class T>
struct Unwrapped {
    using Type = T;
};
template <class T>
struct Unwrapped<std::optional<T>> {
    using Type = T;
};

/// A number. `field` returns a reference to the member of MorphOptions; a std::optional is
/// automatic while it's empty.
template <class Field>
Option number(Field field, Option option) {
    using Member = std::remove_cvref_t<decltype(field(std::declval<MorphOptions&>()))>;
    using Number = typename Unwrapped<Member>::Type;
    constexpr bool kOptional = !std::is_same_v<Member, Number>;
    constexpr bool kInteger = std::is_integral_v<Number>;

    option.kind = kInteger ? Option::Kind::kInteger : Option::Kind::kNumber;
    option.get = [field](const MorphOptions& options) -> OptionValue {
        const auto& member = field(const_cast<MorphOptions&>(options));
        const auto wrapped = [](Number value) -> OptionValue {
            if constexpr (kInteger)
                return static_cast<std::int64_t>(value);
            else
                return static_cast<double>(value);
        };
        if constexpr (kOptional)
            return member ? wrapped(*member) : OptionValue{};
        else
            return wrapped(member);
    };
    option.set = [field](MorphOptions& options, const OptionValue& value) {
        auto& member = field(options);
        if (const auto* whole = std::get_if<std::int64_t>(&value))
            member = static_cast<Number>(*whole);
        else if (const auto* real = std::get_if<double>(&value))
            member = static_cast<Number>(*real);
        else if constexpr (kOptional)
            member.reset();
    };
    return option;
}

/// A choice among the values of an enumeration, in their order. Of a std::optional the first word
/// stands for none.
template <class Field>
Option choice(Field field, Option option) {
    using Member = std::remove_cvref_t<decltype(field(std::declval<MorphOptions&>()))>;
    using Enum = typename Unwrapped<Member>::Type;
    constexpr bool kOptional = !std::is_same_v<Member, Enum>;
    option.kind = Option::Kind::kChoice;
    option.get = [field, choices = option.choices](const MorphOptions& options) -> OptionValue {
        const auto& member = field(const_cast<MorphOptions&>(options));
        if constexpr (kOptional)
            return member ? choices[to_size(*member) + 1] : choices.front();
        else
            return choices[to_size(member)];
    };
    option.set = [field, choices = option.choices](MorphOptions& options,
                                                   const OptionValue& value) {
        const auto found =
            std::ranges::find(choices, std::get<std::string>(value)) - choices.begin();
        if constexpr (kOptional) {
            field(options).reset();
            if (found > 0) field(options) = static_cast<Enum>(found - 1);
        } else {
            field(options) = static_cast<Enum>(found);
        }
    };
    return option;
}

#define POINTMORPH_FIELD(member)    \
    [](MorphOptions & o) -> auto& { \
        return o.member;            \
    }

/// One row an option: its field, and what the user has to know. The binding, the command line,
/// Blender's panel, docs/options.md, the check of ranges, and what makes a morph stale follow.
const std::vector<Option> kTable{
    choice(POINTMORPH_FIELD(method),
           {.name = "method",
            .choices = {"auto", "paper"},
            .help = "How the match is found. auto deforms both models onto each other, nearly "
                    "rigidly, whatever their topology. paper is the published method"}),
    choice(POINTMORPH_FIELD(domain),
           {.name = "domain",
            .choices = {"auto", "disk", "cut", "sphere", "network"},
            .help = "The common domain that both models are mapped to. disk: open surfaces "
                    "with one boundary. cut: closed models, cut in two along a loop of features "
                    "(without a loop, through the features on tips). sphere: closed models "
                    "without handles, not cut. network: closed models of any kind, cut into "
                    "patches by curves between all features. auto: chosen by method and models. "
                    "With method auto, the refinement starts from this domain"}),
    number(POINTMORPH_FIELD(threads),
           {.name = "threads",
            .minimum = 0,
            .maximum = 1024,
            .unit = "threads",
            .help = "Processor threads to use; 0 uses all. The result is the same for any "
                    "number",
            .affects = Option::Affects::kNothing}),
    number(POINTMORPH_FIELD(covariance_neighbors),
           {.name = "covariance_neighbors",
            .minimum = 8,
            .maximum = 64,
            .unit = "points",
            .help = "Nearest points from which normals and the boundary are estimated. Raise it "
                    "for noisy scans, lower it for thin or finely detailed models"}),
    number(POINTMORPH_FIELD(boundary.opening),
           {.name = "boundary_opening",
            .minimum = 1.2,
            .maximum = 10,
            .help = "How much wider than the usual gap between points an opening must be to "
                    "count as a boundary. Raise it if gaps in the sampling are mistaken for a "
                    "boundary, lower it if a boundary is missed"}),
    number(POINTMORPH_FIELD(boundary.min_loop),
           {.name = "boundary_min_loop",
            .minimum = 4,
            .maximum = 1e6,
            .unit = "spacings",
            .help = "Boundary loops shorter than this count as gaps in the sampling"}),
    choice(POINTMORPH_FIELD(parameterization.boundary_spacing),
           {.name = "boundary_spacing",
            .choices = {"uniform", "chord"},
            .help = "How boundary points are spread over the circle: evenly, or by the distance "
                    "between them. uniform suits boundaries that are sampled alike on both "
                    "models",
            .method = Method::kPaper}),
    choice(POINTMORPH_FIELD(parameterization.solve),
           {.name = "solve",
            .choices = {"full", "lod"},
            .help = "full solves the parameterization for all points, which is slow. lod solves it "
                    "for a simplified cloud and embeds all points in it",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(decomposition.extremities),
           {.name = "decomposition_tips",
            .minimum = 0,
            .maximum = 100,
            .unit = "tips",
            .help = "Maximum number of tips without features, such as ears or a tail, to find on "
                    "models that are cut and to match within the patches. 0 matches none",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(spherical_parameterization.nodes),
           {.name = "sphere_nodes",
            .minimum = 100,
            .maximum = 100000,
            .unit = "points",
            .help = "Roughly how many points of each model are triangulated and mapped to the "
                    "sphere. Raise it if thin limbs get lost, lower it for speed",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(parameterization.lod.max_cluster_size),
           {.name = "lod_cluster_size",
            .minimum = 1,
            .maximum = 1000,
            .unit = "points",
            .help = "Maximum number of points that one point of the simplified cloud stands for. "
                    "Smaller is finer and slower",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(parameterization.neighbors),
           {.name = "parameterization_neighbors",
            .minimum = 6,
            .maximum = 64,
            .unit = "points",
            .help = "Nearest points whose mean gives the position of an interior point in the "
                    "disk. Raise it if a patch falls apart",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(parameterization.radius),
           {.name = "parameterization_radius",
            .minimum = 1,
            .maximum = 20,
            .unit = "spacings",
            .help = "Use all points within this radius instead of the nearest ones, as the "
                    "paper does. Automatic: the nearest points",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(parameterization.tolerance),
           {.name = "solver_tolerance",
            .minimum = 1e-14,
            .maximum = 1e-3,
            .help = "Relative residual at which the solver stops",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(parameterization.max_iterations),
           {.name = "solver_max_iterations",
            .minimum = 1,
            .maximum = 1e7,
            .unit = "iterations",
            .help = "The solver gives up after this many iterations",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(alignment.error),
           {.name = "alignment_error",
            .minimum = 1e-6,
            .maximum = 1,
            .unit = "spacings",
            .help = "How close two features must come in the disk, in spacings of the points "
                    "around them",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(alignment.influence),
           {.name = "influence",
            .minimum = 0.51,
            .maximum = 1000,
            .help = "Radius around a feature that moves with it, as a multiple of the distance "
                    "that the feature moves. Larger is smoother, smaller is more local",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(alignment.influence_radius),
           {.name = "influence_radius",
            .minimum = 1e-6,
            .maximum = 2,
            .unit = "disk radii",
            .help = "Influence as a fixed distance in the disk. Automatic: use the multiple",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(alignment.max_sweeps),
           {.name = "alignment_max_sweeps",
            .minimum = 1,
            .maximum = 1e6,
            .unit = "sweeps",
            .help = "Maximum number of times that each disk is warped",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(pairing.max_cluster_size),
           {.name = "pairing_cluster_size",
            .minimum = 2,
            .maximum = 1000,
            .unit = "points",
            .help = "Maximum number of points of either model in a cluster of the common domain "
                    "when points are paired",
            .method = Method::kPaper}),
    number(POINTMORPH_FIELD(transfer.neighbors),
           {.name = "transfer_neighbors",
            .minimum = 6,
            .maximum = 64,
            .unit = "points",
            .help = "Points over which the smooth map averages. Raise it for noisy scans",
            .method = Method::kPaper}),
    choice(POINTMORPH_FIELD(refinement.pose.up),
           {.name = "up",
            .choices = {"none", "x", "y", "z"},
            .help = "Which axis is up. Models that have little in common may face different ways, "
                    "but one isn't laid on its side, or turned upside down, to become the other. "
                    "none: they also face the same way",
            .method = Method::kAuto}),
    choice(POINTMORPH_FIELD(missing_parts),
           {.name = "missing_parts",
            .choices = {"leave", "stretch"},
            .help = "What happens where one model ends and the other goes on, such as a bust and a "
                    "whole figure. leave: what only the other has grows out of that border, or "
                    "shrinks into it. stretch: the one is stretched over all of the other, as a "
                    "flat sheet "
                    "is over what isn't flat in any case",
            .method = Method::kAuto}),
    choice(
        POINTMORPH_FIELD(path),
        {.name = "path",
         .choices = {"auto", "linear", "similarity", "rigid"},
         .help = "How points travel. linear: straight. similarity: the whole shape rotates and "
                 "scales, so a rotated target doesn't shrink midway. rigid: every part also "
                 "rotates, so a raised leg swings. auto: rigid, or linear with method paper. A "
                 "single baked shape key is straight; bake several steps to follow the other paths",
         .affects = Option::Affects::kPath}),
    choice(POINTMORPH_FIELD(stagger.kind),
           {.name = "stagger",
            .choices = {"none", "x", "y", "z", "noise", "delay"},
            .help = "Which points go first. x, y, z: those with the smallest coordinate. noise: "
                    "patches, in random order. delay: those with the smallest delay, a number from "
                    "0 to 1 for each point of the source. none: all move together",
            .affects = Option::Affects::kPath}),
    number(POINTMORPH_FIELD(stagger.overlap),
           {.name = "stagger_overlap",
            .minimum = 0.01,
            .maximum = 1,
            .help = "Share of the time that each point takes. 1: all move together. Small: one "
                    "after the other",
            .affects = Option::Affects::kPath}),
    number(POINTMORPH_FIELD(stagger.falloff),
           {.name = "stagger_falloff",
            .minimum = 0,
            .maximum = 1,
            .help = "0: each point goes at constant speed. 1: it starts and ends slowly",
            .affects = Option::Affects::kPath}),
    choice(POINTMORPH_FIELD(stagger.is_reversed), {.name = "stagger_order",
                                                   .choices = {"forward", "reverse"},
                                                   .help = "reverse: the last points go first",
                                                   .affects = Option::Affects::kPath}),
    number(POINTMORPH_FIELD(stagger.size),
           {.name = "stagger_size",
            .minimum = 0.001,
            .maximum = 10,
            .unit = "diagonals",
            .help =
                "Approximate size of the patches of noise, as a share of the source's bounding box",
            .affects = Option::Affects::kPath}),
    number(POINTMORPH_FIELD(stagger.seed), {.name = "stagger_seed",
                                            .minimum = 0,
                                            .maximum = 1000000,
                                            .help = "Another number gives another pattern",
                                            .affects = Option::Affects::kPath}),
    number(POINTMORPH_FIELD(wrapping.conform),
           {.name = "wrap_conform",
            .minimum = 0,
            .maximum = 1,
            .help = "How closely a wrapped mesh follows the other model. Lower it to keep more of "
                    "its own shape",
            .method = Method::kAuto}),
    number(POINTMORPH_FIELD(wrapping.relaxing),
           {.name = "wrap_relax",
            .minimum = 0,
            .maximum = 1000,
            .unit = "iterations",
            .help = "How often the vertices of a wrapped mesh slide along the other model, so that "
                    "its faces keep more of their own proportions. Raise it for even faces, at the "
                    "expense of details",
            .method = Method::kAuto}),
    number(POINTMORPH_FIELD(resampling.omega),
           {.name = "omega",
            .minimum = 0,
            .maximum = 2,
            .help = "Resampled frames get new points where the density falls below this share "
                    "of the density at both ends. 0 adds none, larger values add them earlier",
            .affects = Option::Affects::kFrames}),
    number(POINTMORPH_FIELD(resampling.spacing),
           {.name = "resample_spacing",
            .minimum = 0.25,
            .maximum = 4,
            .unit = "spacings",
            .help = "Distance between the new points of resampled frames. Lower it if frames "
                    "are drawn with smaller points",
            .affects = Option::Affects::kFrames}),
    number(POINTMORPH_FIELD(resampling.mls.degree),
           {.name = "mls_degree",
            .minimum = 1,
            .maximum = 4,
            .help = "Degree of the polynomials that define the surface for new points",
            .affects = Option::Affects::kFrames}),
    number(POINTMORPH_FIELD(resampling.mls.scale),
           {.name = "mls_scale",
            .minimum = 0.5,
            .maximum = 10,
            .unit = "spacings",
            .help = "How far the surface for new points averages over nearby points. Raise it for "
                    "noisy scans. Automatic: 0.9 + degree / 5",
            .affects = Option::Affects::kFrames}),
    number(POINTMORPH_FIELD(resampling.mls.width),
           {.name = "mls_width",
            .minimum = 1e-9,
            .maximum = 1e9,
            .unit = "model units",
            .help = "How far the surface averages, as a fixed distance. Automatic: use the "
                    "multiple of the spacing",
            .affects = Option::Affects::kFrames}),
    number(POINTMORPH_FIELD(resampling.crowding),
           {.name = "crowding",
            .minimum = 1.5,
            .maximum = 100,
            .help = "Resampled frames leave out points where the density exceeds that of either "
                    "end by this factor. Automatic: keep all",
            .affects = Option::Affects::kFrames}),
};

#undef POINTMORPH_FIELD

}  // namespace

const std::vector<Option>& option_table() {
    return kTable;
}

const Option& find_option(std::string_view name) {
    const auto option = std::ranges::find(kTable, name, &Option::name);
    if (option != kTable.end()) return *option;
    std::string names;
    for (const Option& known : kTable) names += (names.empty() ? "" : ", ") + known.name;
    throw OptionError(std::string(name), "the name of an option", "none of that name",
                      "Options are " + names + ".");
}

void set_option(MorphOptions& options, std::string_view name, const OptionValue& value) {
    const Option* const option = &find_option(name);
    const auto refuse = [&](const std::string& found) {
        throw OptionError(option->name, range_of(*option), found,
                          "Choose a value from that range.");
    };
    if (std::holds_alternative<std::monostate>(value)) {
        if (!std::holds_alternative<std::monostate>(option->get(MorphOptions{})))
            refuse("no value");
    } else if (option->kind == Option::Kind::kChoice) {
        const auto* word = std::get_if<std::string>(&value);
        if (!word) refuse("a number");
        if (std::ranges::find(option->choices, *word) == option->choices.end()) refuse(*word);
    } else {
        if (const auto* word = std::get_if<std::string>(&value)) refuse(*word);
        const auto* whole = std::get_if<std::int64_t>(&value);
        const double number = whole ? static_cast<double>(*whole) : *std::get_if<double>(&value);
        const bool fraction =
            option->kind == Option::Kind::kInteger && number != std::floor(number);
        if (fraction || !(number >= option->minimum && number <= option->maximum))
            refuse(in_short(number));
    }
    option->set(options, value);
}

}  // namespace pointmorph
