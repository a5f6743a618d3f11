#include <algorithm>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "base/thread_engine.hpp"

#ifndef _WIN32
#include <pthread.h>
#include <unistd.h>
#endif

namespace pointmorph {

namespace {

#ifdef _WIN32
using Thread = std::thread;
#else
/// std::thread with as large a stack as a main thread's: macOS gives other threads half a megabyte.
class Thread {
public:
    template <class Run>
    explicit Thread(Run run) {
        auto owned = std::make_unique<Run>(std::move(run));
        pthread_attr_t attributes;
        pthread_attr_init(&attributes);
        pthread_attr_setstacksize(&attributes, kStack);
        const auto start = [](void* it) -> void* {
            (*std::unique_ptr<Run>(static_cast<Run*>(it)))();
            return nullptr;
        };
        const int error = pthread_create(&thread_, &attributes, start, owned.get());
        pthread_attr_destroy(&attributes);
        if (error != 0) throw std::system_error(error, std::generic_category());
        owned.release();
    }
    void join() { pthread_join(thread_, nullptr); }

private:
    static constexpr std::size_t kStack = std::size_t{8} << 20;
    pthread_t thread_;
};
#endif

/// The threads that help one thread. They sleep between the rounds.
class Pool {
public:
    Pool() = default;
    ~Pool() {
        {
            const std::scoped_lock lock(mutex_);
            ending_ = true;
        }
        begin_.notify_all();
        for (Thread& thread : threads_) thread.join();
    }
    Pool(const Pool&) = delete;
    Pool& operator=(const Pool&) = delete;

    void run(int threads, const TeamWork& work) {
        grow(static_cast<std::size_t>(threads) - 1);
        {
            const std::scoped_lock lock(mutex_);
            work_ = &work;
            places_ = threads - 1;
            ++round_;
        }
        for (int i = 1; i < threads; ++i) begin_.notify_one();
        work(true);
        std::unique_lock lock(mutex_);
        work_ = nullptr;  // nothing is left to do for those that haven't come yet
        end_.wait(lock, [&] { return working_ == 0; });
    }

private:
    void grow(std::size_t count) {
        try {
            while (threads_.size() < count) threads_.emplace_back([this] { serve(); });
        } catch (const std::system_error&) {
            // The system allows no more threads; those that are there do all the work.
        }
    }

    void serve() {
        std::uint64_t seen = 0;
        std::unique_lock lock(mutex_);
        while (true) {
            begin_.wait(lock, [&] { return ending_ || (round_ != seen && work_ != nullptr); });
            if (ending_) return;
            seen = round_;
            if (places_ == 0) continue;
            --places_;
            ++working_;
            const TeamWork& work = *work_;
            lock.unlock();
            work(false);
            lock.lock();
            if (--working_ == 0) end_.notify_one();
        }
    }

    std::mutex mutex_;
    std::condition_variable begin_, end_;
    const TeamWork* work_ = nullptr;  // of this round, while it is open
    std::uint64_t round_ = 0;
    int places_ = 0;   // for those that may still join the round
    int working_ = 0;  // that have joined it, and not ended
    bool ending_ = false;
    std::vector<Thread> threads_;
};

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

void run(int threads, const TeamWork& work) {
    thread_local OwnPool own;
    own.get().run(threads, work);
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
