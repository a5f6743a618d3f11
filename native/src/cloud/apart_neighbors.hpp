// Neighbors that don't hang together yet. Not for callers of the library.
#pragma once

#include <algorithm>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

/// Calls `look_at(i, j)`, which may join both, for all neighbors that aren't joined yet. A few of
/// each point come first: these join nearly all, and what is joined by then is known at a glance.
template <class LookAt>
void each_apart(GrowingComponents& joined, const Neighborhoods& nearest, LookAt&& look_at) {
    constexpr std::size_t kFew = 4;
    const auto look = [&](Index i, Index j) {
        if (!joined.are_joined(i, j)) look_at(i, j);
    };
    for (Index i = 0; i < nearest.size(); ++i)
        for (const Index j : nearest[i].first(std::min(kFew, nearest[i].size()))) look(i, j);
    std::vector<Index> roots(to_size(nearest.size()));
    for (Index i = 0; i < nearest.size(); ++i) roots[to_size(i)] = joined.root(i);
    for (Index i = 0; i < nearest.size(); ++i)
        for (const Index j : nearest[i])
            if (roots[to_size(i)] != roots[to_size(j)]) look(i, j);
}

}  // namespace pointmorph
