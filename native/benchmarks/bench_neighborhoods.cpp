// The stages that every morph begins with, on 100,000 points, against the project's unit of time:
// building a kd-tree with nanoflann and asking it for 16 neighbors of every point. Both take turns,
// so that whatever else the machine does meets both. The argument is the number of threads.
#include <benchmark/benchmark.h>

#include <numeric>
#include <vector>

#include "../tests/shapes.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/lod.hpp"
#include "pointmorph/cloud/sampling.hpp"
#include "timing.hpp"
#include "unit.hpp"

namespace pointmorph {
namespace {

constexpr Index kPoints = 100'000;
constexpr Index kNeighbors = 16;

Positions ordered(const Positions& positions) {
    return gather(positions, spatial_order(positions));
}

struct Prepared {
    Positions positions = ordered(shapes::torus(kPoints, 0.4));
    KdTree<3> tree{positions};
    Progress progress;
    Neighborhoods nearest = nearest_neighbors(tree, kNeighbors, progress);
    Covariance covariance = covariance_analysis(positions, nearest, progress);
};

const Prepared& prepared() {
    static const Prepared prepared;
    return prepared;
}

std::vector<Index> unit() {
    const Positions& positions = prepared().positions;
    std::vector<Index> found(to_size(positions.rows()) * to_size(kNeighbors));
    pointmorph_unit(positions.data(), to_index(positions.rows()), kNeighbors, found.data());
    return found;
}

template <class Run>
void measure(benchmark::State& state, Run&& run) {
    const ThreadCount threads(static_cast<int>(state.range(0)));
    Progress progress;
    std::vector<double> run_seconds, unit_seconds;
    for (auto _ : state) {
        unit_seconds.push_back(seconds([&] { benchmark::DoNotOptimize(unit()); }));
        run_seconds.push_back(seconds([&] { benchmark::DoNotOptimize(run()); }));
        state.SetIterationTime(run_seconds.back());
    }
    state.counters["unit_ms"] = 1e3 * median(unit_seconds);
    state.counters["units"] = median(run_seconds) / median(unit_seconds);
}

void BM_Neighborhoods(benchmark::State& state) {
    Progress progress;
    measure(state, [&] {
        return nearest_neighbors(KdTree<3>(prepared().positions), kNeighbors, progress);
    });
}

void BM_KdTree(benchmark::State& state) {
    measure(state, [&] { return KdTree<3>(prepared().positions); });
}

void BM_SpatialOrder(benchmark::State& state) {
    const Positions p = shapes::torus(kPoints, 0.4);
    measure(state, [&] { return spatial_order(p); });
}

void BM_Covariance(benchmark::State& state) {
    Progress progress;
    const auto& all = prepared();
    measure(state, [&] { return covariance_analysis(all.positions, all.nearest, progress); });
}

void BM_Orientation(benchmark::State& state) {
    Progress progress;
    const auto& all = prepared();
    measure(state, [&] {
        Normals normals = all.covariance.normals;
        orient_normals(all.positions, all.nearest, normals, progress);
        return normals;
    });
}

/// Clusters of 12.
void BM_Lod(benchmark::State& state) {
    Progress progress;
    const Positions& p = prepared().positions;
    std::vector<Index> rows(to_size(p.rows()));
    std::iota(rows.begin(), rows.end(), 0);
    measure(state, [&] { return simplify(p, rows, {12}, progress); });
}

/// 100,000 of 400,000 candidates.
void BM_Sampling(benchmark::State& state) {
    Progress progress;
    const Positions candidates = shapes::torus(4 * kPoints, 0.4);
    measure(state, [&] { return blue_noise(candidates, Normals(0, 3), kPoints, {}, progress); });
}

void both(benchmark::internal::Benchmark* benchmark) {
    benchmark->ArgName("threads")->Arg(1)->Arg(2)->UseManualTime()->Unit(benchmark::kMillisecond);
}
void one(benchmark::internal::Benchmark* benchmark) {
    benchmark->ArgName("threads")->Arg(1)->UseManualTime()->Unit(benchmark::kMillisecond);
}
BENCHMARK(BM_Neighborhoods)->Apply(both);
BENCHMARK(BM_KdTree)->Apply(one);
BENCHMARK(BM_SpatialOrder)->Apply(one);
BENCHMARK(BM_Covariance)->Apply(both);
BENCHMARK(BM_Orientation)->Apply(both);
BENCHMARK(BM_Lod)->Apply(both);
BENCHMARK(BM_Sampling)->Apply(both);

}  // namespace
}  // namespace pointmorph
