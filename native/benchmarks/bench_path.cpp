// A frame of 200,000 pairs with all attributes, against a plain copy of the same bytes in the same
// run: the frame reads both ends and writes the result; the copy reads half as many bytes as all
// of these together and writes the other half.
#include <benchmark/benchmark.h>

#include <cstring>
#include <random>
#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/frames/path.hpp"
#include "timing.hpp"

namespace pointmorph {
namespace {

constexpr Index kPairs = 200'000;
constexpr int kThreads = 2;
constexpr std::size_t kNumbersAPair = 3 + 3 + 4 + 1;

Cloud random_cloud(unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<float> uniform(0.0F, 1.0F);
    Cloud cloud;
    const auto fill = [&](auto& rows) {
        for (Eigen::Index i = 0; i < rows.size(); ++i) rows.data()[i] = uniform(random);
    };
    cloud.positions.resize(kPairs, 3);
    cloud.normals.resize(kPairs, 3);
    cloud.colors.resize(kPairs, 4);
    cloud.radii.resize(kPairs);
    fill(cloud.positions);
    fill(cloud.normals);
    fill(cloud.colors);
    fill(cloud.radii);
    cloud.normals.rowwise().normalize();
    return cloud;
}

template <class Scalar>
struct Frame {
    std::vector<Scalar> positions = std::vector<Scalar>(3 * kPairs);
    std::vector<Scalar> normals = std::vector<Scalar>(3 * kPairs);
    std::vector<Scalar> colors = std::vector<Scalar>(4 * kPairs);
    std::vector<Scalar> radii = std::vector<Scalar>(kPairs);

    FrameView<Scalar> view() { return {positions, normals, colors, radii}; }
};

/// Frames and copies take turns, so that whatever else the machine does meets both.
template <class Scalar>
void BM_Frame(benchmark::State& state) {
    const ThreadCount threads(kThreads);
    const Cloud source = random_cloud(1), target = random_cloud(2);
    std::vector<IndexPair> pairs;
    for (Index i = 0; i < kPairs; ++i) pairs.push_back({i, i});
    const StraightPath<Scalar> path(source, target, pairs);
    Frame<Scalar> frame;

    const std::size_t bytes = 3 * kNumbersAPair * kPairs * sizeof(Scalar);
    std::vector<char> copy_from(bytes / 2, 1), copy_to(bytes / 2);
    const auto copy = [&] {
        parallel_invoke(kThreads, [&](int part, bool) {
            const std::size_t begin = copy_from.size() / kThreads * to_size(part);
            std::memcpy(copy_to.data() + begin, copy_from.data() + begin,
                        copy_from.size() / kThreads);
        });
        benchmark::ClobberMemory();
    };

    std::vector<double> frame_seconds, copy_seconds;
    double t = 0.0;
    for (auto _ : state) {
        copy_seconds.push_back(seconds(copy));
        t = t < 0.9 ? t + 0.05 : 0.05;
        frame_seconds.push_back(seconds([&] { path.frame(t, frame.view()); }));
        state.SetIterationTime(frame_seconds.back());
    }
    const auto gigabytes = static_cast<double>(bytes) / 1e9;
    state.counters["frame_GB/s"] = gigabytes / median(frame_seconds);
    state.counters["copy_GB/s"] = gigabytes / median(copy_seconds);
    state.counters["frame/copy"] = median(copy_seconds) / median(frame_seconds);
}
BENCHMARK(BM_Frame<float>)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Frame<double>)->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace pointmorph
