// The settings of a morph as the user meets them: one table that the command line, Blender's
// properties and the documentation are made from.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {

/// No value stands for "automatic".
using OptionValue = std::variant<std::monostate, std::int64_t, double, std::string>;

struct Option {
    enum class Kind { kInteger, kNumber, kChoice };
    /// What has to be made again when it changes. kMap: which points belong together, and all that
    /// follows; kPath: every frame between the ends; kFrames: resampled frames; kNothing: neither.
    enum class Affects { kMap, kPath, kFrames, kNothing };

    std::string name{};
    Kind kind = Kind::kNumber;
    double minimum = 0.0, maximum = 0.0;  ///< both included; unused for choices
    std::vector<std::string> choices{};
    std::string unit{};  ///< empty for a pure number
    std::string help{};  ///< what it does and when to change it
    Affects affects = Affects::kMap;
    /// The method that uses it; none: both. Options of the paper's method also count with method
    /// auto where the domain isn't auto, since the refinement then starts in that domain.
    std::optional<Method> method{};

    std::function<OptionValue(const MorphOptions&)> get{};
    std::function<void(MorphOptions&, const OptionValue&)> set{};
};

const std::vector<Option>& option_table();

/// Throws OptionError for a name that isn't there.
const Option& find_option(std::string_view name);

/// Throws OptionError for a name that isn't there or a value of another kind or out of range.
void set_option(MorphOptions& options, std::string_view name, const OptionValue& value);

}  // namespace pointmorph
