#include "pointmorph/parallel.hpp"

#include <omp.h>

namespace pointmorph {

ThreadCount::ThreadCount(int threads) : before_(omp_get_max_threads()) {
    if (threads > 0) omp_set_num_threads(threads);
}

ThreadCount::~ThreadCount() {
    omp_set_num_threads(before_);
}

}  // namespace pointmorph
