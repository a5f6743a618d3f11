// Work that can't say how far it is, in a stage or outside of all. Not a part of the library.
#pragma once

#include <chrono>
#include <string_view>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/progress.hpp"

namespace pointmorph {

/// What `work(quiet)` returns. Its progress asks whether to end, as often as `progress` would, but
/// says nothing of how far it is. Throws what the callback throws, else Cancelled.
template <class Work>
auto quietly(Progress& progress, Work&& work) {
    Progress quiet([&](std::string_view, double) { return progress.poll(); },
                   std::chrono::milliseconds(0));
    try {
        return std::forward<Work>(work)(quiet);
    } catch (const Cancelled&) {
        progress.throw_if_cancelled();
        throw;
    }
}

}  // namespace pointmorph
