#include "pointmorph/registration/diagnostics.hpp"

#include <algorithm>

namespace pointmorph {

Diagnostics Diagnostics::with_rows(std::span<const Index> source_rows,
                                   std::span<const Index> target_rows) const {
    Diagnostics result = *this;
    const auto on_source = [&](Index& row) { row = source_rows[to_size(row)]; };
    const auto on_target = [&](Index& row) { row = target_rows[to_size(row)]; };
    for (Rival& rival : result.rivals) {
        for (Index& place : rival.places) on_source(place);
        on_source(rival.source);
        on_target(rival.target);
        on_target(rival.rival_target);
    }
    for (Proposal& proposal : result.proposals) {
        on_source(proposal.source);
        on_target(proposal.target);
    }
    std::ranges::for_each(result.source_ends, on_source);
    std::ranges::for_each(result.target_ends, on_target);
    std::ranges::for_each(result.source_loose, on_source);
    std::ranges::for_each(result.target_loose, on_target);
    result.alternatives = alternatives.with_rows(source_rows, target_rows);
    return result;
}

Diagnostics Diagnostics::followed_by(const Diagnostics& later) const {
    Diagnostics result = *this;
    result.starts.insert(result.starts.end(), later.starts.begin(), later.starts.end());
    result.start_taken = starts.size() + later.start_taken;
    const auto add = [](std::vector<Index>& rows, const std::vector<Index>& more) {
        rows.insert(rows.end(), more.begin(), more.end());
    };
    add(result.source_loose, later.source_loose);
    add(result.target_loose, later.target_loose);
    return result;
}

}  // namespace pointmorph
