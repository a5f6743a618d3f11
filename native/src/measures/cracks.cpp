#include "pointmorph/measures/cracks.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "base/median.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kNearest = 6;
constexpr double kOpen = 2.0;  // spacings

/// Spacing of every point, in the order of the neighborhoods, and where each row is in it.
struct Spacing {
    explicit Spacing(const Positions& positions, const OrderedNeighbors& neighbors)
        : number(inverse_order(neighbors.order)),
          values(local_spacing(gather(positions, neighbors.order), neighbors.nearest,
                               to_index(kNearest))) {}

    double operator[](Index row) const { return values[number[to_size(row)]]; }

    std::vector<Index> number;
    Values values;
};

/// Edges of a cloud, evenly over its points.
class Edges {
public:
    Edges(const OrderedNeighbors& near, std::span<const IndexPair> pairs, Index IndexPair::*side,
          Index most)
        : near_(near), points_(to_index(near.order.size())), first_pairs_(near.order.size()) {
        const std::vector<Index> number = inverse_order(near.order);
        for (std::size_t i = pairs.size(); i-- > 0;)
            first_pairs_[to_size(number[to_size(pairs[i].*side)])] = pairs[i];
        width_ = std::min<Index>(to_index(kNearest), points_ - 1);
        count_ =
            static_cast<Index>(std::clamp<std::int64_t>(std::int64_t{width_} * points_, 0, most));
    }

    Index count() const { return count_; }

    /// Calls `look(edge, ends)` for edges `begin` to `end`: both ends, each as the first pair that
    /// it is in.
    void each(Index begin, Index end, const auto& look) const {
        if (begin >= end) return;
        const std::int64_t along = std::int64_t{begin} * points_;
        auto number = static_cast<Index>(along / count_);
        std::int64_t rest = along % count_;
        Index place = begin % width_;
        for (Index edge = begin; edge < end; ++edge) {
            const Index other = near_.nearest[number][to_size(place)];
            look(edge, std::array{first_pairs_[to_size(number)], first_pairs_[to_size(other)]});
            place = place + 1 < width_ ? place + 1 : 0;
            for (rest += points_; rest >= count_; rest -= count_) ++number;
        }
    }

    /// Both ends of an edge.
    std::array<IndexPair, 2> operator[](Index edge) const {
        std::array<IndexPair, 2> result;
        each(edge, edge + 1, [&](Index, const auto& ends) { result = ends; });
        return result;
    }

    /// Whether any of the pairs next to the ends does.
    bool any_around(Index edge, const auto& does) const {
        const auto number = static_cast<Index>(std::int64_t{edge} * points_ / count_);
        for (const Index end : {number, near_.nearest[number][to_size(edge % width_)]})
            for (const Index other : near_.nearest[end])
                if (does(first_pairs_[to_size(other)])) return true;
        return false;
    }

private:
    const OrderedNeighbors& near_;
    Index points_;
    std::vector<IndexPair> first_pairs_;  ///< in the order of the neighborhoods
    Index width_, count_;
};

/// The in-between clouds.
struct Frames {
    const Positions& source;
    const Positions& target;

    Eigen::RowVector3d at(const IndexPair& pair, double t) const {
        return (1.0 - t) * source.row(pair.source) + t * target.row(pair.target);
    }
};

/// Places from which every point of a frame may be farther than a limit, each its own.
struct Gaps {
    std::vector<Eigen::RowVector3d> middles;
    std::vector<double> limits;
};

/// Says of most places at once that they lie in none of some balls.
class BallCells {
public:
    /// Of gaps whose limits are larger than 0: there is one at least.
    explicit BallCells(const Gaps& gaps) {
        constexpr double kMostCells = 100.0;  // for each ball
        std::vector<double> radii;
        for (const double limit : gaps.limits)
            if (limit > 0.0) radii.push_back(limit);
        double width = median(radii);
        const auto cells = [&](double of) {
            double sum = 0.0;
            for (const double radius : radii) sum += std::pow(2.0 * radius / of + 2.0, 3);
            return sum;
        };
        const double most = kMostCells * static_cast<double>(radii.size());
        while (cells(width) > most) width *= 2.0;
        inverse_ = 1.0 / width;
        bits_.resize(std::bit_ceil(to_size(kBitsPerBall) * radii.size()));
        for (std::size_t k = 0; k < gaps.limits.size(); ++k)
            if (gaps.limits[k] > 0.0) add(gaps.middles[k], gaps.limits[k]);
    }

    bool may_hold(const Eigen::RowVector3d& place) const { return bits_[number(cell(place))]; }

private:
    static constexpr Index kBitsPerBall = 256;

    void add(const Eigen::RowVector3d& middle, double radius) {
        constexpr double kRounding = 1e-6;
        const double reach = (1.0 + kRounding) * radius;
        const Eigen::RowVector3d low = cell(middle.array() - reach),
                                 high = cell(middle.array() + reach);
        for (double x = low[0]; x <= high[0]; ++x)
            for (double y = low[1]; y <= high[1]; ++y)
                for (double z = low[2]; z <= high[2]; ++z) bits_[number({x, y, z})] = true;
    }

    Eigen::RowVector3d cell(const Eigen::RowVector3d& place) const {
        return (inverse_ * place).array().floor();
    }
    /// Cells may share a number.
    std::size_t number(const Eigen::RowVector3d& cell) const {
        constexpr double kWhole = 0x1.8p52;  // has whole numbers lie in the lowest bits
        std::uint64_t mixed = 0;
        for (const double along : cell)
            mixed = (mixed ^ std::bit_cast<std::uint64_t>(along + kWhole)) * 0x9e3779b97f4a7c15U;
        return static_cast<std::size_t>(mixed >> 32) & (bits_.size() - 1);
    }

    double inverse_ = 1.0;
    std::vector<bool> bits_;
};

/// Gaps of about the same limit share a tree, so that a wide one doesn't widen the search for all.
class GapGroup {
public:
    GapGroup(const Gaps& gaps, std::vector<std::size_t> members, int exponent)
        : members_(std::move(members)),
          middles_(gathered(gaps.middles, members_)),
          tree_(middles_),
          reach_(std::ldexp(1.0, exponent + 1)) {}

    /// Calls `found(gap, squared distance)` for all that may be near enough; `near` is scratch
    /// memory.
    void around(const Eigen::RowVector3d& place, std::vector<std::pair<Index, double>>& near,
                const auto& found) const {
        tree_.within_unsorted(place.data(), reach_, near);
        for (const auto& [k, squared_distance] : near)
            found(members_[to_size(k)], squared_distance);
    }

private:
    static Positions gathered(const std::vector<Eigen::RowVector3d>& middles,
                              const std::vector<std::size_t>& members) {
        Positions result(static_cast<Eigen::Index>(members.size()), 3);
        for (std::size_t k = 0; k < members.size(); ++k)
            result.row(static_cast<Eigen::Index>(k)) = middles[members[k]];
        return result;
    }

    std::vector<std::size_t> members_;
    Positions middles_;
    KdTree<3> tree_;
    double reach_;
};

/// Finds out which of the gaps at one time are closed by points of the frame.
class GapSearch {
public:
    explicit GapSearch(const Gaps& gaps) : gaps_(gaps), closed_(gaps.limits.size()) {
        constexpr double kCoarsest = 1e-8;  // rounding of a coordinate that could be felt
        double farthest = 0.0, least = std::numeric_limits<double>::infinity();
        std::map<int, std::vector<std::size_t>> by_exponent;
        for (std::size_t g = 0; g < gaps.limits.size(); ++g) {
            if (!(gaps.limits[g] > 0.0)) continue;
            by_exponent[std::ilogb(gaps.limits[g])].push_back(g);
            farthest = std::max(farthest, gaps.middles[g].cwiseAbs().maxCoeff());
            least = std::min(least, gaps.limits[g]);
        }
        for (auto& [exponent, members] : by_exponent)
            groups_.push_back(std::make_unique<GapGroup>(gaps, std::move(members), exponent));
        if (!groups_.empty() && least > std::max(kCoarsest * farthest, 1e-300))
            cells_.emplace(gaps);
    }

    /// A point of the frame; `near` is scratch memory.
    void look_at(const Eigen::RowVector3d& place, std::vector<std::pair<Index, double>>& near) {
        if (cells_ && !cells_->may_hold(place)) return;
        for (const auto& group : groups_)
            group->around(place, near, [&](std::size_t g, double squared_distance) {
                if (squared_distance <= gaps_.limits[g] * gaps_.limits[g])
                    closed_[g].store(true, std::memory_order_relaxed);
            });
    }

    bool is_open(std::size_t gap) const { return !closed_[gap].load(); }

private:
    const Gaps& gaps_;
    std::vector<std::unique_ptr<GapGroup>> groups_;
    std::optional<BallCells> cells_;
    std::vector<std::atomic<bool>> closed_;
};

/// The middle of an edge at t, and within which distance a point closes it.
struct Gap {
    Eigen::RowVector3d start;
    Eigen::RowVector3d middle;
    double limit;
};

/// Edges that aren't closed by their own ends, which close most: one list for each time.
std::vector<Gaps> gaps_of(const Edges& edges, const Frames& frames, std::span<const double> times,
                          const std::array<const Spacing*, 2>& spacing, Progress& progress) {
    struct End {
        Eigen::RowVector3d source, target;
        double source_spacing, target_spacing;
    };
    const auto end_of = [&](const IndexPair& pair) -> End {
        const auto [s, d] = pair;
        return {frames.source.row(s), frames.target.row(d), (*spacing[0])[s], (*spacing[1])[d]};
    };
    const auto gap = [](const std::array<End, 2>& ends, double t) -> Gap {
        const auto place = [t](const End& end) -> Eigen::RowVector3d {
            return (1.0 - t) * end.source + t * end.target;
        };
        const Eigen::RowVector3d start = place(ends[0]);
        double limit = 0.0;
        for (const End& end : ends)
            limit += kOpen / 2.0 * ((1.0 - t) * end.source_spacing + t * end.target_spacing);
        return {start, (start + place(ends[1])) / 2.0, limit};
    };
    // An edge that is short at both ends is so all the way, as it is no longer than in proportion.
    constexpr double kRounding = 1.0 - 1e-9, kPlaces = 1e-14;
    const double off = kPlaces * std::max(frames.source.cwiseAbs().maxCoeff(),
                                          frames.target.cwiseAbs().maxCoeff());
    const auto stays_short = [&](const std::array<End, 2>& ends) {
        const auto is_short = [&](const auto& edge, double both_spacings) {
            const double most = kRounding * kOpen * both_spacings - off;
            return most > 0.0 && edge.squaredNorm() <= most * most;
        };
        const auto& [a, b] = ends;
        return is_short(a.source - b.source, a.source_spacing + b.source_spacing) &&
               is_short(a.target - b.target, a.target_spacing + b.target_spacing);
    };
    const bool are_between =
        std::ranges::all_of(times, [](double t) { return t >= 0.0 && t <= 1.0; });
    const auto both = [&](const std::array<IndexPair, 2>& pairs) -> std::array<End, 2> {
        return {end_of(pairs[0]), end_of(pairs[1])};
    };
    const std::size_t count = to_size(edges.count());
    std::vector<char> is_long(times.size() * count);
    parallel_for(edges.count(), progress, [&](Index begin, Index end) {
        edges.each(begin, end, [&](Index e, const std::array<IndexPair, 2>& pairs) {
            const auto ends = both(pairs);
            if (are_between && stays_short(ends)) return;
            for (std::size_t k = 0; k < times.size(); ++k) {
                const auto [start, middle, limit] = gap(ends, times[k]);
                const auto closes = [&, middle = middle, limit = limit](const auto& place) {
                    return (place - middle).squaredNorm() <= limit * limit;
                };
                is_long[k * count + to_size(e)] =
                    !closes(start) && !edges.any_around(e, [&](const IndexPair& pair) {
                        return closes(frames.at(pair, times[k]));
                    });
            }
        });
    });
    std::vector<Gaps> gaps(times.size());
    parallel_invoke(static_cast<int>(times.size()), [&](int number, bool) {
        const std::size_t k = to_size(number);
        for (Index e = 0; e < edges.count(); ++e) {
            if (!is_long[k * count + to_size(e)]) continue;
            const auto [start, middle, limit] = gap(both(edges[e]), times[k]);
            gaps[k].middles.push_back(middle);
            gaps[k].limits.push_back(limit);
        }
    });
    return gaps;
}

}  // namespace

std::vector<Cracks> find_cracks(const CrackSide& source, const CrackSide& target,
                                std::span<const IndexPair> pairs, std::span<const double> times,
                                Progress& progress, Index max_edges) {
    std::array<std::optional<OrderedNeighbors>, 2> found;
    const auto neighbors = [&](const CrackSide& side,
                               std::optional<OrderedNeighbors>& own) -> const OrderedNeighbors* {
        if (side.neighbors) return side.neighbors;
        return &own.emplace(ordered_neighbors(side.positions, to_index(kNearest), progress));
    };
    const std::array near{neighbors(source, found[0]), neighbors(target, found[1])};
    std::array<std::optional<Spacing>, 2> spacing;
    std::array<std::optional<Edges>, 2> edges;
    on_both(progress, [&](bool is_source, Progress&) {
        const std::size_t k = is_source ? 0 : 1;
        spacing[k].emplace(is_source ? source.positions : target.positions, *near[k]);
        edges[k].emplace(*near[k], pairs, is_source ? &IndexPair::source : &IndexPair::target,
                         max_edges);
    });
    const Frames frames{source.positions, target.positions};
    std::array<std::vector<Gaps>, 2> gaps;
    for (std::size_t k = 0; k < 2; ++k) {
        const Progress::Part part(progress, k == 0 ? 0.0 : 0.25, k == 0 ? 0.25 : 0.5);
        gaps[k] = gaps_of(*edges[k], frames, times, {&*spacing[0], &*spacing[1]}, progress);
    }

    // Of each time, those of the source and then those of the target.
    std::vector<std::unique_ptr<GapSearch>> searches(times.size());
    parallel_invoke(static_cast<int>(times.size()), [&](int number, bool) {
        const std::size_t k = to_size(number);
        Gaps& all = gaps[0][k];
        const Gaps& more = gaps[1][k];
        all.middles.insert(all.middles.end(), more.middles.begin(), more.middles.end());
        all.limits.insert(all.limits.end(), more.limits.begin(), more.limits.end());
        searches[k] = std::make_unique<GapSearch>(all);
    });
    constexpr Index kChunk = 4096;
    parallel_for(
        to_index(pairs.size()), progress,
        [&](Index begin, Index end) {
            std::vector<std::pair<Index, double>> near;
            for (Index i = begin; i < end; ++i)
                for (std::size_t k = 0; k < times.size(); ++k)
                    searches[k]->look_at(frames.at(pairs[to_size(i)], times[k]), near);
        },
        0.5, 1.0, kChunk);

    std::vector<Cracks> cracks;
    for (std::size_t k = 0; k < times.size(); ++k) {
        const std::size_t count = gaps[0][k].limits.size(),
                          of_source = count - gaps[1][k].limits.size();
        const auto open = [&](std::size_t begin, std::size_t end, const Edges& among) {
            std::int64_t is_open = 0;
            for (std::size_t g = begin; g < end; ++g) is_open += searches[k]->is_open(g);
            return among.count() > 0 ? static_cast<double>(is_open) / among.count() : 0.0;
        };
        cracks.push_back(
            {times[k], std::max(open(0, of_source, *edges[0]), open(of_source, count, *edges[1]))});
    }
    return cracks;
}

}  // namespace pointmorph
