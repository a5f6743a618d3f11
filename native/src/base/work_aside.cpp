#include "base/work_aside.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "base/crew.hpp"
#include "base/own_thread.hpp"
#include "base/thread_engine.hpp"

namespace pointmorph {

Crew*& own_crew() {
    thread_local Crew* own = nullptr;
    return own;
}

struct WorkAside::Shared {
    Shared(std::function<void(Progress&)> its, int most) : work(std::move(its)), crew{most} {}

    std::function<void(Progress&)> work;
    Crew crew;
    long process = process_id();
    std::atomic<bool> ending{false}, ended{false};
    std::optional<OwnThread> thread;

    /// Stands still while no thread is idle. Returns whether to go on.
    bool may_go_on() const {
        // Not told by the threads at work, which would wake it between any two of their loops.
        constexpr std::chrono::microseconds kLongest{800};
        std::chrono::microseconds pause{100};
        for (; !ending && crew.busy >= crew.most; pause = std::min(2 * pause, kLongest))
            std::this_thread::sleep_for(pause);
        return !ending;
    }

    void run() {
        stay_alone();
        Progress progress([this](std::string_view, double) { return may_go_on(); },
                          std::chrono::milliseconds(0));
        try {
            progress.report(0.0);
            work(progress);
        } catch (...) {
        }
        ended = true;
        ended.notify_one();
    }
};

WorkAside::WorkAside(std::function<void(Progress&)> work) {
    const int most = threads_for_a_team();
    if (most < 2 || own_crew()) return;
    shared_ = std::make_shared<Shared>(std::move(work), most);
    try {
        shared_->thread.emplace([its = shared_] { its->run(); });
    } catch (const std::system_error&) {
        shared_.reset();  // the system allows no more threads
        return;
    }
    own_crew() = &shared_->crew;
}

WorkAside::~WorkAside() {
    if (!shared_) return;
    own_crew() = nullptr;
    if (shared_->process != process_id()) return;  // the thread is its parent's alone
    shared_->ending = true;
    shared_->ended.wait(false);
    shared_->thread->end();
}

}  // namespace pointmorph
