// What is known of the threads that work for the calling one. Not for callers of the library.
#pragma once

#include <atomic>

namespace pointmorph {

/// The calling thread and those of its team, while there is work aside.
struct Crew {
    int most;                  ///< threads
    std::atomic<int> busy{1};  ///< of them
};

/// The calling thread's; null while it has no work aside.
Crew*& own_crew();

/// While the calling thread waits for others.
class Waiting {
public:
    Waiting() {
        if (crew_) --crew_->busy;
    }
    ~Waiting() {
        if (crew_) ++crew_->busy;
    }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;

private:
    Crew* crew_ = own_crew();
};

/// Threads that the calling one may have for a team, itself among them: 1 inside of one.
int threads_for_a_team();

/// From now on the calling thread runs teams of itself alone.
void stay_alone();

}  // namespace pointmorph
