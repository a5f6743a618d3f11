#include "pointmorph/registration/alternatives.hpp"

namespace pointmorph {

Alternatives Alternatives::with_rows(std::span<const Index> source_rank,
                                     std::span<const Index> target_rank) const {
    Alternatives result = *this;
    for (Index& row : result.source_rows) row = source_rank[to_size(row)];
    for (Index& row : result.target_rows) row = target_rank[to_size(row)];
    return result;
}

}  // namespace pointmorph
