#include "pointmorph/base/error.hpp"

#include <utility>

namespace pointmorph {

Error::Error(std::string subject, std::string expected, std::string found, std::string advice)
    : std::runtime_error(subject + ": expected " + expected + ", found " + found + ". " + advice),
      subject_(std::move(subject)),
      expected_(std::move(expected)),
      found_(std::move(found)),
      advice_(std::move(advice)) {}

}  // namespace pointmorph
