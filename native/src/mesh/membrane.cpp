#include "mesh/membrane.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

std::span<const Index> neighbors_of(const Laplacian& laplacian, Index v) {
    const Index begin = laplacian.offsets[to_size(v)], end = laplacian.offsets[to_size(v) + 1];
    return {laplacian.neighbors.data() + begin, to_size(end - begin)};
}

/// Where a vertex is among some, which ascend; −1 if it isn't.
std::ptrdiff_t place_among(std::span<const Index> vertices, Index v) {
    const auto at = std::ranges::lower_bound(vertices, v);
    return at != vertices.end() && *at == v ? at - vertices.begin() : -1;
}

/// Which of some vertices are connected, over others of them, to one that isn't; ascending.
std::vector<Index> held_by_others(const Laplacian& laplacian, std::span<const Index> vertices) {
    std::vector<char> is_taken(vertices.size(), 0);
    std::vector<Index> result;
    const auto take = [&](std::ptrdiff_t place) {
        if (std::exchange(is_taken[to_size(place)], 1)) return;
        result.push_back(vertices[to_size(place)]);
    };
    for (std::size_t k = 0; k < vertices.size(); ++k)
        if (std::ranges::any_of(neighbors_of(laplacian, vertices[k]),
                                [&](Index to) { return place_among(vertices, to) < 0; }))
            take(to_index(k));
    for (std::size_t k = 0; k < result.size(); ++k)
        for (const Index to : neighbors_of(laplacian, result[k]))
            if (const auto place = place_among(vertices, to); place >= 0) take(place);
    std::ranges::sort(result);
    return result;
}

/// Between vertices of a film, numbered by their places in it, with the weights to all others in
/// `outside` and what these pull at in `right`.
struct FilmSystem {
    FilmSystem(const Laplacian& laplacian, std::span<const Index> film, const Positions& x)
        : outside(film.size(), 0.0),
          right(Positions::Zero(static_cast<Eigen::Index>(film.size()), 3)) {
        for (std::size_t i = 0; i < film.size(); ++i) {
            const Index v = film[i];
            double sum = 0.0;
            for (Index k = laplacian.offsets[to_size(v)]; k < laplacian.offsets[to_size(v) + 1];
                 ++k) {
                const Index to = laplacian.neighbors[to_size(k)];
                const double weight = laplacian.weights[to_size(k)];
                if (const auto place = place_among(film, to); place >= 0) {
                    inside.neighbors.push_back(to_index(place));
                    inside.weights.push_back(weight);
                    sum += weight;
                } else {
                    outside[i] += weight;
                    right.row(to_index(i)) += weight * x.row(to);
                }
            }
            inside.offsets.push_back(to_index(inside.neighbors.size()));
            inside.sums.push_back(sum);
        }
    }

    Laplacian inside;
    std::vector<double> outside;
    Positions right;
};

/// By a factor; nothing where there is none.
std::optional<Positions> solved_at_once(const FilmSystem& film) {
    using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;
    const Index count = film.inside.size();
    std::vector<Eigen::Triplet<double, Index>> entries;
    for (Index i = 0; i < count; ++i) {
        entries.emplace_back(i, i, film.inside.sums[to_size(i)] + film.outside[to_size(i)]);
        for (Index k = film.inside.offsets[to_size(i)]; k < film.inside.offsets[to_size(i) + 1];
             ++k)
            entries.emplace_back(i, film.inside.neighbors[to_size(k)],
                                 -film.inside.weights[to_size(k)]);
    }
    Matrix matrix(count, count);
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Matrix> solver(matrix);
    if (solver.info() != Eigen::Success) return {};
    Positions solution = solver.solve(Eigen::MatrixXd(film.right));
    if (!solution.allFinite()) return {};
    return solution;
}

/// Step by step from where they are, which may be canceled.
Positions solved_by_steps(FilmSystem film, Positions x, Progress& progress) {
    std::vector<SymmetricBlock> blocks(film.outside.size());
    for (std::size_t i = 0; i < blocks.size(); ++i) blocks[i].add_isotropic(film.outside[i]);
    solve(film.inside, blocks, std::move(film.right), {.most_iterations = 1000, .tolerance = 1e-4},
          x, progress);
    return x;
}

}  // namespace

void span_membrane(const Laplacian& laplacian, std::span<const Index> vertices, Positions& x,
                   Progress& progress) {
    constexpr std::size_t kLarge = 20000;
    const std::vector<Index> film = held_by_others(laplacian, vertices);
    if (film.empty()) return;
    FilmSystem system(laplacian, film, x);
    const std::optional<Positions> solution =
        film.size() < kLarge ? solved_at_once(system)
                             : solved_by_steps(std::move(system), gather(x, film), progress);
    if (!solution) return;
    for (std::size_t i = 0; i < film.size(); ++i) x.row(film[i]) = solution->row(to_index(i));
}

}  // namespace pointmorph
