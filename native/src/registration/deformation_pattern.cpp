#include <Eigen/OrderingMethods>
#include <algorithm>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/registration/deformation.hpp"

namespace pointmorph {

namespace {

constexpr Index kWide = DeformationPattern::kSide;

struct Entry {
    Index list, item;
};

/// Lists of items, one after the other.
struct Lists {
    std::vector<Index> begins;
    std::vector<Index> items;  ///< of each list in the order in which they were given

    Lists(Index count, const std::vector<Entry>& entries)
        : begins(to_size(count) + 1, 0), items(entries.size()) {
        for (const Entry& entry : entries) ++begins[to_size(entry.list) + 1];
        for (std::size_t i = 1; i < begins.size(); ++i) begins[i] += begins[i - 1];
        std::vector<Index> next(begins.begin(), begins.end() - 1);
        for (const Entry& entry : entries) items[to_size(next[to_size(entry.list)]++)] = entry.item;
    }
    std::span<const Index> of(Index list) const {
        const auto begin = to_size(begins[to_size(list)]), end = to_size(begins[to_size(list) + 1]);
        return std::span(items).subspan(begin, end - begin);
    }
};

/// Two nodes that meet in the equations.
struct Meeting {
    Index larger, smaller;
};

/// All of them, and who asks for the place of their value.
class Meetings {
public:
    explicit Meetings(Index nodes) : nodes_(nodes) {}

    void add(Index i, Index j, Index& asks) {
        const auto [smaller, larger] = std::minmax(i, j);
        asked_.push_back({larger, to_index(asks_.size())});
        asks_.push_back({smaller, &asks});
    }
    /// Each pair once. From now on who asks has its number.
    std::vector<Meeting> numbered() {
        std::vector<Meeting> pairs;
        std::vector<Index> last(to_size(nodes_), -1), number(to_size(nodes_));
        const Lists lists(nodes_, asked_);
        for (Index i = 0; i < nodes_; ++i)
            for (const Index k : lists.of(i)) {
                const auto [j, asks] = asks_[to_size(k)];
                if (std::exchange(last[to_size(j)], i) != i) {
                    number[to_size(j)] = to_index(pairs.size());
                    pairs.push_back({i, j});
                }
                *asks = number[to_size(j)];
            }
        return pairs;
    }
    void renumber(const std::vector<Index>& numbers) {
        for (const auto& [other, asks] : asks_) *asks = numbers[to_size(*asks)];
    }

private:
    Index nodes_;
    std::vector<Entry> asked_;  ///< the larger node, and which of asks_
    std::vector<std::pair<Index, Index*>> asks_;
};

Meetings meetings(const DeformationGraph& graph, DeformationPattern& pattern) {
    Meetings all(graph.size());
    pattern.diagonal.resize(to_size(graph.size()));
    pattern.laplacian.assign(graph.edge_ends.size(), -1);
    pattern.blocks.resize(graph.point_nodes.size());
    for (Index i = 0; i < graph.size(); ++i) {
        all.add(i, i, pattern.diagonal[to_size(i)]);
        for (auto e = to_size(graph.edge_offsets[to_size(i)]);
             e < to_size(graph.edge_offsets[to_size(i) + 1]); ++e)
            if (graph.edge_ends[e] < i) all.add(i, graph.edge_ends[e], pattern.laplacian[e]);
    }
    for (std::size_t p = 0; p < pattern.blocks.size(); ++p) {
        const auto& nodes = graph.point_nodes[p];
        std::size_t b = 0;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k)
            for (std::size_t l = 0; l <= k; ++l)
                all.add(nodes[k], nodes[l], pattern.blocks[p][b++]);
    }
    return all;
}

/// The row of each node that keeps factors sparse.
std::vector<Index> minimum_degree_order(Index count, const std::vector<Meeting>& pairs) {
    using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;
    std::vector<Eigen::Triplet<double, Index>> entries;
    entries.reserve(pairs.size());
    for (const Meeting& pair : pairs) entries.emplace_back(pair.larger, pair.smaller, 1.0);
    Matrix lower(count, count);
    lower.setFromTriplets(entries.begin(), entries.end());
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, Index> node_of;
    Eigen::AMDOrdering<Index>()(lower.selfadjointView<Eigen::Lower>(), node_of);
    std::vector<Index> order(to_size(count));
    for (Index row = 0; row < count; ++row) order[to_size(node_of.indices()[row])] = row;
    return order;
}

/// Of each row those before it that it meets.
Lists rows_in(const std::vector<Index>& order, const std::vector<Meeting>& pairs) {
    std::vector<Entry> entries;
    for (const Meeting& pair : pairs) {
        const auto [before, row] =
            std::minmax(order[to_size(pair.larger)], order[to_size(pair.smaller)]);
        if (before != row) entries.push_back({row, before});
    }
    return {to_index(order.size()), entries};
}

/// The elimination tree: of each row the first one after it that its column of the factor has, or
/// −1 (Liu, The role of elimination trees in sparse factorization, 1990).
std::vector<Index> elimination_tree(const Lists& rows, Index count) {
    std::vector<Index> parent(to_size(count), -1), ancestor(to_size(count), -1);
    for (Index k = 0; k < count; ++k)
        for (Index i : rows.of(k))
            while (i >= 0 && i < k) {
                const Index next = std::exchange(ancestor[to_size(i)], k);
                if (next < 0) parent[to_size(i)] = k;
                i = next;
            }
    return parent;
}

/// Where each row of the tree comes when those below it come right before it, so that rows of the
/// factor that have much in common lie side by side.
std::vector<Index> postorder(const std::vector<Index>& parent) {
    const Index count = to_index(parent.size());
    std::vector<Index> size(parent.size(), 1), place(parent.size());
    for (Index i = 0; i < count; ++i)
        if (parent[to_size(i)] >= 0) size[to_size(parent[to_size(i)])] += size[to_size(i)];
    std::vector<Index> end(parent.size());  // of what isn't placed yet below each
    Index end_of_all = count;
    for (Index i = count; i-- > 0;) {
        const Index above = parent[to_size(i)];
        Index& its_end = above < 0 ? end_of_all : end[to_size(above)];
        place[to_size(i)] = end[to_size(i)] = its_end - 1;
        its_end -= size[to_size(i)];
    }
    return place;
}

/// The tiles of the factor that aren't empty, by panels.
void find_tiles(const Lists& rows, Index count, DeformationPattern& pattern) {
    const Index panels = (count + kWide - 1) / kWide;
    const std::vector<Index> parent = elimination_tree(rows, count);
    std::vector<Index> seen(to_size(count), -1), last(to_size(panels), -1);
    std::vector<Entry> tiles;
    for (Index k = 0; k < count; ++k) {
        const auto add = [&](Index i) {  // the factor has an entry there
            if (std::exchange(last[to_size(i / kWide)], k / kWide) != k / kWide)
                tiles.push_back({i / kWide, k / kWide});
        };
        seen[to_size(k)] = k;
        add(k);
        for (Index i : rows.of(k))
            for (; seen[to_size(i)] != k; i = parent[to_size(i)]) {
                seen[to_size(i)] = k;
                add(i);
            }
    }
    Lists by_panel(panels, tiles);
    std::vector<Entry> sources;
    for (Index panel = 0; panel < panels; ++panel)
        for (Index t = by_panel.begins[to_size(panel)] + 1; t < by_panel.begins[to_size(panel) + 1];
             ++t)
            sources.push_back({by_panel.items[to_size(t)], t});
    Lists by_row(panels, sources);
    pattern.tile_begins = std::move(by_panel.begins);
    pattern.tile_rows = std::move(by_panel.items);
    pattern.row_begins = std::move(by_row.begins);
    for (const Index tile : by_row.items) {
        const auto end = std::ranges::upper_bound(pattern.tile_begins, tile);
        pattern.row_tiles.push_back({tile, *end});
    }
}

}  // namespace

std::shared_ptr<const DeformationPattern> deformation_pattern(const DeformationGraph& graph) {
    const Index count = graph.size();
    DeformationPattern result;
    Meetings all = meetings(graph, result);
    const std::vector<Meeting> pairs = all.numbered();
    result.order = minimum_degree_order(count, pairs);
    const std::vector<Index> place =
        postorder(elimination_tree(rows_in(result.order, pairs), count));
    for (Index& row : result.order) row = place[to_size(row)];
    find_tiles(rows_in(result.order, pairs), count, result);

    std::vector<Entry> values;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
        const auto [i, j] = pairs[k];
        values.push_back(
            {std::min(result.order[to_size(i)], result.order[to_size(j)]) / kWide, to_index(k)});
    }
    Lists by_panel(to_index(result.tile_begins.size()) - 1, values);
    std::vector<Index> numbers(pairs.size());
    for (const Index k : by_panel.items) {
        const auto [i, j] = pairs[to_size(k)];
        const auto [column, row] = std::minmax(result.order[to_size(i)], result.order[to_size(j)]);
        numbers[to_size(k)] = to_index(result.value_places.size());
        result.value_places.push_back(kWide * (kWide * (row / kWide) + column % kWide) +
                                      row % kWide);
    }
    result.value_begins = std::move(by_panel.begins);
    all.renumber(numbers);
    return std::make_shared<const DeformationPattern>(std::move(result));
}

}  // namespace pointmorph
