#include "pointmorph/surface/free_loops.hpp"

#include <algorithm>
#include <array>
#include <numeric>

namespace pointmorph {

namespace {

/// Two vertices in one number, which sort as they do.
std::uint64_t packed(Index b, Index c) {
    return static_cast<std::uint64_t>(b) << 32 | static_cast<std::uint64_t>(c);
}

template <class Value>
void make_unique(std::vector<Value>& row) {
    std::ranges::sort(row);
    row.erase(std::unique(row.begin(), row.end()), row.end());
}

/// A sum over two elements: the terms that occur in it, ascending.
using Sum = std::vector<Index>;

/// Adds over two elements; `scratch` is memory to use again.
void add_to(Sum& sum, const Sum& other, Sum& scratch) {
    if (other.empty()) return;
    scratch.clear();
    std::ranges::set_symmetric_difference(sum, other, std::back_inserter(scratch));
    sum.swap(scratch);
}

/// Independent sums, by the reduction of columns of persistent homology (Edelsbrunner et al. 2002).
class IndependentSums {
public:
    explicit IndependentSums(Index terms) : with_last_(to_size(terms)) {}

    /// Whether it isn't a sum of those that are there.
    bool add(Sum sum) {
        while (!sum.empty() && !with_last(sum.back()).empty())
            add_to(sum, with_last(sum.back()), scratch_);
        if (sum.empty()) return false;
        Sum& place = with_last_[to_size(sum.back())];
        place = std::move(sum);
        ++count_;
        return true;
    }

    /// The one whose last term is this; empty where there is none.
    const Sum& with_last(Index term) const { return with_last_[to_size(term)]; }
    Index count() const { return count_; }

private:
    std::vector<Sum> with_last_;
    Index count_ = 0;
    Sum scratch_;
};

/// What edges come to where some sums of three come to nothing.
class EdgeSums {
public:
    static constexpr Index kNothing = 0;  ///< the number of all edges that come to nothing

    /// Of edges 1 … `edges`.
    explicit EdgeSums(Index edges) : stands_for_(to_size(edges) + 1), sums_of_(to_size(edges) + 1) {
        std::iota(stands_for_.begin(), stands_for_.end(), 0);
    }

    /// Three edges that come to nothing together. What follows by substitution, as long as a sum
    /// has no more than two unknown edges, is settled at once: nearly all of a surface's triangles.
    void add(const std::array<Index, 3>& sum) {
        std::array<Index, 3> left;
        if (settle(sum, left)) {
            follow_up();
            return;
        }
        for (const Index edge : left) sums_of_[to_size(edge)].push_back(to_index(sums_.size()));
        sums_.push_back(left);
        is_settled_.push_back(0);
    }

    /// Every edge as a sum of free ones, which are as many as `free()` says, by reduction of what
    /// is left.
    void solve() {
        const auto edges = to_index(stands_for_.size());
        IndependentSums rest(edges);
        for (std::size_t sum = 0; sum < sums_.size(); ++sum) {
            if (is_settled_[sum]) continue;
            std::array<Index, 3> left;
            const Index count = unknowns(sums_[sum], left);
            rest.add(Sum(left.begin(), left.begin() + count));
        }
        in_free_.resize(to_size(edges));
        Sum scratch;
        for (Index edge = 1; edge < edges; ++edge) {
            if (stands_for_[to_size(edge)] != edge) continue;
            const Sum& of_lower = rest.with_last(edge);
            if (of_lower.empty()) in_free_[to_size(edge)] = {free_++};
            for (const Index other : of_lower)
                if (other != edge)
                    add_to(in_free_[to_size(edge)], in_free_[to_size(other)], scratch);
        }
    }

    Index free() const { return free_; }
    const Sum& in_free(Index edge) { return in_free_[to_size(representative(edge))]; }

private:
    Index representative(Index edge) {
        while (stands_for_[to_size(edge)] != edge) {
            Index& above = stands_for_[to_size(edge)];
            above = stands_for_[to_size(above)];
            edge = above;
        }
        return edge;
    }

    /// What is left of a sum, ascending, at the front of `left`; returns how many.
    Index unknowns(const std::array<Index, 3>& sum, std::array<Index, 3>& left) {
        std::array<Index, 3> edges;
        std::ranges::transform(sum, edges.begin(), [&](Index e) { return representative(e); });
        std::ranges::sort(edges);
        Index count = 0;
        for (const Index edge : edges) {
            if (edge == kNothing) continue;
            if (count > 0 && left[to_size(count - 1)] == edge)
                --count;
            else
                left[to_size(count++)] = edge;
        }
        return count;
    }

    /// Whether a sum has no more than two unknown edges; all is said about them then.
    bool settle(const std::array<Index, 3>& sum, std::array<Index, 3>& left) {
        const Index count = unknowns(sum, left);
        if (count == 3) return false;
        if (count > 0) substitute(left[0], count == 1 ? kNothing : left[1]);
        return true;
    }

    /// Settles what substitutions have opened.
    void follow_up() {
        std::array<Index, 3> left;
        while (!open_.empty()) {
            const Index sum = open_.back();
            open_.pop_back();
            if (!is_settled_[to_size(sum)])
                is_settled_[to_size(sum)] = settle(sums_[to_size(sum)], left) ? 1 : 0;
        }
    }

    /// Puts one for the other; sums in which that may settle something are open then.
    void substitute(Index edge, Index by) {
        if (by != kNothing && sums_of_[to_size(edge)].size() > sums_of_[to_size(by)].size())
            std::swap(edge, by);
        stands_for_[to_size(edge)] = by;
        std::vector<Index>& of = sums_of_[to_size(edge)];
        open_.insert(open_.end(), of.begin(), of.end());
        if (by != kNothing)
            sums_of_[to_size(by)].insert(sums_of_[to_size(by)].end(), of.begin(), of.end());
        of = {};
    }

    std::vector<Index> stands_for_;            ///< up to the one that stands for itself
    std::vector<std::vector<Index>> sums_of_;  ///< of each that stands for itself: where it occurs
    std::vector<std::array<Index, 3>> sums_;
    std::vector<char> is_settled_;
    std::vector<Index> open_;   ///< sums to look at again
    std::vector<Sum> in_free_;  ///< of each that stands for itself
    Index free_ = 0;
};

/// Edges with their numbers: nothing for those of a spanning forest. Every loop is, up to edges of
/// the forest, the sum of its others.
struct NumberedEdges {
    std::vector<std::vector<Index>> ends;  ///< of each vertex: higher ones, ascending
    std::vector<std::vector<Index>> numbers;
    Index count = 0;

    explicit NumberedEdges(std::vector<std::vector<Index>> edges)
        : ends(std::move(edges)), numbers(ends.size()) {
        std::vector<Index> above(ends.size());
        std::iota(above.begin(), above.end(), 0);
        const auto root = [&](Index i) {
            while (above[to_size(i)] != i)
                i = above[to_size(i)] = above[to_size(above[to_size(i)])];
            return i;
        };
        for (Index a = 0; a < to_index(ends.size()); ++a) {
            make_unique(ends[to_size(a)]);
            for (const Index b : ends[to_size(a)]) {
                const Index i = root(a), j = root(b);
                above[to_size(i)] = j;
                numbers[to_size(a)].push_back(i == j ? ++count : EdgeSums::kNothing);
            }
        }
    }

    Index number(Index a, Index b) const {
        const auto& row = ends[to_size(std::min(a, b))];
        const auto place = std::ranges::lower_bound(row, std::max(a, b)) - row.begin();
        return numbers[to_size(std::min(a, b))][to_size(place)];
    }
};

/// `triangles`: of each vertex, as Complex keeps them.
EdgeSums solved(const NumberedEdges& edges, std::vector<std::vector<std::uint64_t>> triangles) {
    EdgeSums sums(edges.count);
    for (std::size_t a = 0; a < triangles.size(); ++a) {
        make_unique(triangles[a]);
        for (const std::uint64_t two : triangles[a]) {
            const auto first = to_index(a);
            const auto b = to_index(two >> 32);
            const auto c = to_index(two & 0xffffffffu);
            sums.add({edges.number(first, b), edges.number(first, c), edges.number(b, c)});
        }
    }
    sums.solve();
    return sums;
}

/// Loops that are left where those of three or four edges are spanned. Only loops with an edge that
/// doesn't come to nothing are looked at.
Index wide_loops(const NumberedEdges& edges, const Neighborhoods& around, EdgeSums& sums) {
    const auto in_free = [&](Index a, Index b) -> const Sum& {
        return sums.in_free(edges.number(a, b));
    };
    IndependentSums spanned(sums.free());
    Sum loop, scratch;
    std::vector<Index> both;
    for (Index a = 0; a < around.size(); ++a)
        for (const Index b : edges.ends[to_size(a)]) {
            if (in_free(a, b).empty()) continue;
            for (const Index c : around[b]) {
                if (c == a) continue;
                both.clear();
                std::ranges::set_intersection(around[a], around[c], std::back_inserter(both));
                for (const Index d : both) {
                    // Where d is b, three edges remain if a and c are joined.
                    const bool three = d == b;
                    if (three && !std::ranges::binary_search(around[a], c)) continue;
                    loop = in_free(a, b);
                    add_to(loop, in_free(b, c), scratch);
                    add_to(loop, three ? in_free(a, c) : in_free(c, d), scratch);
                    if (!three) add_to(loop, in_free(d, a), scratch);
                    spanned.add(loop);
                }
                if (spanned.count() == sums.free()) return 0;
            }
        }
    return sums.free() - spanned.count();
}

}  // namespace

Complex::Complex(Index vertices) : edges_(to_size(vertices)), triangles_(to_size(vertices)) {}

Complex::Complex(const Neighborhoods& graph) : Complex(graph.size()) {
    std::vector<Index> both;
    for (Index a = 0; a < graph.size(); ++a) {
        const auto higher = [&](Index i, Index than) {
            return std::span(std::ranges::upper_bound(graph[i], than), graph[i].end());
        };
        edges_[to_size(a)].assign(higher(a, a).begin(), higher(a, a).end());
        for (const Index b : edges_[to_size(a)]) {
            both.clear();
            std::ranges::set_intersection(higher(a, b), higher(b, b), std::back_inserter(both));
            for (const Index c : both) triangles_[to_size(a)].push_back(packed(b, c));
        }
    }
}

Index Complex::add_vertex() {
    edges_.emplace_back();
    triangles_.emplace_back();
    return size() - 1;
}

void Complex::add(std::span<const Index> simplex) {
    for (std::size_t a = 0; a < simplex.size(); ++a)
        for (std::size_t b = a + 1; b < simplex.size(); ++b) {
            edges_[to_size(simplex[a])].push_back(simplex[b]);
            for (std::size_t c = b + 1; c < simplex.size(); ++c)
                triangles_[to_size(simplex[a])].push_back(packed(simplex[b], simplex[c]));
        }
}

Neighborhoods Complex::neighbors() const {
    Neighborhoods result;
    for (std::vector<Index> row : edges_) {
        make_unique(row);
        result.indices.insert(result.indices.end(), row.begin(), row.end());
        result.offsets.push_back(static_cast<std::int64_t>(result.indices.size()));
    }
    return symmetrized(result);
}

EdgeLoops::EdgeLoops(const Complex& complex) {
    const NumberedEdges edges(complex.edges_);
    EdgeSums known = solved(edges, complex.triangles_);
    count = known.free();
    const Neighborhoods around = complex.neighbors();
    sums.reserve(around.indices.size());
    for (Index a = 0; a < around.size(); ++a)
        for (const Index b : around[a]) sums.push_back(known.in_free(edges.number(a, b)));
}

FreeLoops::FreeLoops(const Complex& complex) {
    const NumberedEdges edges(complex.edges_);
    EdgeSums sums = solved(edges, complex.triangles_);
    all = wide = sums.free();
    if (all > 0) wide = wide_loops(edges, complex.neighbors(), sums);
}

}  // namespace pointmorph
