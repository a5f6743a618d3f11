// Work for a core that has nothing else to do. Not for callers of the library.
#pragma once

#include <functional>
#include <memory>

#include "pointmorph/base/progress.hpp"

namespace pointmorph {

/// Work in a thread of its own that goes on only while the thread that made it, and the teams which
/// that one runs, leave a thread idle of those that they may have. Work stands still, and ends, at
/// its Progress, which it has to ask often. What it throws ends it, without a word: who needs the
/// result makes it then. Where there is one thread alone, nothing begins.
class WorkAside {
public:
    explicit WorkAside(std::function<void(Progress&)> work);
    /// Ends it where it is. Waits until it has.
    ~WorkAside();
    WorkAside(const WorkAside&) = delete;
    WorkAside& operator=(const WorkAside&) = delete;

private:
    struct Shared;
    std::shared_ptr<Shared> shared_;  ///< with the thread; null where nothing has begun
};

}  // namespace pointmorph
