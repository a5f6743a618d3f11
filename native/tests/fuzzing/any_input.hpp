// Any bytes as a question to the library: shapes, features, loops, options and saved morphs, in
// order but for a few damages, which the bytes choose.
#pragma once

#include <cstdint>
#include <span>
#include <stdexcept>

namespace pointmorph::fuzzing {

/// What the first byte chooses. The last two compute whole maps and take a thousand times as long.
enum class Question { kOptions, kShapes, kSaved, kTransforms, kMorph, kPreviews };
inline constexpr int kQuestions = 6;

enum class Answer { kDone, kRefused };

/// Something that the library promises never to do.
class BrokenPromise : public std::logic_error {
    using std::logic_error::logic_error;
};

/// Asks, and looks at what comes of it: finite numbers, exact ends, every point in a pair; or one
/// of the library's own errors. Throws BrokenPromise.
Answer try_bytes(std::span<const std::uint8_t> bytes);

}  // namespace pointmorph::fuzzing
