// What several tests ask of pairs and of a report.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph::checks {

/// Sorted, without repeats, rows in range, every row there.
inline testing::AssertionResult is_total(const Pairing& pairs, Index sources, Index targets) {
    if (!std::ranges::is_sorted(pairs)) return testing::AssertionFailure() << "not sorted";
    if (std::ranges::adjacent_find(pairs) != pairs.end())
        return testing::AssertionFailure() << "a pair twice";
    std::set<Index> source_rows, target_rows;
    for (const auto& [s, t] : pairs) {
        if (s < 0 || s >= sources || t < 0 || t >= targets)
            return testing::AssertionFailure() << s << ", " << t << " out of range";
        source_rows.insert(s);
        target_rows.insert(t);
    }
    if (std::ssize(source_rows) != sources || std::ssize(target_rows) != targets)
        return testing::AssertionFailure()
               << source_rows.size() << " of " << sources << " and " << target_rows.size() << " of "
               << targets << " rows are in a pair";
    return testing::AssertionSuccess();
}

/// Of features that are points: those of each are a pair.
inline testing::AssertionResult are_paired(const std::vector<Feature>& features,
                                           const Pairing& pairs) {
    for (const Feature& f : features)
        if (!std::ranges::binary_search(pairs,
                                        IndexPair{f.source.rows.front(), f.target.rows.front()}))
            return testing::AssertionFailure() << "\"" << f.name << "\" is in no pair of its own";
    return testing::AssertionSuccess();
}

/// Whether one of the warnings has these words.
inline bool mentions(const std::vector<std::string>& warnings, std::string_view words) {
    return std::ranges::any_of(warnings, [&](const std::string& warning) {
        return warning.find(words) != std::string::npos;
    });
}

}  // namespace pointmorph::checks
