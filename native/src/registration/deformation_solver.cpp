#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "base/compiler.hpp"
#include "pointmorph/registration/deformation.hpp"
#include "registration/padded_columns.hpp"

namespace pointmorph {

namespace {

/// Row by row: what is left of a row once the columns before have been taken from it. Diagonals are
/// stored as their inverses.
POINTMORPH_INLINE void fill_factor(const DeformationPattern& p, std::span<const double> matrix,
                                   std::span<double> its_factor) {
    const Index count = to_index(p.order.size());
    const Index* const outer = p.matrix.outerIndexPtr();
    const Index* const inner = p.matrix.innerIndexPtr();
    double* const POINTMORPH_RESTRICT factor = its_factor.data();
    std::vector<double> left(to_size(count), 0.0);
    double* const POINTMORPH_RESTRICT row = left.data();
    for (Index k = 0; k < count; ++k) {
        for (Index e = outer[k]; e < outer[k + 1]; ++e) row[inner[e]] = matrix[to_size(e)];
        double diagonal = row[k];
        for (Index e = p.row_begins[to_size(k)]; e < p.row_begins[to_size(k) + 1]; ++e) {
            const Index i = p.row_columns[to_size(e)], end = p.row_places[to_size(e)];
            const Index begin = p.columns[to_size(i)];
            const double entry = row[i] * factor[begin];
            row[i] = 0.0;
            const Index dense = std::min(p.dense_from[to_size(i)], end);
            Index at = begin + 1;
            for (; at < dense; ++at) row[p.rows[to_size(at)]] -= factor[at] * entry;
            if (at < end) {
                double* const POINTMORPH_RESTRICT rest = row + p.rows[to_size(at)];
                for (Index j = 0; j < end - at; ++j) rest[j] -= factor[at + j] * entry;
            }
            diagonal -= entry * entry;
            factor[end] = entry;
        }
        row[k] = 0.0;
        factor[p.columns[to_size(k)]] = 1.0 / std::sqrt(std::max(diagonal, 1e-300));
    }
}

POINTMORPH_WIDE void fill_factor_wide(const DeformationPattern& pattern,
                                      std::span<const double> matrix, std::span<double> factor) {
    fill_factor(pattern, matrix, factor);
}

/// Solves L Lᵀ x = b for three right sides at once, in place.
POINTMORPH_INLINE void substitute(const DeformationPattern& p, std::span<const double> factor,
                                  std::vector<PaddedColumn>& sides) {
    const std::size_t count = sides.size();
    Four here, there;
    for (std::size_t k = 0; k < count; ++k) {
        const auto begin = to_size(p.columns[k]), end = to_size(p.columns[k + 1]);
        std::memcpy(&here, sides[k].data(), sizeof here);
        here = factor[begin] * here;
        std::memcpy(sides[k].data(), &here, sizeof here);
        for (std::size_t at = begin + 1; at < end; ++at) {
            double* const row = sides[to_size(p.rows[at])].data();
            std::memcpy(&there, row, sizeof there);
            there -= factor[at] * here;
            std::memcpy(row, &there, sizeof there);
        }
    }
    for (std::size_t k = count; k-- > 0;) {
        const auto begin = to_size(p.columns[k]), end = to_size(p.columns[k + 1]);
        std::memcpy(&here, sides[k].data(), sizeof here);
        for (std::size_t at = begin + 1; at < end; ++at) {
            std::memcpy(&there, sides[to_size(p.rows[at])].data(), sizeof there);
            here -= factor[at] * there;
        }
        here = factor[begin] * here;
        std::memcpy(sides[k].data(), &here, sizeof here);
    }
}

POINTMORPH_WIDE void substitute_wide(const DeformationPattern& pattern,
                                     std::span<const double> factor,
                                     std::vector<PaddedColumn>& sides) {
    substitute(pattern, factor, sides);
}

/// What the nodes are drawn to: the right sides of the system, by its rows.
class RightSides {
public:
    RightSides(const Positions& positions, const DeformationGraph& graph,
               const DeformationPattern& pattern, const Deformation& deformation)
        : positions_(positions), graph_(graph), pattern_(pattern) {
        // X(p) = Σ w (x_k + linear_k p − constant_k)
        for (Index k = 0; k < graph.size(); ++k) {
            const Matrix3 linear = deformation.scales[k] * deformation.rotations[to_size(k)];
            const Vector3 constant =
                linear * positions.row(graph.node_rows[to_size(k)]).transpose();
            moves_.push_back({padded(linear), padded(constant)});
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
      matrix_(to_size(graph.pattern->matrix.nonZeros())),
      factor_(graph.pattern->rows.size()) {}

void DeformationSolver::factorize(double stiffness, std::span<const Attraction> attractions) {
    stiffness_ = stiffness;
    double* const values = matrix_.data();
    std::ranges::fill(matrix_, 0.0);
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
        const auto& nodes = graph_.point_nodes[to_size(a.point)];
        const auto& block = pattern_.blocks[to_size(a.point)];
        std::size_t b = 0;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k)
            for (std::size_t l = 0; l <= k; ++l, ++b)
                values[block[b]] += (k != l && nodes[k] == nodes[l] ? 2.0 : 1.0) * a.weight *
                                    weights[k] * weights[l];
    }
    (has_wide_registers() ? fill_factor_wide : fill_factor)(pattern_, matrix_, factor_);
}

void DeformationSolver::solve(std::span<const Attraction> attractions,
                              Deformation& deformation) const {
    const RightSides sides(positions_, graph_, pattern_, deformation);
    std::vector<PaddedColumn> right(to_size(graph_.size()), PaddedColumn{});
    if (has_wide_registers()) {
        sides.add_up_wide(stiffness_, attractions, right);
        substitute_wide(pattern_, factor_, right);
    } else {
        sides.add_up<TwoTwos>(stiffness_, attractions, right);
        substitute(pattern_, factor_, right);
    }
    deformation.positions.resize(graph_.size(), 3);
    for (Index i = 0; i < graph_.size(); ++i)
        deformation.positions.row(i) =
            Eigen::Map<const Eigen::RowVector3d>(right[to_size(pattern_.order[to_size(i)])].data());
}

}  // namespace pointmorph
