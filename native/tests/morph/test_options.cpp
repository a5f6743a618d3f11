#include "pointmorph/morph/options.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "pointmorph/base/error.hpp"

namespace pointmorph {
namespace {

TEST(Options, DefaultsAreInTheirOwnRange) {
    const MorphOptions defaults;
    std::set<std::string> names;
    for (const Option& option : option_table()) {
        EXPECT_TRUE(names.insert(option.name).second) << option.name;
        EXPECT_FALSE(option.help.empty()) << option.name;
        MorphOptions options;
        EXPECT_NO_THROW(set_option(options, option.name, option.get(defaults))) << option.name;
        EXPECT_EQ(option.get(options), option.get(defaults)) << option.name;
    }
}

TEST(Options, EveryOptionReachesItsOwnField) {
    const MorphOptions defaults;
    for (const Option& option : option_table()) {
        MorphOptions options;
        OptionValue other;
        if (option.kind == Option::Kind::kChoice)
            other = option.choices.back() == std::get<std::string>(option.get(defaults))
                        ? option.choices.front()
                        : option.choices.back();
        else if (option.kind == Option::Kind::kInteger)
            other = static_cast<std::int64_t>(option.minimum) + 1;
        else
            other = (option.minimum + option.maximum) / 2;
        set_option(options, option.name, other);
        EXPECT_EQ(option.get(options), other) << option.name;
        for (const Option& rest : option_table())
            if (rest.name != option.name) {
                EXPECT_EQ(rest.get(options), rest.get(defaults)) << rest.name;
            }
    }
}

TEST(Options, EveryChoiceIsAValueOfItsOwn) {
    for (const Option& option : option_table())
        for (const std::string& choice : option.choices) {
            MorphOptions options;
            set_option(options, option.name, choice);
            EXPECT_EQ(option.get(options), OptionValue(choice)) << option.name;
        }
    MorphOptions options;
    set_option(options, "path", find_option("path").choices.back());
    EXPECT_EQ(options.path, PathKind::kRigid);
    set_option(options, "domain", find_option("domain").choices.back());
    EXPECT_EQ(options.domain, Domain::kNetwork);
}

TEST(Options, SayWhatHasToBeMadeAgain) {
    EXPECT_EQ(find_option("method").affects, Option::Affects::kMap);
    EXPECT_EQ(find_option("path").affects, Option::Affects::kPath);
    EXPECT_EQ(find_option("omega").affects, Option::Affects::kFrames);
    EXPECT_EQ(find_option("threads").affects, Option::Affects::kNothing);
    EXPECT_EQ(find_option("influence").method, Method::kPaper);
    EXPECT_FALSE(find_option("covariance_neighbors").method.has_value());
    EXPECT_THROW(find_option("color"), OptionError);
}

TEST(Options, WrongValuesNameTheRange) {
    MorphOptions options;
    const auto message = [&](std::string_view name, OptionValue value) -> std::string {
        try {
            set_option(options, name, value);
        } catch (const OptionError& error) {
            return error.what();
        }
        return "";
    };
    EXPECT_NE(message("covariance_neighbors", std::int64_t{3}).find("8 to 64"), std::string::npos);
    EXPECT_NE(message("covariance_neighbors", 16.5).find("whole number"), std::string::npos);
    EXPECT_NE(message("method", std::string("best")).find("auto, paper"), std::string::npos);
    EXPECT_NE(message("method", 1.0).find("auto, paper"), std::string::npos);
    EXPECT_NE(message("influence", std::string("big")).find("big"), std::string::npos);
    EXPECT_NE(message("influence", std::nan("")).find("nan"), std::string::npos);
    EXPECT_NE(message("influence", OptionValue{}).find("no value"), std::string::npos);
    EXPECT_NE(message("color", 1.0).find("covariance_neighbors"), std::string::npos);
    EXPECT_EQ(message("influence_radius", OptionValue{}), "");
}

}  // namespace
}  // namespace pointmorph
