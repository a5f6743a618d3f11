// Where a part of a shape lies on a whole one, and how large it is there. Not for callers of the
// library.
#pragma once

#include <cstddef>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"

namespace pointmorph {

/// Places that belong together, at unit area.
struct PartMarks {
    Positions part, whole;  ///< #marks by 3

    /// Whether they say where the part lies, and how large it is there.
    bool say_all() const;
    /// As far as they say so.
    Similarity pose() const { return fit_similarity(part, whole); }
};

/// One place where a part may lie.
struct PartPlace {
    Similarity pose;  ///< takes the part there
    /// Mean distance of the part's points from the whole, in √area of the part, with what the
    /// normals differ, each at most kMostApart.
    double misfit = 0.0;
};

/// Which places are looked for.
struct PartChoice {
    std::size_t most;  ///< at most so many
    bool smaller_only =
        false;  ///< none where the part looks most like the whole at the largest scale
};

/// The places where the part fits best, best first. The part has ends, and both shapes have unit
/// area. Where there are marks, they lie close to each other in all of them; where there are none,
/// a part that looks less and less like the whole as it shrinks has no place. Throws Cancelled.
std::vector<PartPlace> find_part(const CoarseShape& part, const CoarseShape& whole,
                                 const PartMarks& marks, const PartChoice& choice,
                                 Progress& progress);

/// Coarse rows of the whole that the part covers where it lies, with what lies around them along
/// the surface, as far as `margin` (√area of the part).
std::vector<char> covered_by_part(const CoarseShape& part, const CoarseShape& whole,
                                  const Similarity& pose, double margin);

/// Covers what else of the whole is a third as large as the largest such piece or smaller, unless
/// the part ends where it hangs: the hand of an arm that the part holds another way, not what the
/// part lacks. `pose` takes the part there.
void cover_what_hangs_on(const CoarseShape& part, const CoarseShape& whole, const Similarity& pose,
                         std::vector<char>& covered);

}  // namespace pointmorph
