// The outside of an open cloud: the gaps between its points that are too wide for its surface. Not
// for callers of the library.
#pragma once

#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/sampled_surface.hpp"
#include "surface/delaunay_star.hpp"

namespace pointmorph {

/// A way past a point with the outside on the right: from `before` to `point` to `after`.
struct Passage {
    Index point, before, after;
};

/// The outside of a cloud: stars of the points at it, and which of their gaps belong to it.
class Outside {
public:
    /// `opening`: see BoundaryOptions. Keeps references to the arrays of `surface`.
    Outside(const SampledSurface& surface, double opening, Progress& progress);

    /// Whether the spacing varies so much from place to place that flat gaps are taken for surface.
    bool is_uneven() const { return is_uneven_; }

    /// Whether points lie as at random, so that wide gaps occur.
    bool is_scattered() const { return is_scattered_; }

    /// Spacing around a point that has a star, else 0.
    double spacing(Index i) const {
        return star_of_[to_size(i)] < 0 ? 0.0 : stars_[to_size(star_of_[to_size(i)])].spacing;
    }

    /// The star of a point, if it was needed.
    std::span<const Spoke> star(Index i) const {
        if (star_of_[to_size(i)] < 0) return {};
        const Star& star = stars_[to_size(star_of_[to_size(i)])];
        return {spokes_.data() + star.first, star.size};
    }

    /// One for each run of neighboring gaps outside, sorted by point.
    std::vector<Passage> passages() const;

private:
    struct Star {
        Index point;
        double spacing;
        std::size_t first, size;  ///< in `spokes_`
    };
    struct Gap {
        std::size_t star, spoke;
    };

    const Spoke& spoke(std::size_t s, std::size_t k) const { return spokes_[stars_[s].first + k]; }
    std::size_t after(std::size_t s, std::size_t k) const {
        return k + 1 < stars_[s].size ? k + 1 : 0;
    }
    std::size_t before(std::size_t s, std::size_t k) const {
        return (k > 0 ? k : stars_[s].size) - 1;
    }

    /// Marks the gaps that lie outside by their size alone.
    void open(double opening);

    /// From gap to gap across shared edges. Stars are made as they are needed.
    void spread();

    bool is_wide(std::size_t s, std::size_t k, double factor) const;

    void mark(std::size_t s, std::size_t k) {
        Spoke& gap = spokes_[stars_[s].first + k];
        if (!std::exchange(gap.outside, true)) front_.push_back({s, k});
    }

    std::optional<Gap> find_spoke(Index point, Index neighbor) const;

    /// The gap in the star of `point` that follows the spoke to `neighbor`.
    void mark_after(Index point, Index neighbor, bool closed, Index opposite);

    /// The gap that precedes it.
    void mark_before(Index point, Index neighbor, bool closed, Index opposite);

    /// Where the spacing jumps, a point's neighbors across the jump are not among its nearest,
    /// but it is among theirs.
    void find_reverse_neighbors(const std::vector<Index>& rows);

    void require_around(std::size_t first, std::size_t last);

    /// Makes the stars of those points that have none yet.
    void require(std::vector<Index> rows);

    /// Whether the point coincides with one of a lower row, which stands for both.
    bool has_lower_twin(Index i) const;

    /// Neighbors' neighbors and reverse neighbors that are farther away than the nearest, but
    /// closer than a given distance, ascending.
    void farther_neighbors(Index i, double squared_limit,
                           std::vector<std::pair<double, Index>>& sorted,
                           std::vector<Index>& rows) const;

    const Positions& positions_;
    const Normals& normals_;
    const Neighborhoods& nearest_;
    Progress& progress_;
    bool is_uneven_ = false, is_scattered_ = false;
    double spread_ = 0.0;
    std::vector<Index> star_of_;  ///< #points, −1 where there is none
    std::vector<Star> stars_;
    std::vector<Spoke> spokes_;
    std::vector<Gap> front_;  ///< marked, not spread yet
    std::vector<std::pair<Index, Index>> reverse_;
};

}  // namespace pointmorph
