// Descent for places on the unit sphere; not for callers of the library.
#pragma once

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <concepts>
#include <deque>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/surface/local_triangles.hpp"

namespace pointmorph {

/// Smooths directions: the inverse of S (L + ε) S, where L is a Laplacian of a mesh's edges and S a
/// scale for each vertex; 0 at the vertices that are fixed.
class Smoother {
public:
    /// `weights`: see set_weights().
    Smoother(std::span<const Triangle> triangles, Index count, std::span<const Index> fixed,
             std::span<const Vector3> weights = {})
        : free_(to_size(count), 0), scales_(Values::Ones(count)) {
        for (const Index f : fixed) free_[to_size(f)] = -1;
        Index unknowns = 0;
        for (Index& f : free_)
            if (f >= 0) f = unknowns++;
        std::vector<Eigen::Triplet<double, Index>> entries;
        for (const Triangle& triangle : triangles)
            for (std::size_t k = 0; k < 3; ++k) {
                const Index a = triangle[(k + 1) % 3], b = triangle[(k + 2) % 3];
                const Index i = free_[to_size(a)], j = free_[to_size(b)];
                for (const auto& [row, column] : {std::pair(i, i), {j, j}, {i, j}})
                    if (row >= 0 && column >= 0)
                        entries.emplace_back(std::max(row, column), std::min(row, column), 0.0);
                if (i >= 0 && j < 0) pulls_.push_back({i, b, 0.0});
                if (j >= 0 && i < 0) pulls_.push_back({j, a, 0.0});
            }
        matrix_.resize(unknowns, unknowns);
        matrix_.setFromTriplets(entries.begin(), entries.end());
        find_places(triangles);
        cholesky_.analyzePattern(matrix_);
        for (Index& f : free_)
            if (f >= 0) f = cholesky_.permutationP().indices()[f];
        for (Pull& p : pulls_) p.row = cholesky_.permutationP().indices()[p.row];
        set_weights(weights);
    }

    /// Those of the edges across from each triangle's corners, > 0 or nearly; each edge has two.
    /// None: all are 1. Takes less time than another smoother.
    void set_weights(std::span<const Vector3> weights) {
        constexpr double kShift = 1e-3, kLeast = 0.05;
        double* const values = matrix_.valuePtr();
        std::fill(values, values + matrix_.nonZeros(), 0.0);
        auto pull = pulls_.begin();
        for (std::size_t e = 0; e < edges_.size(); ++e) {
            const double weight =
                weights.empty() ? 1.0 : std::max(kLeast, weights[e / 3][Index(e % 3)]);
            const auto& [from, to, between] = edges_[e];
            if (from >= 0) values[from] += (1.0 + kShift) * weight;
            if (to >= 0) values[to] += (1.0 + kShift) * weight;
            if (between >= 0) values[between] -= weight;
            if ((from >= 0) != (to >= 0)) (pull++)->weight = weight;
        }
        cholesky_.factorize(matrix_);
    }

    void set_scales(Values scales) { scales_ = std::move(scales); }

    Positions operator()(const Positions& directions) const {
        Rows rows = Rows::Zero(cholesky_.rows(), 4);
        for (std::size_t v = 0; v < free_.size(); ++v)
            if (free_[v] >= 0)
                rows.row(free_[v]).head<3>() = directions.row(Index(v)) / scales_[Index(v)];
        return spread(std::move(rows), Positions::Zero(directions.rows(), 3));
    }

    /// The smoothest directions that are as given at the fixed vertices.
    Positions extended(const Positions& at_fixed) const {
        Rows rows = Rows::Zero(cholesky_.rows(), 4);
        for (const Pull& p : pulls_) rows.row(p.row).head<3>() += p.weight * at_fixed.row(p.fixed);
        return spread(std::move(rows), at_fixed);
    }

private:
    using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;
    /// Three columns and an empty one, so that a row fills registers; in the order of the factor.
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
    /// Of a fixed vertex at a row of the matrix.
    struct Pull {
        Index row, fixed;
        double weight;
    };

    /// Of the edge across from a triangle's corner: where among the matrix's values those of both
    /// ends and of the edge stand, or −1.
    struct Edge {
        Index from, to, between;
    };

    void find_places(std::span<const Triangle> triangles) {
        const auto place = [&](Index i, Index j) -> Index {
            if (i < 0 || j < 0) return -1;
            const Index* const begin = matrix_.innerIndexPtr();
            const Index column = std::min(i, j);
            return to_index(std::lower_bound(begin + matrix_.outerIndexPtr()[column],
                                             begin + matrix_.outerIndexPtr()[column + 1],
                                             std::max(i, j)) -
                            begin);
        };
        for (const Triangle& triangle : triangles)
            for (std::size_t k = 0; k < 3; ++k) {
                const Index i = free_[to_size(triangle[(k + 1) % 3])],
                            j = free_[to_size(triangle[(k + 2) % 3])];
                edges_.push_back({place(i, i), place(j, j), place(i, j)});
            }
    }

    /// Solves for all columns in one pass over the factor and one back.
    void solve(Rows& rows) const {
        using Row = Eigen::RowVector4d;
        const auto& factor = cholesky_.matrixL().nestedExpression();
        const Index* starts = factor.outerIndexPtr();
        const Index* at = factor.innerIndexPtr();
        const double* values = factor.valuePtr();
        const auto count = to_index(rows.rows());
        for (Index i = 0; i < count; ++i) {
            const Row there = rows.row(i) /= values[starts[i]];
            for (Index k = starts[i] + 1; k < starts[i + 1]; ++k)
                rows.row(at[k]) -= values[k] * there;
        }
        for (Index i = count - 1; i >= 0; --i) {
            Row there = rows.row(i);
            for (Index k = starts[i] + 1; k < starts[i + 1]; ++k)
                there -= values[k] * rows.row(at[k]);
            rows.row(i) = there / values[starts[i]];
        }
    }

    Positions spread(Rows rows, Positions result) const {
        solve(rows);
        for (std::size_t v = 0; v < free_.size(); ++v)
            if (free_[v] >= 0)
                result.row(Index(v)) = rows.row(free_[v]).head<3>() / scales_[Index(v)];
        return result;
    }

    std::vector<Index> free_;  ///< row of the factor of each vertex that isn't fixed
    std::vector<Pull> pulls_;
    std::vector<Edge> edges_;  ///< three of each triangle
    Values scales_;
    Matrix matrix_;
    Eigen::SimplicialLLT<Matrix, Eigen::Lower, Eigen::AMDOrdering<Index>> cholesky_;
};

/// Whether a step turns a triangle over, as most of those do that are too long. The triangle that
/// did so last is looked at first.
class Folds {
public:
    explicit Folds(std::span<const Triangle> triangles) : triangles_(triangles) {}

    /// Of places + length · way.
    bool turn_over(const Positions& places, const Positions& way, double length) {
        const auto turns = [&](std::size_t t) {
            const auto place = [&](Index v) -> Vector3 {
                return (places.row(v) + length * way.row(v)).transpose();
            };
            const auto& [a, b, c] = triangles_[t];
            return !(place(a).dot(place(b).cross(place(c))) > 0.0);
        };
        if (turns(last_)) return true;
        for (std::size_t t = 0; t < triangles_.size(); ++t)
            if (turns(t)) {
                last_ = t;
                return true;
            }
        return false;
    }

private:
    std::span<const Triangle> triangles_;
    std::size_t last_ = 0;
};

/// Quasi-Newton descent (L-BFGS) from where `energy` is finite. `energy.at(places)` may be infinite
/// elsewhere, and is wherever a triangle is turned over; `energy.add_gradient(places, gradient)`
/// follows at the same places. Ends after `iterations`, or when it hardly gains. Returns the
/// energy.
template <class Energy>
double descend(Positions& places, std::span<const Triangle> triangles, const Smoother& smooth,
               int iterations, Energy&& energy, Progress& progress) {
    constexpr std::size_t kMemory = 8;
    constexpr double kSufficient = 1e-4, kGain = 1e-6;
    constexpr int kHalvings = 25;
    struct Step {
        Positions way, change;
        double product;
    };
    std::deque<Step> steps;
    const auto tangent = [&](Positions& directions) {
        const Values along = directions.cwiseProduct(places).rowwise().sum();
        directions -= along.asDiagonal() * places;
    };
    Positions gradient = Positions::Zero(places.rows(), 3);
    double present = energy.at(places);
    energy.add_gradient(places, gradient);
    tangent(gradient);
    Folds folds(triangles);
    int poor = 0;
    for (int iteration = 0; iteration < iterations; ++iteration) {
        progress.throw_if_cancelled();
        Positions way = gradient;
        std::vector<double> shares;
        for (auto s = steps.rbegin(); s != steps.rend(); ++s) {
            shares.push_back(s->way.cwiseProduct(way).sum() / s->product);
            way -= shares.back() * s->change;
        }
        way = smooth(way);
        for (const Step& s : steps) {
            const double share = s.change.cwiseProduct(way).sum() / s.product;
            way += (shares.back() - share) * s.way;
            shares.pop_back();
        }
        way = -way;
        tangent(way);
        double slope = way.cwiseProduct(gradient).sum();
        if (!(slope < 0.0)) {
            if (steps.empty()) break;
            steps.clear();
            continue;
        }
        // No point goes farther than this at once.
        constexpr double kFarthest = 0.2;
        double length = std::min(1.0, kFarthest / way.rowwise().norm().maxCoeff());
        Positions there;
        double energy_there = present;
        bool gained = false;
        for (int k = 0; k < kHalvings && !gained; ++k, length *= 0.5) {
            if (folds.turn_over(places, way, length)) continue;
            there = (places + length * way).rowwise().normalized();
            energy_there = energy.at(there);
            gained = energy_there <= present + kSufficient * length * slope;
        }
        if (!gained) {
            if (steps.empty()) break;
            steps.clear();
            continue;
        }
        Step step{there - places, -gradient, 0.0};
        places = there;
        gradient.setZero();
        energy.add_gradient(places, gradient);
        tangent(gradient);
        step.change += gradient;
        step.product = step.way.cwiseProduct(step.change).sum();
        const double gain = present - energy_there;
        present = energy_there;
        if (step.product > 1e-12 * step.change.squaredNorm()) {
            steps.push_back(std::move(step));
            if (steps.size() > kMemory) steps.pop_front();
        }
        poor = gain < kGain * present ? poor + 1 : 0;
        if (poor >= 3) break;
    }
    return present;
}

}  // namespace pointmorph
