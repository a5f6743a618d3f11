// OpenMP and the pool of threads, side by side: what it costs to begin and end a loop, a stage that
// is nothing but loops, and a whole morph. The argument is the number of threads.
#include <benchmark/benchmark.h>

#include <string>
#include <vector>

#include "../tests/shapes.hpp"
#include "base/thread_engine.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {
namespace {

/// Two chunks with next to nothing to do.
void begin_and_end(benchmark::State& state) {
    Progress progress;
    std::vector<double> rows(1024, 1.0);
    for (auto _ : state)
        parallel_for(1024, progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) rows[to_size(i)] *= 1.5;
        });
    benchmark::DoNotOptimize(rows.data());
}

void neighbors(benchmark::State& state) {
    static const Positions points = shapes::torus(100'000, 0.4);
    static const KdTree<3> tree(points);
    Progress progress;
    for (auto _ : state) benchmark::DoNotOptimize(nearest_neighbors(tree, 16, progress));
}

void whole_morph(benchmark::State& state) {
    Cloud source, target;
    source.positions = shapes::torus(4000, 0.4);
    target.positions = shapes::torus(3000, 0.3, 2);
    MorphOptions options;
    options.threads = static_cast<int>(state.range(0));
    Progress progress;
    for (auto _ : state) {
        const Morph morph({source, target}, options, progress);
        benchmark::DoNotOptimize(morph.pairs().data());
    }
}

template <class Run>
void with_each_engine(const std::string& name, Run run) {
    for (const ThreadEngine* engine : thread_engines())
        benchmark::RegisterBenchmark(
            (name + "/" + std::string(engine->name)).c_str(),
            [=](benchmark::State& state) {
                const EngineScope scope(*engine);
                const ThreadCount threads(static_cast<int>(state.range(0)));
                run(state);
            })
            ->ArgName("threads")
            ->Arg(1)
            ->Arg(2)
            ->UseRealTime();
}

const bool registered = [] {
    with_each_engine("BM_LoopBeginsAndEnds", begin_and_end);
    with_each_engine("BM_Neighbors", neighbors);
    with_each_engine("BM_Morph", whole_morph);
    return true;
}();

}  // namespace
}  // namespace pointmorph
