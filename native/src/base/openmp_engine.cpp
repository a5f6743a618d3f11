// The only file that knows OpenMP.
#include <omp.h>

#include <atomic>

#include "base/thread_engine.hpp"

namespace pointmorph {

namespace {

/// True in a forked child of the process that ran the first team.
bool is_forked() {
    static std::atomic<long> first{process_id()};
    return first != process_id();
}

void run(int threads, const TeamWork& work) {
    if (is_forked()) {
        kPoolEngine.run(threads, work);
        return;
    }
#pragma omp parallel num_threads(threads)
    work(omp_get_thread_num() == 0);
}

}  // namespace

const ThreadEngine kOpenMpEngine{"OpenMP", [] { return omp_get_max_threads(); }, run};

}  // namespace pointmorph
