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

    std::string name;
    Kind kind;
    double minimum = 0.0, maximum = 0.0;  ///< both included; unused for choices
    std::vector<std::string> choices;
    std::string unit;  ///< empty for a pure number
    std::string help;  ///< what it does and when to touch it

    std::function<OptionValue(const MorphOptions&)> get;
    std::function<void(MorphOptions&, const OptionValue&)> set;
};

const std::vector<Option>& option_table();

/// Throws OptionError for a name that isn't there or a value of another kind or out of range.
void set_option(MorphOptions& options, std::string_view name, const OptionValue& value);

}  // namespace pointmorph
