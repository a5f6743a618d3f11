#include "pointmorph/cloud/neighborhoods.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "cloud/apart_neighbors.hpp"
#include "cloud/neighbor_room.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

Neighborhoods room_for_neighbors(Index count, Index k) {
    const Index width = std::clamp<Index>(k, 0, std::max<Index>(count - 1, 0));
    Neighborhoods room;
    room.offsets.resize(to_size(count) + 1);
    for (std::size_t i = 0; i < room.offsets.size(); ++i)
        room.offsets[i] = static_cast<std::int64_t>(i) * width;
    room.indices.resize(to_size(room.offsets.back()));
    return room;
}

Neighborhoods nearest_neighbors(const KdTree<3>& tree, Index k, Progress& progress) {
    return nearest_neighbors(tree, room_for_neighbors(tree.size(), k), progress);
}

Neighborhoods nearest_neighbors(const KdTree<3>& tree, Neighborhoods room, Progress& progress) {
    const Index count = tree.size();
    Neighborhoods result = std::move(room);
    const auto width = count > 0 ? to_index(result[0].size()) : 0;
    parallel_for(count, progress, [&](Index begin, Index end) {
        std::vector<Index> found(to_size(width) + 1);
        std::vector<double> squared_distances(found.size());
        for (Index i = begin; i < end; ++i) {
            tree.nearest(tree.points().row(i).data(), found, squared_distances);
            // Among coincident points the query itself may stand anywhere, or be missing.
            const auto self = std::ranges::find(found, i);
            std::rotate(self == found.end() ? found.end() - 1 : self,
                        self == found.end() ? found.end() : self + 1, found.end());
            std::copy_n(found.begin(), width, result.indices.begin() + result.offsets[to_size(i)]);
        }
    });
    return result;
}

OrderedNeighbors ordered_neighbors(const Positions& positions, Index k, Progress& progress) {
    OrderedNeighbors result{spatial_order(positions), {}};
    const Positions ordered = normalization(positions).apply(gather(positions, result.order));
    result.nearest = nearest_neighbors(KdTree<3>(ordered), k, progress);
    return result;
}

Neighborhoods radius_neighbors(const KdTree<3>& tree, double radius, Progress& progress) {
    const Index count = tree.size();
    constexpr Index kChunk = 512;
    std::vector<std::vector<Index>> chunk_indices(to_size((count + kChunk - 1) / kChunk));
    Neighborhoods result;
    result.offsets.assign(to_size(count) + 1, 0);

    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            auto& indices = chunk_indices[to_size(begin / kChunk)];
            std::vector<std::pair<Index, double>> found;
            for (Index i = begin; i < end; ++i) {
                tree.within(tree.points().row(i).data(), radius, found);
                const auto before = indices.size();
                for (const auto& [j, squared_distance] : found)
                    if (squared_distance > 0.0) indices.push_back(j);
                result.offsets[to_size(i) + 1] = static_cast<std::int64_t>(indices.size() - before);
            }
        },
        0.0, 1.0, kChunk);

    std::partial_sum(result.offsets.begin(), result.offsets.end(), result.offsets.begin());
    result.indices.reserve(to_size(result.offsets.back()));
    for (auto& indices : chunk_indices) {
        result.indices.insert(result.indices.end(), indices.begin(), indices.end());
        indices = std::vector<Index>();
    }
    return result;
}

namespace {

/// Writes what is in either sorted list, sorted, each once; without branches that nobody can
/// foresee. Returns how many there are.
std::size_t merge(std::span<const Index> a, std::span<const Index> b, std::vector<Index>& merged) {
    merged.resize(std::max(merged.size(), a.size() + b.size()));
    std::size_t count = 0, i = 0, j = 0;
    Index last = -1;
    const auto add = [&](Index row) {
        merged[count] = row;
        count += row != last ? 1 : 0;
        last = row;
    };
    while (i < a.size() && j < b.size()) {
        const Index of_a = a[i], of_b = b[j], least = std::min(of_a, of_b);
        add(least);
        i += of_a == least ? 1 : 0;
        j += of_b == least ? 1 : 0;
    }
    for (; i < a.size(); ++i) add(a[i]);
    for (; j < b.size(); ++j) add(b[j]);
    return count;
}

}  // namespace

Neighborhoods symmetrized(const Neighborhoods& neighborhoods) {
    const Index count = neighborhoods.size();
    const auto row = [](Index i) { return to_size(i); };
    // Of each row, those that name it come first, then those that it names. Rows are visited in
    // order, so that both are sorted.
    std::vector<std::int64_t> offsets(row(count) + 1, 0);
    for (Index i = 0; i < count; ++i)
        for (const Index j : neighborhoods[i]) {
            ++offsets[row(i) + 1];
            ++offsets[row(j) + 1];
        }
    std::partial_sum(offsets.begin(), offsets.end(), offsets.begin());
    std::vector<Index> both(to_size(offsets.back()));
    std::vector<std::int64_t> next(offsets.begin(), offsets.end() - 1);
    for (Index i = 0; i < count; ++i)
        for (const Index j : neighborhoods[i]) both[to_size(next[row(j)]++)] = i;
    const std::vector<std::int64_t> middles = next;
    for (Index j = 0; j < count; ++j)
        for (auto k = offsets[row(j)]; k < middles[row(j)]; ++k)
            both[to_size(next[row(both[to_size(k)])]++)] = j;

    Neighborhoods result;
    result.offsets.reserve(row(count) + 1);
    std::vector<Index> merged;
    auto end = both.begin();  // compact in place, behind the reading
    for (Index i = 0; i < count; ++i) {
        const Index* const begin = both.data() + offsets[row(i)];
        const Index* const middle = both.data() + middles[row(i)];
        const std::size_t kept =
            merge({begin, middle}, {middle, both.data() + offsets[row(i) + 1]}, merged);
        end = std::copy_n(merged.begin(), kept, end);
        result.offsets.push_back(end - both.begin());
    }
    both.erase(end, both.end());
    result.indices = std::move(both);
    return result;
}

ConnectedComponents connected_components(const Neighborhoods& neighborhoods) {
    GrowingComponents connected(neighborhoods.size());
    each_apart(connected, neighborhoods, [&](Index i, Index j) { connected.join(i, j); });
    return connected.components();
}

GrowingComponents::GrowingComponents(Index count) : parent_(to_size(count)) {
    std::iota(parent_.begin(), parent_.end(), 0);
}

ConnectedComponents GrowingComponents::components() {
    const auto count = to_index(parent_.size());
    ConnectedComponents result;
    result.label.resize(to_size(count));
    for (Index i = 0; i < count; ++i) {
        const Index top = root(i);  // never above i, so it is labeled already
        if (top == i) {
            result.label[to_size(i)] = result.count();
            result.sizes.push_back(0);
        } else {
            result.label[to_size(i)] = result.label[to_size(top)];
        }
        ++result.sizes[to_size(result.label[to_size(i)])];
    }
    return result;
}

Values local_spacing(const Positions& positions, const Neighborhoods& nearest, Index k) {
    const auto factor = [](std::size_t used) {
        return std::sqrt(std::numbers::pi / static_cast<double>(used));
    };
    const double of_most = factor(to_size(k));
    Values spacing(positions.rows());
    for (Index i = 0; i < positions.rows(); ++i) {
        const auto near = nearest[i];
        if (near.empty()) {
            spacing[i] = 0.0;
            continue;
        }
        const auto used = std::min<std::size_t>(near.size(), to_size(k));
        const double distance = (positions.row(near[used - 1]) - positions.row(i)).norm();
        spacing[i] = distance * (used == to_size(k) ? of_most : factor(used));
    }
    return spacing;
}

}  // namespace pointmorph
