// Work for a core that has nothing else to do. Not for callers of the library.
#pragma once

#include <functional>
#include <memory>

#include "pointmorph/base/progress.hpp"

namespace pointmorph {

/// Work in a thread of its own that goes on only while the thread that made it, and the teams which
/// that one runs, leave a thread idle of those that they may have. Work stands still, and ends, at
/// its Progress, which it has to ask often. What it throws ends it, without a word: who needs the
/// result makes it then. Nothing begins where there is one thread alone, and while the calling
/// thread has other work aside: it knows of one idle thread, not of two.
class WorkAside {
public:
    explicit WorkAside(std::function<void(Progress&)> work);
    /// Ends it where it is. Waits until it has, but in a forked child, which has only its parent's
    /// memory, and not the thread.
    ~WorkAside();
    WorkAside(const WorkAside&) = delete;
    WorkAside& operator=(const WorkAside&) = delete;

private:
    struct Shared;
    std::shared_ptr<Shared> shared_;  ///< with the thread; null where nothing has begun
};

}  // namespace pointmorph
