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
                           "How the correspondence is found: auto bends both models onto each "
                           "other, nearly rigidly, whatever their topology; paper takes the "
                           "published pipeline and nothing else"));
    table.push_back(choice("domain", POINTMORPH_FIELD(domain),
                           {"auto", "disk", "cut", "sphere", "network"},
                           "Where both models are laid over each other: disk is for open patches "
                           "with one boundary, cut for closed models and a loop of features, "
                           "along which they are cut in two (without one, the features on tips), "
                           "sphere for closed models without holes through them, uncut; "
                           "network for closed models of any kind, cut into many patches by curves "
                           "between all features; "
                           "auto takes what the method and the "
                           "models ask for. With method auto, it says where the refinement "
                           "starts"));
    table.push_back(number("threads", POINTMORPH_FIELD(threads), 0, 1024, "threads",
                           "Processor threads to use; 0 takes all. The result is the same for any "
                           "number"));
    table.push_back(number("covariance_neighbors", POINTMORPH_FIELD(covariance_neighbors), 8, 64,
                           "points",
                           "Nearest points that normals and the boundary are found from. Raise it "
                           "for noisy scans, lower it for thin or finely detailed models"));
    table.push_back(number("boundary_opening", POINTMORPH_FIELD(boundary.opening), 1.2, 10, "",
                           "How much wider than the usual gap between points an opening must be to "
                           "count as a boundary. Raise it when gaps in the sampling are taken for "
                           "one, lower it when a boundary is missed"));
    table.push_back(number("boundary_min_loop", POINTMORPH_FIELD(boundary.min_loop), 4, 1e6,
                           "spacings",
                           "Boundary loops shorter than this are taken for gaps in the sampling"));
    table.push_back(choice("boundary_spacing", POINTMORPH_FIELD(parameterization.boundary_spacing),
                           {"uniform", "chord"},
                           "How boundary points are spread over the circle: evenly, or by their "
                           "distance. Uniform suits boundaries that are sampled alike on both "
                           "models"));
    table.push_back(choice("solve", POINTMORPH_FIELD(parameterization.solve), {"full", "lod"},
                           "Solve the parameterization for all points (slow), or for a simplified "
                           "cloud into which all points are then embedded"));
    table.push_back(number("decomposition_tips", POINTMORPH_FIELD(decomposition.tips), 0, 100,
                           "tips",
                           "Tips without a mark (ears, a tail) that are found on models that are "
                           "cut and brought together inside the patches, at the most. 0 leaves "
                           "that to marks"));
    table.push_back(number("sphere_nodes", POINTMORPH_FIELD(spherical_parameterization.nodes), 100,
                           100000, "points",
                           "About so many points of each model are triangulated and laid onto the "
                           "sphere. Raise it where thin limbs get lost, lower it for speed"));
    table.push_back(number("lod_cluster_size",
                           POINTMORPH_FIELD(parameterization.lod.max_cluster_size), 1, 1000,
                           "points",
                           "Points that one point of the simplified cloud stands for, at the "
                           "most. Smaller is finer and slower"));
    table.push_back(number("parameterization_neighbors",
                           POINTMORPH_FIELD(parameterization.neighbors), 6, 64, "points",
                           "Nearest points whose mean an interior point is in the disk. Raise it "
                           "when a patch falls apart"));
    table.push_back(number("parameterization_radius", POINTMORPH_FIELD(parameterization.radius), 1,
                           20, "spacings",
                           "Takes all points within this radius instead of the nearest, as the "
                           "paper does. Automatic: nearest points"));
    table.push_back(number("solver_tolerance", POINTMORPH_FIELD(parameterization.tolerance), 1e-14,
                           1e-3, "", "Relative residual at which the solver ends"));
    table.push_back(number("solver_max_iterations",
                           POINTMORPH_FIELD(parameterization.max_iterations), 1, 1e7, "iterations",
                           "The solver gives up after this many iterations"));
    table.push_back(number("alignment_error", POINTMORPH_FIELD(alignment.error), 1e-6, 1,
                           "spacings",
                           "How close two features must come in the disk, in spacings of the "
                           "points around them"));
    table.push_back(number("influence", POINTMORPH_FIELD(alignment.influence), 0.51, 1000, "",
                           "Radius around a feature that moves with it, as a multiple of the "
                           "distance it has to go. Larger is smoother, smaller more local"));
    table.push_back(number("influence_radius", POINTMORPH_FIELD(alignment.influence_radius), 1e-6,
                           2, "disk radii",
                           "The same as a fixed distance in the disk. Automatic: the multiple is "
                           "used"));
    table.push_back(number("alignment_max_sweeps", POINTMORPH_FIELD(alignment.max_sweeps), 1, 1e6,
                           "sweeps", "Alternate warps of both disks at the most"));
    table.push_back(number("pairing_cluster_size", POINTMORPH_FIELD(pairing.max_cluster_size), 2,
                           1000, "points",
                           "Points of either model that a cluster of the common domain may hold "
                           "when points are paired"));
    table.push_back(number("transfer_neighbors", POINTMORPH_FIELD(transfer.neighbors), 6, 64,
                           "points",
                           "Points that the smooth map averages over. Raise it for noisy scans"));
    table.push_back(choice("path", POINTMORPH_FIELD(path), {"linear", "similarity", "rigid"},
                           "How points travel: linear goes straight, similarity turns and grows "
                           "the whole on the way (a turned target doesn't shrink midway), rigid "
                           "also turns every part, so that a raised leg swings. Shape keys "
                           "themselves are straight: bake several steps to follow the others"));
    table.push_back(number("omega", POINTMORPH_FIELD(resampling.omega), 0, 2, "",
                           "Re-sampled frames get new points where the density falls below this "
                           "share of that of both ends. 0 inserts none, larger inserts earlier"));
    table.push_back(number("resample_spacing", POINTMORPH_FIELD(resampling.spacing), 0.25, 4,
                           "spacings",
                           "How far apart the new points of re-sampled frames lie. Lower it when "
                           "frames are drawn with smaller points"));
    table.push_back(number("mls_degree", POINTMORPH_FIELD(resampling.mls.degree), 1, 4, "",
                           "Degree of the polynomials that make up the surface on which new points "
                           "lie"));
    table.push_back(number("mls_scale", POINTMORPH_FIELD(resampling.mls.scale), 0.5, 10, "spacings",
                           "How far the surface on which new points lie averages over the points "
                           "around. Raise it for noisy scans. Automatic: 0.9 + degree / 5"));
    table.push_back(number("mls_width", POINTMORPH_FIELD(resampling.mls.width), 1e-9, 1e9,
                           "model units",
                           "The same as a fixed distance. Automatic: the spacings are used"));
    table.push_back(number("crowding", POINTMORPH_FIELD(resampling.crowding), 1.5, 100, "",
                           "Re-sampled frames leave points out where the density is more than this "
                           "many times that of either end. Automatic: never"));
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
