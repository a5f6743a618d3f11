// Which rows and columns of a table of costs belong together.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Row and column of every cost that is below `largest` and the least of its row and of its column
/// by far: all others there are more than `by_far` times as high.
std::vector<IndexPair> each_others_best(const Eigen::MatrixXd& costs, double largest,
                                        double by_far);

/// The column of each row, none twice, with the least sum of costs; no fewer columns than rows
/// (Kuhn 1955, Munkres 1957; by shortest augmenting paths).
std::vector<Index> least_assignment(const Eigen::MatrixXd& costs);

/// The columns of each row, as even as their numbers allow, with the least sum of costs: each
/// column is one row's, or each row one column's, whichever there are more of; the others have a
/// share of them each, which differ by one at the most.
std::vector<std::vector<Index>> even_assignment(const Eigen::MatrixXd& costs);

/// Rows and columns, none twice, with the least sum of costs, where a row costs `alone` without a
/// column: least_assignment() of those that cost less. Ascending by row.
std::vector<IndexPair> cheapest_pairs(const Eigen::MatrixXd& costs, double alone);

}  // namespace pointmorph
