#include "pointmorph/base/parallel.hpp"

#include <omp.h>

namespace pointmorph {

ThreadCount::ThreadCount(int threads) : before_(omp_get_max_threads()) {
    if (threads > 0) omp_set_num_threads(threads);
}

ThreadCount::~ThreadCount() {
    omp_set_num_threads(before_);
}

int threads_for(int tasks) {
    return std::max(1, std::min(tasks, omp_get_max_threads()));
}

bool is_calling_thread() {
    return omp_get_thread_num() == 0;
}

}  // namespace pointmorph
