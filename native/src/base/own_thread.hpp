// A thread that the library starts itself. Not for callers of the library.
#pragma once

#include <cstddef>
#include <memory>
#include <system_error>
#include <utility>

#ifdef _WIN32
#include <thread>
#else
#include <pthread.h>
#endif

namespace pointmorph {

#ifdef _WIN32
class OwnThread {
public:
    template <class Run>
    explicit OwnThread(Run run) : thread_(std::move(run)) {}
    /// Doesn't wait: what goes with a thread is destroyed there under a lock that every other
    /// thread needs in order to end.
    void end() { thread_.detach(); }

private:
    std::thread thread_;
};
#else
/// std::thread with as large a stack as a main thread's: macOS gives other threads half a megabyte.
class OwnThread {
public:
    template <class Run>
    explicit OwnThread(Run run) {
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
    void end() { pthread_join(thread_, nullptr); }

private:
    static constexpr std::size_t kStack = std::size_t{8} << 20;
    pthread_t thread_;
};
#endif

}  // namespace pointmorph
