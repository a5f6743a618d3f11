#include "pointmorph/cloud/sampling.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// Marks the rows of `keep`; throws unless `count` candidates that include them can be chosen.
std::vector<bool> checked_keep(Index candidates, Index count, std::span<const Index> keep) {
    if (count > candidates)
        throw OptionError("samples",
                          "at most " + std::to_string(candidates) + ", the number of candidates",
                          std::to_string(count), "Ask for fewer samples.");
    if (count < 0 || to_size(count) < keep.size())
        throw OptionError(
            "samples", "at least " + std::to_string(keep.size()) + ", the number of points to keep",
            std::to_string(count), "Ask for more samples, or keep fewer points.");
    std::vector<bool> kept(to_size(candidates), false);
    for (const Index row : keep) {
        if (row < 0 || row >= candidates)
            throw OptionError("samples", "candidates as points to keep",
                              "row " + std::to_string(row) + " of " + std::to_string(candidates),
                              "Keep only candidates.");
        if (kept[to_size(row)])
            throw OptionError("samples", "different points to keep",
                              "row " + std::to_string(row) + " twice", "Keep each point once.");
        kept[to_size(row)] = true;
    }
    return kept;
}

/// Candidates that are left, with what is needed to find those around one.
struct Survivors {
    std::vector<Index> rows;  ///< of all candidates
    Positions positions;
    Normals normals;  ///< or 0 rows
    KdTree<3> tree;

    Survivors(const Positions& all_positions, const Normals& all_normals, std::vector<Index> left)
        : rows(std::move(left)),
          positions(gather(all_positions, rows)),
          normals(all_normals.rows() > 0 ? gather(all_normals, rows) : all_normals),
          tree(positions) {}

    Index size() const { return to_index(rows.size()); }

    bool agree(Index i, Index j) const {
        return normals.rows() == 0 || normals.row(i).dot(normals.row(j)) > 0.0;
    }

    double distance(Index i, Index j) const { return (positions.row(i) - positions.row(j)).norm(); }
};

/// Area of the surface, from the density around one candidate in sixteen: m others within r of it
/// share πr². Right in the mean for independent candidates of any density.
double estimate_area(const Survivors& candidates, Progress& progress) {
    constexpr Index kStep = 16;
    constexpr std::size_t kAround = 16;
    const Index some = (candidates.size() + kStep - 1) / kStep;
    Values areas = Values::Zero(some);
    parallel_for(
        some, progress,
        [&](Index begin, Index end) {
            std::vector<Index> rows(kAround + 1);
            std::vector<double> squared_distances(rows.size());
            for (Index s = begin; s < end; ++s) {
                const Index i = s * kStep;
                const Index found = candidates.tree.nearest(candidates.positions.row(i).data(),
                                                            rows, squared_distances);
                int around = 0;
                double farthest = 0.0;
                for (Index n = 0; n < found; ++n)
                    if (rows[to_size(n)] != i && candidates.agree(i, rows[to_size(n)])) {
                        ++around;
                        farthest = squared_distances[to_size(n)];
                    }
                if (around > 0) areas[s] = std::numbers::pi * farthest / around;
            }
        },
        0.0, 0.02);
    return areas.mean() * candidates.size();
}

/// Yuksel's weight of a pair of points.
struct PairWeight {
    double diameter;  ///< points that are farther apart ignore one another
    /// All pairs closer than this share of the diameter weigh the same, so that chance crowds
    /// among the candidates don't decide.
    double least;

    double operator()(double distance) const {
        double w = std::max(0.0, 1.0 - std::max(distance / diameter, least));
        w *= w;
        w *= w;
        return w * w;
    }
};

/// For each point those around it that have it around them, too.
class Around {
public:
    Around(const Survivors& points, double radius, Progress& progress, double first, double last)
        : points_(points),
          reach_(Values::Constant(points.size(), radius)),
          chunks_(to_size((points.size() + kChunk - 1) / kChunk)) {
        parallel_for(
            points.size(), progress,
            [&](Index begin, Index end) {
                std::vector<Index> rows(kMost);
                std::vector<double> squared_distances(rows.size());
                auto& chunk = chunks_[to_size(begin / kChunk)];
                for (Index i = begin; i < end; ++i) {
                    const Index found = points.tree.nearest_within(points.positions.row(i).data(),
                                                                   radius, rows, squared_distances);
                    if (found == kMost) reach_[i] = std::sqrt(squared_distances.back());
                    for (Index n = 0; n < found; ++n)
                        if (rows[to_size(n)] != i && points.agree(i, rows[to_size(n)]))
                            chunk.rows.push_back(rows[to_size(n)]);
                    chunk.ends.push_back(to_index(chunk.rows.size()));
                }
                chunk.rows.shrink_to_fit();
            },
            first, last, kChunk);
    }

    /// Calls `act(j, distance)`.
    template <class Act>
    void for_each(Index i, Act&& act) const {
        const auto& [ends, rows] = chunks_[to_size(i / kChunk)];
        const Index place = i % kChunk;
        for (Index n = place == 0 ? 0 : ends[to_size(place - 1)]; n < ends[to_size(place)]; ++n) {
            const Index j = rows[to_size(n)];
            const double distance = points_.distance(i, j);
            if (distance <= std::min(reach_[i], reach_[j])) act(j, distance);
        }
    }

private:
    // No more than this many are listed: a crowd must not cost the square of its size. It is
    // thinned out all the same, and whoever is left meets the others in the next round.
    static constexpr Index kMost = 64;
    static constexpr Index kChunk = 512;
    struct Chunk {
        std::vector<Index> ends, rows;
    };

    const Survivors& points_;
    Values reach_;
    std::vector<Chunk> chunks_;
};

/// Points by weight, the heaviest first. Weights may only sink; a point whose weight has sunk is
/// put back when it comes up.
class HeaviestFirst {
public:
    explicit HeaviestFirst(const Values& weights)
        : weights_(weights),
          scale_(weights.size() > 0 && weights.maxCoeff() > 0.0
                     ? (kBuckets - 1) / weights.maxCoeff()
                     : 0.0),
          heads_(kBuckets, -1),
          next_(to_size(weights.size())) {}

    void push(Index i) { push(i, bucket(i)); }

    /// The queue must not be empty.
    Index pop() {
        for (;;) {
            while (heads_[top_] < 0) --top_;
            const Index i = heads_[top_];
            heads_[top_] = next_[to_size(i)];
            const std::size_t now = bucket(i);
            if (now >= top_) return i;
            push(i, now);
        }
    }

private:
    static constexpr std::size_t kBuckets = 1 << 16;

    std::size_t bucket(Index i) const {
        return static_cast<std::size_t>(std::max(0.0, weights_[i]) * scale_);
    }
    void push(Index i, std::size_t bucket) {
        next_[to_size(i)] = heads_[bucket];
        heads_[bucket] = i;
    }

    const Values& weights_;
    double scale_;
    std::size_t top_ = kBuckets - 1;
    std::vector<Index> heads_, next_;
};

/// Removes the points that crowd the others most until `target` are left.
std::vector<Index> eliminate(const Survivors& points, const std::vector<bool>& kept, Index target,
                             const PairWeight& pair_weight, Progress& progress, double first,
                             double last) {
    const double middle = first + 0.7 * (last - first);
    const Around around(points, pair_weight.diameter, progress, first, middle);
    Values weights = Values::Zero(points.size());
    parallel_for(
        points.size(), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i)
                around.for_each(
                    i, [&](Index, double distance) { weights[i] += pair_weight(distance); });
        },
        middle, middle);

    // Places in the order of their reversed bits are spread evenly along the curve, and so are
    // then the points that go first among equals.
    HeaviestFirst queue(weights);
    const auto size = static_cast<std::uint32_t>(points.size());
    const int bits = std::bit_width(size);
    for (std::uint32_t n = 0; n < (1u << bits); ++n) {
        std::uint32_t place = 0;
        for (int bit = 0; bit < bits; ++bit) place |= (n >> bit & 1u) << (bits - 1 - bit);
        if (place < size && !kept[to_size(points.rows[place])]) queue.push(to_index(place));
    }

    std::vector<bool> gone(points.rows.size(), false);
    for (Index left = points.size(); left > target; --left) {
        const Index i = queue.pop();
        gone[to_size(i)] = true;
        around.for_each(i, [&](Index j, double distance) { weights[j] -= pair_weight(distance); });
        if (left % 1024 == 0)
            progress.report(last - (last - middle) * (left - target) / (points.size() - target));
    }
    std::vector<Index> rows;
    rows.reserve(to_size(target));
    for (std::size_t i = 0; i < gone.size(); ++i)
        if (!gone[i]) rows.push_back(points.rows[i]);
    return rows;
}

}  // namespace

std::vector<Index> blue_noise(const Positions& candidates, const Normals& normals, Index count,
                              std::span<const Index> keep, Progress& progress) {
    const auto size = to_index(candidates.rows());
    const std::vector<bool> kept = checked_keep(size, count, keep);
    std::vector<Index> result(keep.begin(), keep.end());
    if (to_size(count) == keep.size()) return result;

    // In the order of a curve, neighbors are near in memory, too, and the result doesn't depend
    // on the order of the candidates.
    std::vector<Index> rows = spatial_order(candidates);
    PairWeight pair_weight{};
    while (to_index(rows.size()) > count) {
        // Rounds that halve at the most: lists of neighbors get shorter, and what these left out
        // is looked for again.
        const auto left = to_index(rows.size());
        const Survivors points(candidates, normals, std::move(rows));
        if (left == size) {
            // Twice the radius that `count` disks have when packed as densely as possible.
            const double area = estimate_area(points, progress);
            pair_weight.diameter = 2.0 * std::sqrt(area / (2.0 * std::numbers::sqrt3 * count));
            pair_weight.least = 0.65 * (1.0 - std::pow(static_cast<double>(count) / size, 1.5));
        }
        const Index target = std::max(count, left / 2);
        const auto done = [&](Index now) {
            return 0.02 + 0.98 * (size - now) / static_cast<double>(size - count);
        };
        rows = eliminate(points, kept, target, pair_weight, progress, done(left), done(target));
    }
    std::erase_if(rows, [&](Index row) { return kept[to_size(row)]; });
    std::ranges::sort(rows);
    result.insert(result.end(), rows.begin(), rows.end());
    return result;
}

}  // namespace pointmorph
