// What the search for a map says of the map that it chose: how sure it is, which others there are,
// and what to ask the user.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/alternatives.hpp"
#include "pointmorph/registration/proposals.hpp"
#include "pointmorph/registration/restarts.hpp"

namespace pointmorph {

/// Passed on whole from stage to stage: a new figure is a field here, set where it is found, and an
/// entry in the report. Fields that hold rows are also listed in with_rows().
struct Diagnostics {
    /// How much worse the best rival fits, 1 or more; infinite where there was none, or the
    /// features left nothing to choose. See Pose::margin.
    double margin = std::numeric_limits<double>::infinity();
    /// How likely the map is right, 0 to 1; 1 where the features left nothing to choose. See
    /// pose_confidence(). NaN where nobody has judged it: of a map that was given.
    double confidence = 1.0;
    /// Other maps that were found, the likeliest first, and pairs of places that a user may want to
    /// mark. Empty where the pose was known and none were asked for.
    std::vector<Rival> rivals;
    std::vector<Proposal> proposals;
    /// All other maps that the search came upon, for how sure each place is. Empty where the pose
    /// was known.
    Alternatives alternatives;
    /// What the registration was started from, and which of these was taken.
    std::vector<Restart> starts;
    std::size_t start_taken = 0;
    /// Rows along borders where a shape ends while the other goes on: what has no counterpart lies
    /// there. Empty where nothing was left out.
    std::vector<Index> source_ends, target_ends;
    /// Rows of pieces that have no counterpart, as a warning says, and go with what is beside them.
    std::vector<Index> source_loose, target_loose;

    /// The same for clouds in which row i is now `source_rows[i]`, or `target_rows[i]`.
    Diagnostics with_rows(std::span<const Index> source_rows,
                          std::span<const Index> target_rows) const;

    /// After another registration that began where this one ended: what was found on the way to the
    /// first map still holds; the starts and loose pieces of both are listed, and the later one's
    /// start was taken.
    Diagnostics followed_by(const Diagnostics& later) const;
};

}  // namespace pointmorph
