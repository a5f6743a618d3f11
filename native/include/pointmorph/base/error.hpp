// The errors that a user can meet. Each says what was expected, what was found and what to do.
// Python sees the same tree below `pointmorph.PointmorphError`.
#pragma once

#include <stdexcept>
#include <string>

namespace pointmorph {

/// A number as errors say it, with at most six digits.
std::string in_short(double number);

/// Base of every error that the library raises on purpose.
class Error : public std::runtime_error {
public:
    /// `subject` names the object, feature or option that is meant, as the user knows it.
    Error(std::string subject, std::string expected, std::string found, std::string advice);

    const std::string& subject() const noexcept { return subject_; }
    const std::string& expected() const noexcept { return expected_; }
    const std::string& found() const noexcept { return found_; }
    const std::string& advice() const noexcept { return advice_; }

private:
    std::string subject_, expected_, found_, advice_;
};

/// Points, normals, colors or radii that can't be used.
class CloudError : public Error {
    using Error::Error;
};

/// A feature or a loop that doesn't fit the clouds.
class FeatureError : public Error {
    using Error::Error;
};

/// An option out of its range, or options that contradict one another.
class OptionError : public Error {
    using Error::Error;
};

/// Shapes whose connectivity the chosen method can't handle.
class TopologyError : public Error {
    using Error::Error;
};

/// A computation that didn't reach the accuracy asked for.
class ConvergenceError : public Error {
    using Error::Error;
};

/// Raised in the calling thread after the caller's progress function asked for the end.
class Cancelled : public std::exception {
public:
    const char* what() const noexcept override { return "The morph was canceled."; }
};

}  // namespace pointmorph
