#include "pointmorph/base/assignment.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>

namespace pointmorph {

namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

}  // namespace

std::vector<IndexPair> each_others_best(const Eigen::MatrixXd& costs, double largest,
                                        double by_far) {
    std::vector<IndexPair> pairs;
    for (Eigen::Index i = 0; i < costs.rows(); ++i)
        for (Eigen::Index j = 0; j < costs.cols(); ++j) {
            const double cost = costs(i, j);
            bool best = cost < largest;
            for (Eigen::Index k = 0; k < costs.rows(); ++k)
                best = best && (k == i || costs(k, j) > by_far * cost);
            for (Eigen::Index k = 0; k < costs.cols(); ++k)
                best = best && (k == j || costs(i, k) > by_far * cost);
            if (best) pairs.push_back({to_index(i), to_index(j)});
        }
    return pairs;
}

std::vector<Index> least_assignment(const Eigen::MatrixXd& costs) {
    const auto rows = to_index(costs.rows()), columns = to_index(costs.cols());
    // Row 0 and column 0 stand for "none".
    std::vector<double> row_price(to_size(rows) + 1, 0.0), column_price(to_size(columns) + 1, 0.0);
    std::vector<Index> row_of(to_size(columns) + 1, 0), before(to_size(columns) + 1, 0);
    for (Index row = 1; row <= rows; ++row) {
        row_of[0] = row;
        Index column = 0;
        std::vector<double> slack(to_size(columns) + 1, kInfinite);
        std::vector<char> reached(to_size(columns) + 1, 0);
        do {
            reached[to_size(column)] = 1;
            const Index i = row_of[to_size(column)];
            double least = kInfinite;
            Index next = 0;
            for (Index j = 1; j <= columns; ++j) {
                if (reached[to_size(j)]) continue;
                const double reduced =
                    costs(i - 1, j - 1) - row_price[to_size(i)] - column_price[to_size(j)];
                if (reduced < slack[to_size(j)]) {
                    slack[to_size(j)] = reduced;
                    before[to_size(j)] = column;
                }
                if (slack[to_size(j)] < least) {
                    least = slack[to_size(j)];
                    next = j;
                }
            }
            for (Index j = 0; j <= columns; ++j) {
                if (reached[to_size(j)]) {
                    row_price[to_size(row_of[to_size(j)])] += least;
                    column_price[to_size(j)] -= least;
                } else {
                    slack[to_size(j)] -= least;
                }
            }
            column = next;
        } while (row_of[to_size(column)] != 0);
        while (column != 0) {
            row_of[to_size(column)] = row_of[to_size(before[to_size(column)])];
            column = before[to_size(column)];
        }
    }
    std::vector<Index> result(to_size(rows));
    for (Index j = 1; j <= columns; ++j)
        if (row_of[to_size(j)] > 0) result[to_size(row_of[to_size(j)] - 1)] = j - 1;
    return result;
}

std::vector<std::vector<Index>> even_assignment(const Eigen::MatrixXd& costs) {
    const bool more_rows = costs.rows() > costs.cols();
    const Eigen::MatrixXd wide = more_rows ? Eigen::MatrixXd(costs.transpose()) : costs;
    const auto few = to_index(wide.rows()), many = to_index(wide.cols());
    std::vector<std::vector<Index>> result(to_size(to_index(costs.rows())));
    if (few == 0) return result;
    const auto repeated = [&](Index k) {
        return static_cast<Index>(static_cast<std::int64_t>(k) * few / many);
    };
    Eigen::MatrixXd square(many, many);
    for (Index k = 0; k < many; ++k) square.row(k) = wide.row(repeated(k));
    const std::vector<Index> partners = least_assignment(square);
    for (Index k = 0; k < many; ++k) {
        const Index one = repeated(k), other = partners[to_size(k)];
        if (more_rows)
            result[to_size(other)].push_back(one);
        else
            result[to_size(one)].push_back(other);
    }
    for (std::vector<Index>& columns : result) std::ranges::sort(columns);
    return result;
}

std::vector<IndexPair> cheapest_pairs(const Eigen::MatrixXd& costs, double alone) {
    // A row without a partner takes one of the further columns.
    Eigen::MatrixXd all =
        Eigen::MatrixXd::Constant(costs.rows(), costs.cols() + costs.rows(), alone);
    all.leftCols(costs.cols()) = costs;
    const std::vector<Index> columns = least_assignment(all);
    std::vector<IndexPair> pairs;
    for (Index i = 0; i < to_index(costs.rows()); ++i)
        if (const Index j = columns[to_size(i)]; j < costs.cols() && costs(i, j) < alone)
            pairs.push_back({i, j});
    return pairs;
}

}  // namespace pointmorph
