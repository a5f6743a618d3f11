#include "pointmorph/measures/cracks.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

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
        : near_(near), pair_of_(near.order.size(), -1) {
        for (std::size_t i = pairs.size(); i-- > 0;)
            pair_of_[to_size(pairs[i].*side)] = to_index(i);
        const auto points = static_cast<std::int64_t>(near.order.size());
        width_ = std::min<std::int64_t>(kNearest, points - 1);
        count_ = std::max<std::int64_t>(std::min<std::int64_t>(width_ * points, most), 0);
    }

    Index count() const { return static_cast<Index>(count_); }

    /// Both ends, each as the first pair that it is in.
    std::array<Index, 2> operator[](Index edge) const {
        const auto [number, other] = numbers(edge);
        return {pair(number), pair(other)};
    }

    /// Whether any of the pairs next to the ends does.
    bool any_around(Index edge, const auto& does) const {
        for (const Index end : numbers(edge))
            for (const Index other : near_.nearest[end])
                if (does(pair(other))) return true;
        return false;
    }

private:
    /// Both ends in the order of the neighborhoods.
    std::array<Index, 2> numbers(Index edge) const {
        const auto points = static_cast<std::int64_t>(near_.order.size());
        const auto number = to_index(to_size(edge * points / count_));
        return {number, near_.nearest[number][to_size(edge % width_)]};
    }
    Index pair(Index number) const { return pair_of_[to_size(near_.order[to_size(number)])]; }

    const OrderedNeighbors& near_;
    std::vector<Index> pair_of_;
    std::int64_t width_, count_;
};

/// The in-between clouds.
struct Frames {
    const Positions& source;
    const Positions& target;
    std::span<const IndexPair> pairs;

    Eigen::RowVector3d at(Index pair, double t) const {
        const auto [s, d] = pairs[to_size(pair)];
        return (1.0 - t) * source.row(s) + t * target.row(d);
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
    /// `reach` is a power of two; no radius is larger.
    explicit BallCells(std::size_t balls, double reach)
        : inverse_(0.25 / reach), bits_(std::bit_ceil(to_size(kBitsPerBall) * balls + 64)) {}

    void add(const Eigen::RowVector3d& middle, double radius) {
        constexpr double kRounding = 1e-6;
        const double reach = (1.0 + kRounding) * radius;
        const Eigen::RowVector3d low = cell(middle.array() - reach),
                                 high = cell(middle.array() + reach);
        // A ball is half as wide as a cell: it lies in these eight, some of which may be the same.
        for (unsigned corner = 0; corner < 8; ++corner) {
            const auto side = [&](unsigned axis) {
                return (corner >> axis & 1U ? high : low)[static_cast<Eigen::Index>(axis)];
            };
            bits_[number({side(0), side(1), side(2)})] = true;
        }
    }

    bool may_hold(const Eigen::RowVector3d& place) const { return bits_[number(cell(place))]; }

private:
    static constexpr Index kBitsPerBall = 64;

    Eigen::RowVector3d cell(const Eigen::RowVector3d& place) const {
        return (inverse_ * place).array().floor();
    }
    /// Cells may share a number.
    std::size_t number(const Eigen::RowVector3d& cell) const {
        std::uint64_t mixed = 0;
        for (const double along : cell)
            mixed = (mixed ^ std::bit_cast<std::uint64_t>(along + 0.0)) * 0x9e3779b97f4a7c15U;
        return static_cast<std::size_t>(mixed >> 32) & (bits_.size() - 1);
    }

    double inverse_;
    std::vector<bool> bits_;
};

/// Gaps of about the same limit share a tree, so that a wide one doesn't widen the search for all.
class GapGroup {
public:
    GapGroup(const Gaps& gaps, std::vector<std::size_t> members, int exponent)
        : members_(std::move(members)),
          middles_(static_cast<Eigen::Index>(members_.size()), 3),
          reach_(std::ldexp(1.0, exponent + 1)) {
        constexpr double kCoarsest = 1e-8;  // rounding of a coordinate that could be felt
        for (std::size_t k = 0; k < members_.size(); ++k)
            middles_.row(static_cast<Eigen::Index>(k)) = gaps.middles[members_[k]];
        tree_.emplace(middles_);
        if (!(reach_ > std::max(kCoarsest * middles_.cwiseAbs().maxCoeff(), 1e-300))) return;
        cells_.emplace(members_.size(), reach_);
        for (const std::size_t g : members_) cells_->add(gaps.middles[g], gaps.limits[g]);
    }

    /// Calls `found(gap, squared distance)` for all that may be near enough; `near` is scratch
    /// memory.
    void around(const Eigen::RowVector3d& place, std::vector<std::pair<Index, double>>& near,
                const auto& found) const {
        if (cells_ && !cells_->may_hold(place)) return;
        tree_->within_unsorted(place.data(), reach_, near);
        for (const auto& [k, squared_distance] : near)
            found(members_[to_size(k)], squared_distance);
    }

private:
    std::vector<std::size_t> members_;
    Positions middles_;
    double reach_;
    std::optional<KdTree<3>> tree_;
    std::optional<BallCells> cells_;
};

/// Which of the gaps no point of the frame closes.
std::vector<std::atomic<bool>> closed_gaps(const Gaps& gaps, const Frames& frames, double t,
                                           Progress& progress) {
    std::map<int, std::vector<std::size_t>> by_exponent;
    for (std::size_t g = 0; g < gaps.limits.size(); ++g)
        if (gaps.limits[g] > 0.0) by_exponent[std::ilogb(gaps.limits[g])].push_back(g);
    std::vector<std::unique_ptr<GapGroup>> groups;
    for (auto& [exponent, members] : by_exponent)
        groups.push_back(std::make_unique<GapGroup>(gaps, std::move(members), exponent));
    std::vector<std::atomic<bool>> closed(gaps.limits.size());
    parallel_for(
        to_index(frames.pairs.size()), progress,
        [&](Index begin, Index end) {
            std::vector<std::pair<Index, double>> near;
            for (Index i = begin; i < end; ++i) {
                const Eigen::RowVector3d place = frames.at(i, t);
                for (const auto& group : groups)
                    group->around(place, near, [&](std::size_t g, double squared_distance) {
                        if (squared_distance <= gaps.limits[g] * gaps.limits[g])
                            closed[g].store(true, std::memory_order_relaxed);
                    });
            }
        },
        0.0, 1.0, 4096);
    return closed;
}

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
    const auto end_of = [&](Index pair) -> End {
        const auto [s, d] = frames.pairs[to_size(pair)];
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
    const auto both_ends = [&](Index edge) -> std::array<End, 2> {
        const auto [first, second] = edges[edge];
        return {end_of(first), end_of(second)};
    };
    const std::size_t count = to_size(edges.count());
    std::vector<char> is_long(times.size() * count);
    parallel_for(edges.count(), progress, [&](Index begin, Index end) {
        for (Index e = begin; e < end; ++e) {
            const auto ends = both_ends(e);
            if (are_between && stays_short(ends)) continue;
            for (std::size_t k = 0; k < times.size(); ++k) {
                const auto [start, middle, limit] = gap(ends, times[k]);
                const auto closes = [&, middle = middle, limit = limit](const auto& place) {
                    return (place - middle).squaredNorm() <= limit * limit;
                };
                is_long[k * count + to_size(e)] =
                    !closes(start) && !edges.any_around(e, [&](Index pair) {
                        return closes(frames.at(pair, times[k]));
                    });
            }
        }
    });
    std::vector<Gaps> gaps(times.size());
    parallel_invoke(static_cast<int>(times.size()), [&](int number, bool) {
        const std::size_t k = to_size(number);
        for (Index e = 0; e < edges.count(); ++e) {
            if (!is_long[k * count + to_size(e)]) continue;
            const auto [start, middle, limit] = gap(both_ends(e), times[k]);
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
    const Frames frames{source.positions, target.positions, pairs};
    std::array<std::vector<Gaps>, 2> gaps;
    for (std::size_t k = 0; k < 2; ++k) {
        const Progress::Part part(progress, k == 0 ? 0.0 : 0.25, k == 0 ? 0.25 : 0.5);
        gaps[k] = gaps_of(*edges[k], frames, times, {&*spacing[0], &*spacing[1]}, progress);
    }

    std::vector<Cracks> cracks;
    const double share = 0.5 / static_cast<double>(times.size());
    for (std::size_t k = 0; k < times.size(); ++k) {
        const double done = 0.5 + share * static_cast<double>(k);
        const Progress::Part part(progress, done, done + share);
        Gaps& all = gaps[0][k];
        const std::size_t of_source = all.limits.size();
        const Gaps& more = gaps[1][k];
        all.middles.insert(all.middles.end(), more.middles.begin(), more.middles.end());
        all.limits.insert(all.limits.end(), more.limits.begin(), more.limits.end());
        const auto closed = closed_gaps(all, frames, times[k], progress);
        const auto open = [&](std::size_t begin, std::size_t end, const Edges& among) {
            std::int64_t is_open = 0;
            for (std::size_t g = begin; g < end; ++g) is_open += !closed[g].load();
            return among.count() > 0 ? static_cast<double>(is_open) / among.count() : 0.0;
        };
        cracks.push_back({times[k], std::max(open(0, of_source, *edges[0]),
                                             open(of_source, all.limits.size(), *edges[1]))});
    }
    return cracks;
}

}  // namespace pointmorph
