#include "pointmorph/morph/options.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <type_traits>

#include "pointmorph/base/error.hpp"

namespace pointmorph {

namespace {

std::string text(double number) {
    std::ostringstream out;
    out << number;
    return out.str();
}

std::string range_of(const Option& option) {
    if (option.kind == Option::Kind::kChoice) {
        std::string all;
        for (const auto& choice : option.choices) all += (all.empty() ? "" : ", ") + choice;
        return "one of " + all;
    }
    return std::string(option.kind == Option::Kind::kInteger ? "a whole number" : "a number") +
           " from " + text(option.minimum) + " to " + text(option.maximum);
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
Option number(std::string name, Field field, double minimum, double maximum, std::string unit,
              std::string help) {
    using Member = std::remove_cvref_t<decltype(field(std::declval<MorphOptions&>()))>;
    using Number = typename Unwrapped<Member>::Type;
    constexpr bool kOptional = !std::is_same_v<Member, Number>;
    constexpr bool kInteger = std::is_integral_v<Number>;

    Option option;
    option.name = std::move(name);
    option.kind = kInteger ? Option::Kind::kInteger : Option::Kind::kNumber;
    option.minimum = minimum;
    option.maximum = maximum;
    option.unit = std::move(unit);
    option.help = std::move(help);
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

/// A choice among the values of an enumeration, in their order.
template <class Field>
Option choice(std::string name, Field field, std::vector<std::string> choices, std::string help) {
    using Enum = std::remove_cvref_t<decltype(field(std::declval<MorphOptions&>()))>;
    Option option;
    option.name = std::move(name);
    option.kind = Option::Kind::kChoice;
    option.choices = choices;
    option.help = std::move(help);
    option.get = [field, choices](const MorphOptions& options) -> OptionValue {
        return choices[to_size(field(const_cast<MorphOptions&>(options)))];
    };
    option.set = [field, choices](MorphOptions& options, const OptionValue& value) {
        const auto found = std::ranges::find(choices, std::get<std::string>(value));
        field(options) = static_cast<Enum>(found - choices.begin());
    };
    return option;
}

#define POINTMORPH_FIELD(member)    \
    [](MorphOptions & o) -> auto& { \
        return o.member;            \
    }

std::vector<Option> make_table() {
    std::vector<Option> table;
    table.push_back(choice("method", POINTMORPH_FIELD(method), {"auto", "paper"},
                           "How the match is found. auto deforms both models onto each other, "
                           "nearly rigidly, whatever their topology. paper is the published "
                           "method"));
    table.push_back(choice("domain", POINTMORPH_FIELD(domain),
                           {"auto", "disk", "cut", "sphere", "network"},
                           "The common domain that both models are mapped to. disk: open patches "
                           "with one boundary. cut: closed models, cut in two along a loop of "
                           "features (without a loop, through the features on tips). sphere: "
                           "closed models without handles, not cut. network: closed models of "
                           "any kind, cut into patches by curves between all features. auto: "
                           "chosen by method and models. With method auto, the refinement starts "
                           "from this domain"));
    table.push_back(number("threads", POINTMORPH_FIELD(threads), 0, 1024, "threads",
                           "Processor threads to use; 0 uses all. The result is the same for any "
                           "number"));
    table.push_back(number("covariance_neighbors", POINTMORPH_FIELD(covariance_neighbors), 8, 64,
                           "points",
                           "Nearest points from which normals and the boundary are estimated. "
                           "Raise it for noisy scans, lower it for thin or finely detailed "
                           "models"));
    table.push_back(number("boundary_opening", POINTMORPH_FIELD(boundary.opening), 1.2, 10, "",
                           "How much wider than the usual gap between points an opening must be "
                           "to count as a boundary. Raise it if gaps in the sampling are "
                           "mistaken for a boundary, lower it if a boundary is missed"));
    table.push_back(number("boundary_min_loop", POINTMORPH_FIELD(boundary.min_loop), 4, 1e6,
                           "spacings",
                           "Boundary loops shorter than this count as gaps in the sampling"));
    table.push_back(choice("boundary_spacing", POINTMORPH_FIELD(parameterization.boundary_spacing),
                           {"uniform", "chord"},
                           "How boundary points are spread over the circle: evenly, or by the "
                           "distance between them. uniform suits boundaries that are sampled "
                           "alike on both models"));
    table.push_back(choice("solve", POINTMORPH_FIELD(parameterization.solve), {"full", "lod"},
                           "full solves the parameterization for all points, which is slow. lod "
                           "solves it for a simplified cloud and embeds all points in that"));
    table.push_back(number("decomposition_tips", POINTMORPH_FIELD(decomposition.tips), 0, 100,
                           "tips",
                           "The most tips without features, such as ears or a tail, to find on "
                           "models that are cut, and to match within the patches. 0 matches none"));
    table.push_back(number("sphere_nodes", POINTMORPH_FIELD(spherical_parameterization.nodes), 100,
                           100000, "points",
                           "Roughly how many points of each model are triangulated and mapped to "
                           "the sphere. Raise it if thin limbs get lost, lower it for speed"));
    table.push_back(number("lod_cluster_size",
                           POINTMORPH_FIELD(parameterization.lod.max_cluster_size), 1, 1000,
                           "points",
                           "The most points that one point of the simplified cloud stands for. "
                           "Smaller is finer and slower"));
    table.push_back(number("parameterization_neighbors",
                           POINTMORPH_FIELD(parameterization.neighbors), 6, 64, "points",
                           "Nearest points whose mean gives the place of an interior point in "
                           "the disk. Raise it if a patch falls apart"));
    table.push_back(number("parameterization_radius", POINTMORPH_FIELD(parameterization.radius), 1,
                           20, "spacings",
                           "Use all points within this radius instead of the nearest ones, as "
                           "the paper does. Automatic: the nearest points"));
    table.push_back(number("solver_tolerance", POINTMORPH_FIELD(parameterization.tolerance), 1e-14,
                           1e-3, "", "Relative residual at which the solver stops"));
    table.push_back(number("solver_max_iterations",
                           POINTMORPH_FIELD(parameterization.max_iterations), 1, 1e7, "iterations",
                           "The solver gives up after this many iterations"));
    table.push_back(number("alignment_error", POINTMORPH_FIELD(alignment.error), 1e-6, 1,
                           "spacings",
                           "How close two features must come in the disk, in spacings of the "
                           "points around them"));
    table.push_back(number("influence", POINTMORPH_FIELD(alignment.influence), 0.51, 1000, "",
                           "Radius around a feature that moves with it, as a multiple of the "
                           "distance that the feature moves. Larger is smoother, smaller is more "
                           "local"));
    table.push_back(number("influence_radius", POINTMORPH_FIELD(alignment.influence_radius), 1e-6,
                           2, "disk radii",
                           "The same as a fixed distance in the disk. Automatic: use the "
                           "multiple"));
    table.push_back(number("alignment_max_sweeps", POINTMORPH_FIELD(alignment.max_sweeps), 1, 1e6,
                           "sweeps", "The most times that both disks are warped in turn"));
    table.push_back(number("pairing_cluster_size", POINTMORPH_FIELD(pairing.max_cluster_size), 2,
                           1000, "points",
                           "The most points of either model in a cluster of the common domain "
                           "when points are paired"));
    table.push_back(number("transfer_neighbors", POINTMORPH_FIELD(transfer.neighbors), 6, 64,
                           "points",
                           "Points over which the smooth map averages. Raise it for noisy scans"));
    table.push_back(choice("path", POINTMORPH_FIELD(path), {"linear", "similarity", "rigid"},
                           "How points travel. linear: straight. similarity: the whole rotates "
                           "and scales on the way, so a rotated target doesn't shrink midway. "
                           "rigid: every part also rotates, so a raised leg swings. Shape keys "
                           "themselves are straight; bake several steps to follow the other "
                           "paths"));
    table.push_back(number("omega", POINTMORPH_FIELD(resampling.omega), 0, 2, "",
                           "Resampled frames get new points where the density falls below this "
                           "share of the density at both ends. 0 adds none, larger values add "
                           "them earlier"));
    table.push_back(number("resample_spacing", POINTMORPH_FIELD(resampling.spacing), 0.25, 4,
                           "spacings",
                           "Distance between the new points of resampled frames. Lower it if "
                           "frames are drawn with smaller points"));
    table.push_back(number("mls_degree", POINTMORPH_FIELD(resampling.mls.degree), 1, 4, "",
                           "Degree of the polynomials that define the surface for new points"));
    table.push_back(number("mls_scale", POINTMORPH_FIELD(resampling.mls.scale), 0.5, 10, "spacings",
                           "How far the surface for new points averages over the points around. "
                           "Raise it for noisy scans. Automatic: 0.9 + degree / 5"));
    table.push_back(number("mls_width", POINTMORPH_FIELD(resampling.mls.width), 1e-9, 1e9,
                           "model units",
                           "The same as a fixed distance. Automatic: use the multiple of the "
                           "spacing"));
    table.push_back(number("crowding", POINTMORPH_FIELD(resampling.crowding), 1.5, 100, "",
                           "Resampled frames leave out points where the density exceeds that of "
                           "either end by this factor. Automatic: keep all"));
    return table;
}

#undef POINTMORPH_FIELD

}  // namespace

const std::vector<Option>& option_table() {
    static const std::vector<Option> table = make_table();
    return table;
}

void set_option(MorphOptions& options, std::string_view name, const OptionValue& value) {
    const auto& table = option_table();
    const auto option = std::ranges::find(table, name, &Option::name);
    if (option == table.end()) {
        std::string names;
        for (const auto& known : table) names += (names.empty() ? "" : ", ") + known.name;
        throw OptionError(std::string(name), "the name of an option", "none of that name",
                          "Options are " + names + ".");
    }

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
            refuse(text(number));
    }
    option->set(options, value);
}

}  // namespace pointmorph
