#include "mesh/membrane.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <utility>
#include <vector>

namespace pointmorph {

namespace {

std::span<const Index> neighbors_of(const Laplacian& laplacian, Index v) {
    const Index begin = laplacian.offsets[to_size(v)], end = laplacian.offsets[to_size(v) + 1];
    return {laplacian.neighbors.data() + begin, to_size(end - begin)};
}

/// Which of some vertices are connected, over others of them, to one that isn't; ascending.
std::vector<Index> held_by_others(const Laplacian& laplacian, std::span<const Index> vertices) {
    std::vector<char> is_free(to_size(laplacian.size()), 0);
    for (const Index v : vertices) is_free[to_size(v)] = 1;
    std::vector<Index> result;
    for (const Index v : vertices)
        if (std::ranges::any_of(neighbors_of(laplacian, v),
                                [&](Index to) { return !is_free[to_size(to)]; }))
            result.push_back(v);
    for (const Index v : result) is_free[to_size(v)] = 0;
    for (std::size_t k = 0; k < result.size(); ++k)
        for (const Index to : neighbors_of(laplacian, result[k]))
            if (std::exchange(is_free[to_size(to)], 0)) result.push_back(to);
    std::ranges::sort(result);
    return result;
}

}  // namespace

void span_membrane(const Laplacian& laplacian, std::span<const Index> vertices, Positions& x) {
    using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;
    const std::vector<Index> film = held_by_others(laplacian, vertices);
    if (film.empty()) return;
    const auto count = to_index(film.size());
    std::vector<Eigen::Triplet<double, Index>> entries;
    Positions right = Positions::Zero(count, 3);
    for (Index i = 0; i < count; ++i) {
        const Index v = film[to_size(i)];
        entries.emplace_back(i, i, laplacian.sums[to_size(v)]);
        for (Index k = laplacian.offsets[to_size(v)]; k < laplacian.offsets[to_size(v) + 1]; ++k) {
            const Index to = laplacian.neighbors[to_size(k)];
            const double weight = laplacian.weights[to_size(k)];
            const auto at = std::ranges::lower_bound(film, to);
            if (at != film.end() && *at == to)
                entries.emplace_back(i, to_index(at - film.begin()), -weight);
            else
                right.row(i) += weight * x.row(to);
        }
    }
    Matrix matrix(count, count);
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Matrix> solver(matrix);
    if (solver.info() != Eigen::Success) return;
    const Eigen::MatrixXd solution = solver.solve(Eigen::MatrixXd(right));
    if (!solution.allFinite()) return;
    for (Index i = 0; i < count; ++i) x.row(film[to_size(i)]) = solution.row(i);
}

}  // namespace pointmorph
