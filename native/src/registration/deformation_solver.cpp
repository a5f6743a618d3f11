#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "base/compiler.hpp"
#include "pointmorph/registration/deformation.hpp"
#include "registration/padded_columns.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kSide = DeformationPattern::kSide, kTile = DeformationPattern::kTile;

template <class Numbers>
POINTMORPH_INLINE void subtract_products(const TileProducts& p) {
    for (std::size_t t = 0; t < p.count; ++t) {
        double* const to = p.sums + kTile * to_size(p.places[t]);
        Numbers columns[kSide], sum;
        POINTMORPH_UNROLL
        for (std::size_t k = 0; k < kSide; ++k) load(p.tiles + kTile * t + kSide * k, columns[k]);
        POINTMORPH_UNROLL
        for (std::size_t c = 0; c < kSide; ++c) {
            load(to + kSide * c, sum);
            POINTMORPH_UNROLL
            for (std::size_t k = 0; k < kSide; ++k) sum -= p.by[kSide * k + c] * columns[k];
            store(sum, to + kSide * c);
        }
    }
}

void subtract_products_plainly(const TileProducts& products) {
    subtract_products<TwoTwos>(products);
}

POINTMORPH_WIDE void subtract_products_wide(const TileProducts& products) {
    subtract_products<Four>(products);
}

/// Cholesky's factor of a tile on the diagonal, in place. Its diagonal is stored as its inverse.
void factorize_tile(double* tile) {
    POINTMORPH_UNROLL
    for (std::size_t c = 0; c < kSide; ++c) {
        double* const column = tile + kSide * c;
        const double inverse = 1.0 / std::sqrt(std::max(column[c], 1e-300));
        column[c] = inverse;
        POINTMORPH_UNROLL
        for (std::size_t r = c + 1; r < kSide; ++r) column[r] *= inverse;
        POINTMORPH_UNROLL
        for (std::size_t d = c + 1; d < kSide; ++d) {
            POINTMORPH_UNROLL
            for (std::size_t r = d; r < kSide; ++r) tile[kSide * d + r] -= column[r] * column[d];
        }
    }
}

/// What is left of a panel's tiles once the columns before have been taken from it, in `left`,
/// where a tile lies by its rows.
void take_panels_before(const DeformationPattern& p, std::size_t panel, const double* factor,
                        double* left, void (*subtract)(const TileProducts&)) {
    for (Index s = p.row_begins[panel]; s < p.row_begins[panel + 1]; ++s) {
        const auto [begin, end] = p.row_tiles[to_size(s)];
        const double* const tiles = factor + kTile * to_size(begin);
        subtract({tiles, tiles, p.tile_rows.data() + begin, to_size(end - begin), left});
    }
}

/// Panel by panel: what is left of it once the columns before have been taken from it.
template <class Numbers>
POINTMORPH_INLINE void fill_factor(const DeformationPattern& p, const double* values,
                                   double* factor, void (*subtract)(const TileProducts&)) {
    std::vector<double> of_panel(kTile * p.panels());  // by their rows
    double* const left = of_panel.data();
    const std::size_t count = p.order.size();
    for (std::size_t panel = 0; panel < p.panels(); ++panel) {
        const auto begin = to_size(p.tile_begins[panel]), end = to_size(p.tile_begins[panel + 1]);
        for (std::size_t t = begin; t < end; ++t)
            std::fill_n(left + kTile * to_size(p.tile_rows[t]), kTile, 0.0);
        for (Index v = p.value_begins[panel]; v < p.value_begins[panel + 1]; ++v)
            left[p.value_places[to_size(v)]] = values[to_size(v)];
        double* const first = left + kTile * panel;
        for (std::size_t k = kSide * panel; k < kSide * (panel + 1); ++k)
            if (k >= count) first[(kSide + 1) * (k % kSide)] = 1.0;  // the last panel may be wider
        take_panels_before(p, panel, factor, left, subtract);
        factorize_tile(first);
        std::copy_n(first, kTile, factor + kTile * begin);
        for (std::size_t t = begin + 1; t < end; ++t) {
            Numbers columns[kSide];
            POINTMORPH_UNROLL
            for (std::size_t c = 0; c < kSide; ++c) {
                load(left + kTile * to_size(p.tile_rows[t]) + kSide * c, columns[c]);
                POINTMORPH_UNROLL
                for (std::size_t k = 0; k < c; ++k) columns[c] -= first[kSide * k + c] * columns[k];
                columns[c] = first[(kSide + 1) * c] * columns[c];
                store(columns[c], factor + kTile * t + kSide * c);
            }
        }
    }
}

POINTMORPH_WIDE void fill_factor_wide(const DeformationPattern& pattern, const double* values,
                                      double* factor) {
    fill_factor<Four>(pattern, values, factor,
                      has_widest_registers() ? subtract_products_widest : subtract_products_wide);
}

/// Solves L Lᵀ x = b for three right sides at once, in place.
template <class Numbers>
POINTMORPH_INLINE void substitute(const DeformationPattern& p, const double* factor,
                                  std::vector<PaddedColumn>& sides) {
    Numbers own[kSide], its;
    for (std::size_t panel = 0; panel < p.panels(); ++panel) {
        const auto begin = to_size(p.tile_begins[panel]), end = to_size(p.tile_begins[panel + 1]);
        const double* tile = factor + kTile * begin;
        POINTMORPH_UNROLL
        for (std::size_t c = 0; c < kSide; ++c) {
            load(sides[kSide * panel + c], own[c]);
            POINTMORPH_UNROLL
            for (std::size_t k = 0; k < c; ++k) own[c] -= tile[kSide * k + c] * own[k];
            own[c] = tile[(kSide + 1) * c] * own[c];
            store(own[c], sides[kSide * panel + c]);
        }
        for (std::size_t t = begin + 1; t < end; ++t) {
            tile += kTile;
            PaddedColumn* const rows = sides.data() + kSide * to_size(p.tile_rows[t]);
            POINTMORPH_UNROLL
            for (std::size_t r = 0; r < kSide; ++r) {
                load(rows[r], its);
                POINTMORPH_UNROLL
                for (std::size_t c = 0; c < kSide; ++c) its -= tile[kSide * c + r] * own[c];
                store(its, rows[r]);
            }
        }
    }
    for (std::size_t panel = p.panels(); panel-- > 0;) {
        const auto begin = to_size(p.tile_begins[panel]), end = to_size(p.tile_begins[panel + 1]);
        POINTMORPH_UNROLL
        for (std::size_t c = 0; c < kSide; ++c) load(sides[kSide * panel + c], own[c]);
        for (std::size_t t = begin + 1; t < end; ++t) {
            const double* const tile = factor + kTile * t;
            const PaddedColumn* const rows = sides.data() + kSide * to_size(p.tile_rows[t]);
            POINTMORPH_UNROLL
            for (std::size_t r = 0; r < kSide; ++r) {
                load(rows[r], its);
                POINTMORPH_UNROLL
                for (std::size_t c = 0; c < kSide; ++c) own[c] -= tile[kSide * c + r] * its;
            }
        }
        const double* const tile = factor + kTile * begin;
        POINTMORPH_UNROLL
        for (std::size_t last = 0; last < kSide; ++last) {
            const std::size_t c = kSide - 1 - last;
            POINTMORPH_UNROLL
            for (std::size_t k = c + 1; k < kSide; ++k) own[c] -= tile[kSide * c + k] * own[k];
            own[c] = tile[(kSide + 1) * c] * own[c];
            store(own[c], sides[kSide * panel + c]);
        }
    }
}

POINTMORPH_WIDE void substitute_wide(const DeformationPattern& pattern, const double* factor,
                                     std::vector<PaddedColumn>& sides) {
    substitute<Four>(pattern, factor, sides);
}

/// What the nodes are drawn to: the right sides of the system, by its rows.
class RightSides {
public:
    RightSides(const Positions& positions, const DeformationGraph& graph,
               const DeformationPattern& pattern, const Deformation& deformation)
        : positions_(positions), graph_(graph), pattern_(pattern), moves_(to_size(graph.size())) {
        // X(p) = Σ w (x_k + linear_k p − constant_k)
        for (std::size_t k = 0; k < moves_.size(); ++k) {
            Move& move = moves_[k];
            move.linear = scaled(deformation.rotations[k], deformation.scales[to_index(k)]);
            move.constant = product(move.linear, positions.data() + 3 * graph.node_rows[k]);
        }
    }

    POINTMORPH_WIDE void add_up_wide(double stiffness, std::span<const Attraction> attractions,
                                     std::vector<PaddedColumn>& right) const {
        add_up<Four>(stiffness, attractions, right);
    }

    template <class Numbers>
    POINTMORPH_INLINE void add_up(double stiffness, std::span<const Attraction> attractions,
                                  std::vector<PaddedColumn>& right) const {
        for (Index i = 0; i < graph_.size(); ++i) {
            Numbers sum{}, its;
            for (auto e = to_size(graph_.edge_offsets[to_size(i)]);
                 e < to_size(graph_.edge_offsets[to_size(i) + 1]); ++e) {
                step(i, graph_.edge_ends[e], its);
                sum += stiffness * graph_.edge_weights[e] * 0.5 * its;
            }
            store(sum, right[row_of(i)]);
        }
        for (const Attraction& a : attractions) add<Numbers>(a, right);
    }

private:
    struct Move {
        PaddedColumns linear;
        PaddedColumn constant;
    };

    std::size_t row_of(Index node) const { return to_size(pattern_.order[to_size(node)]); }

    /// From node j to node i, as far as both have turned and grown, twice.
    template <class Numbers>
    POINTMORPH_INLINE void step(Index i, Index j, Numbers& its) const {
        const double* const here = positions_.data() + 3 * graph_.node_rows[to_size(i)];
        const double* const there = positions_.data() + 3 * graph_.node_rows[to_size(j)];
        const double rest[3] = {here[0] - there[0], here[1] - there[1], here[2] - there[2]};
        const PaddedColumns &own = moves_[to_size(i)].linear, &other = moves_[to_size(j)].linear;
        Numbers x, y, z;
        load(own[0], x);
        load(own[1], y);
        load(own[2], z);
        load(other[0], its);
        x += its;
        load(other[1], its);
        y += its;
        load(other[2], its);
        z += its;
        multiply(x, y, z, rest, its);
    }

    template <class Numbers>
    POINTMORPH_INLINE void add(const Attraction& a, std::vector<PaddedColumn>& right) const {
        const auto& weights = graph_.point_weights[to_size(a.point)];
        const auto& nodes = graph_.point_nodes[to_size(a.point)];
        Numbers wanted, x, y, z, moved, its;
        load(padded(a.target), wanted);
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {
            const Move& move = moves_[to_size(nodes[k])];
            load(move.linear[0], x);
            load(move.linear[1], y);
            load(move.linear[2], z);
            multiply(x, y, z, positions_.data() + 3 * a.point, moved);
            load(move.constant, its);
            moved -= its;
            wanted -= weights[k] * moved;
        }
        wanted = a.weight * wanted;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {
            PaddedColumn& row = right[row_of(nodes[k])];
            load(row, its);
            its += weights[k] * wanted;
            store(its, row);
        }
    }

    const Positions& positions_;
    const DeformationGraph& graph_;
    const DeformationPattern& pattern_;
    std::vector<Move> moves_;  ///< of the nodes
};

}  // namespace

DeformationSolver::DeformationSolver(const Positions& positions, const DeformationGraph& graph)
    : positions_(positions),
      graph_(graph),
      pattern_(*graph.pattern),
      values_(pattern_.value_places.size()),
      factor_(kTile * pattern_.tile_rows.size()) {}

void DeformationSolver::factorize(double stiffness, std::span<const Attraction> attractions) {
    stiffness_ = stiffness;
    double* const values = values_.data();
    std::ranges::fill(values_, 0.0);
    // A trace of the identity holds what nothing else holds.
    for (Index i = 0; i < graph_.size(); ++i) values[pattern_.diagonal[to_size(i)]] = 1e-9;
    for (Index i = 0; i < graph_.size(); ++i)
        for (auto e = to_size(graph_.edge_offsets[to_size(i)]);
             e < to_size(graph_.edge_offsets[to_size(i) + 1]); ++e) {
            values[pattern_.diagonal[to_size(i)]] += stiffness * graph_.edge_weights[e];
            if (pattern_.laplacian[e] >= 0)
                values[pattern_.laplacian[e]] -= stiffness * graph_.edge_weights[e];
        }
    for (const Attraction& a : attractions) {
        const auto& weights = graph_.point_weights[to_size(a.point)];
        const auto& block = pattern_.blocks[to_size(a.point)];
        std::size_t b = 0;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {  // no node twice but with a weight of 0
            const double weight = a.weight * weights[k];
            for (std::size_t l = 0; l <= k; ++l, ++b) values[block[b]] += weight * weights[l];
        }
    }
    if (has_wide_registers())
        fill_factor_wide(pattern_, values, factor_.data());
    else
        fill_factor<TwoTwos>(pattern_, values, factor_.data(), subtract_products_plainly);
}

void DeformationSolver::solve(std::span<const Attraction> attractions,
                              Deformation& deformation) const {
    const RightSides sides(positions_, graph_, pattern_, deformation);
    std::vector<PaddedColumn> right(kSide * pattern_.panels(), PaddedColumn{});
    if (has_wide_registers()) {
        sides.add_up_wide(stiffness_, attractions, right);
        substitute_wide(pattern_, factor_.data(), right);
    } else {
        sides.add_up<TwoTwos>(stiffness_, attractions, right);
        substitute<TwoTwos>(pattern_, factor_.data(), right);
    }
    deformation.positions.resize(graph_.size(), 3);
    for (Index i = 0; i < graph_.size(); ++i)
        deformation.positions.row(i) =
            Eigen::Map<const Eigen::RowVector3d>(right[to_size(pattern_.order[to_size(i)])].data());
}

}  // namespace pointmorph
