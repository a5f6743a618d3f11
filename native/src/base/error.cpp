#include "pointmorph/base/error.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

namespace pointmorph {

std::string in_short(double number) {
    // Without streams: what the library links in for them is a tenth of its size.
    std::array<char, 32> text;
    std::snprintf(text.data(), text.size(), "%g", number);
    std::string said = text.data();
    std::replace(said.begin(), said.end(), ',', '.');  // of a program that speaks another language
    return said;
}

Error::Error(std::string subject, std::string expected, std::string found, std::string advice)
    : std::runtime_error(subject + ": expected " + expected + ", found " + found + ". " + advice),
      subject_(std::move(subject)),
      expected_(std::move(expected)),
      found_(std::move(found)),
      advice_(std::move(advice)) {}

}  // namespace pointmorph
