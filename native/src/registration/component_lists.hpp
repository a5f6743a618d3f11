// Components as lists of their points, and matches by how many they have. Not for callers of the
// library.
#pragma once

#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/components.hpp"
#include "registration/whole.hpp"

namespace pointmorph {

/// Rows of every component, strays included.
std::vector<std::vector<Index>> rows_of(const Topology& topology);

/// Main components as wholes.
std::vector<Whole> wholes_of(const Positions& positions, const Topology& topology,
                             const std::vector<std::vector<Index>>& rows);

/// The row of `there` nearest to each image. Throws Cancelled.
std::vector<Index> rows_beneath(const Positions& images, const KdTree<3>& there,
                                Progress& progress);

/// The matches of the most points first: components are numbered by size, but not alike on both
/// sides.
void sort_by_points(std::vector<IndexPair>& matched, const Topology& source,
                    const Topology& target);

}  // namespace pointmorph
