// Rows that are joined with one another. Not a part of the library.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Rows that are one, by the lowest of them.
class JoinedRows {
public:
    explicit JoinedRows(std::size_t count) : parents_(count) {
        std::iota(parents_.begin(), parents_.end(), 0);
    }
    Index root(Index i) {
        while (parents_[to_size(i)] != i) {
            parents_[to_size(i)] = parents_[to_size(parents_[to_size(i)])];
            i = parents_[to_size(i)];
        }
        return i;
    }
    void join(Index i, Index j) {
        const auto [low, high] = std::minmax({root(i), root(j)});
        parents_[to_size(high)] = low;
    }

private:
    std::vector<Index> parents_;
};

}  // namespace pointmorph
