#include <algorithm>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "base/own_thread.hpp"
#include "base/thread_engine.hpp"

#ifdef _WIN32
#ifndef NOMINMAX
#define NOMINMAX
#endif
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#include <windows.h>
#else
#include <unistd.h>
#endif

namespace pointmorph {

namespace {

/// The threads that help one thread. They sleep between the rounds.
class Pool {
public:
    Pool() = default;
    ~Pool() {
        {
            const std::scoped_lock lock(rounds_->mutex);
            rounds_->ending = true;
        }
        rounds_->begin.notify_all();
        for (OwnThread& thread : threads_) thread.end();
    }
    Pool(const Pool&) = delete;
    Pool& operator=(const Pool&) = delete;

    void run(int threads, const TeamWork& work) {
        grow(static_cast<std::size_t>(threads) - 1);
        Rounds& rounds = *rounds_;
        {
            const std::scoped_lock lock(rounds.mutex);
            rounds.work = &work;
            rounds.places = threads - 1;
            ++rounds.number;
        }
        for (int i = 1; i < threads; ++i) rounds.begin.notify_one();
        work(true);
        std::unique_lock lock(rounds.mutex);
        rounds.work = nullptr;  // nothing is left to do for those that haven't come yet
        rounds.end.wait(lock, [&] { return rounds.working == 0; });
    }

private:
    /// What the threads wait for, which may be longer than the pool is there.
    struct Rounds {
        std::mutex mutex;
        std::condition_variable begin, end;
        const TeamWork* work = nullptr;  // of this round, while it is open
        std::uint64_t number = 0;
        int places = 0;   // for those that may still join the round
        int working = 0;  // that have joined it, and not ended
        bool ending = false;
    };

    void grow(std::size_t count) {
        try {
            while (threads_.size() < count)
                threads_.emplace_back([rounds = rounds_] { serve(*rounds); });
        } catch (const std::system_error&) {
            // The system allows no more threads; those that are there do all the work.
        }
    }

    static void serve(Rounds& rounds) {
        std::uint64_t seen = 0;
        std::unique_lock lock(rounds.mutex);
        while (true) {
            rounds.begin.wait(lock, [&] {
                return rounds.ending || (rounds.number != seen && rounds.work != nullptr);
            });
            if (rounds.ending) return;
            seen = rounds.number;
            if (rounds.places == 0) continue;
            --rounds.places;
            ++rounds.working;
            const TeamWork& work = *rounds.work;
            lock.unlock();
            work(false);
            lock.lock();
            if (--rounds.working == 0) rounds.end.notify_one();
        }
    }

    std::shared_ptr<Rounds> rounds_ = std::make_shared<Rounds>();
    std::vector<OwnThread> threads_;
};

#ifdef _WIN32
/// The calling thread's pool, or nothing where the system has no place for it. In a slot of the
/// system's: GCC for Windows frees what is thread_local before it is destroyed.
Pool* own_pool() {
    static const DWORD slot = FlsAlloc([](void* pool) { delete static_cast<Pool*>(pool); });
    auto* pool = static_cast<Pool*>(FlsGetValue(slot));
    if (pool == nullptr) {
        auto made = std::make_unique<Pool>();
        if (FlsSetValue(slot, made.get()) == 0) return nullptr;
        pool = made.release();
    }
    return pool;
}
#else
/// The calling thread's pool. A forked child leaves its parent's as it is, for its threads and
/// whatever they held are gone, and makes another one.
class OwnPool {
public:
    ~OwnPool() { leave_parents(); }

    Pool& get() {
        leave_parents();
        if (!pool_) {
            pool_ = std::make_unique<Pool>();
            process_ = process_id();
        }
        return *pool_;
    }

private:
    void leave_parents() {
        if (pool_ && process_ != process_id()) static_cast<void>(pool_.release());
    }

    std::unique_ptr<Pool> pool_;
    long process_ = 0;
};

Pool* own_pool() {
    thread_local OwnPool own;
    return &own.get();
}
#endif

void run(int threads, const TeamWork& work) {
    if (Pool* const pool = own_pool())
        pool->run(threads, work);
    else
        work(true);
}

int default_threads() {
    static const int count = [] {
        // Whoever limits OpenMP's threads means these as well.
        const char* const said = std::getenv("OMP_NUM_THREADS");
        const int wanted = said != nullptr ? std::atoi(said) : 0;
        return wanted > 0 ? wanted : static_cast<int>(std::thread::hardware_concurrency());
    }();
    return std::max(1, count);
}

}  // namespace

const ThreadEngine kPoolEngine{"pool", default_threads, run};

long process_id() {
#ifdef _WIN32
    return 0;
#else
    return getpid();
#endif
}

}  // namespace pointmorph
