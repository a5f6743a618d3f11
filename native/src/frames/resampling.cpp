#include "pointmorph/frames/resampling.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "frames/gap_triangles.hpp"
#include "frames/lifetimes.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

// Corners of a triangle that lie this many spacings apart are no longer samples of one smooth
// piece: from the first on the MLS surface counts less, from the second on not at all.
constexpr double kCoherent = 1.5, kTorn = 3.0, kWidest = 1.5;
/// Edges of even triangles between samples of spacing 1.
constexpr double kEvenEdge = 1.0746;

}  // namespace

double Lifetime::share(double t) const {
    if (t <= appears || t >= vanishes) return 0.0;
    const double x = t < complete ? (t - appears) / (complete - appears)
                     : t > fades  ? (vanishes - t) / (vanishes - fades)
                                  : 1.0;
    return x * x * (3.0 - 2.0 * x);
}

Resampling::Resampling(End source, End target, std::span<const IndexPair> pairs,
                       const FrameAt& frame_at, const ResamplingOptions& options,
                       Progress& progress)
    : options_(options) {
    const auto check = [](double value, double least, double most, const char* name) {
        if (!(value >= least && value <= most))
            throw OptionError(
                name, "a number from " + std::to_string(least) + " to " + std::to_string(most),
                std::to_string(value), "Choose a value from that range.");
    };
    check(options.omega, 0.0, 2.0, "omega");
    check(options.spacing, 0.25, 4.0, "resample_spacing");
    if (options.crowding) check(*options.crowding, 1.5, 100.0, "crowding");

    constexpr double kBoth = 0.25, kTriangles = 0.3;  // share of the time
    std::array<std::optional<EndSamples>, 2> ends;
    {
        const Progress::Part part(progress, 0.0, kBoth);
        on_both(progress, [&](bool is_source, Progress& its) {
            const Cloud &cloud = is_source ? source.cloud : target.cloud,
                        &other = is_source ? target.cloud : source.cloud;
            const auto sides = is_source ? std::pair(&IndexPair::source, &IndexPair::target)
                                         : std::pair(&IndexPair::target, &IndexPair::source);
            ends[is_source ? 0 : 1].emplace(
                cloud, standing_for(pairs, sides.first, sides.second, cloud, other),
                is_source ? source.neighbors : target.neighbors, its);
        });
    }
    const EndSamples &from = *ends[0], &to = *ends[1];
    plan_.source_size = from.size;
    plan_.target_size = to.size;
    const auto count = to_index(pairs.size());
    for (Values* values : {&plan_.source_spacing, &plan_.target_spacing, &plan_.source_density,
                           &plan_.target_density})
        values->resize(count);
    const auto plan = [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const auto [s, d] = pairs[to_size(i)];
            plan_.source_spacing[i] = from.spacing[s] * from.unit.scale;
            plan_.target_spacing[i] = to.spacing[d] * to.unit.scale;
            plan_.source_density[i] = from.density[s];
            plan_.target_density[i] = to.density[d];
        }
    };
    parallel_for(count, progress, plan, kBoth, kBoth);
    if (options.omega == 0.0 && !options.crowding) return;

    std::optional<Lifetimes> lifetimes;
    {
        const Progress::Part part(progress, kBoth, kTriangles);
        lifetimes.emplace(*this, pairs, from, to, progress);
    }
    const Progress::Part part(progress, kTriangles, 1.0);
    lifetimes->pass(frame_at, progress);
    plan_.points = lifetimes->points();
    plan_.hidden = lifetimes->hidden();
}

Resampling::Resampling(ResamplingPlan plan, Index pairs, const ResamplingOptions& options)
    : options_(options), plan_(std::move(plan)) {
    const auto refuse = [](const std::string& found) {
        throw CloudError("resampling", "a plan for these pairs", found,
                         "Use the morph's own plan.");
    };
    for (const Values* values : {&plan_.source_spacing, &plan_.target_spacing,
                                 &plan_.source_density, &plan_.target_density})
        if (values->size() != pairs) refuse("one for " + std::to_string(values->size()) + " pairs");
    for (const Values* values : {&plan_.source_spacing, &plan_.target_spacing})
        if (!values->allFinite() || (values->array() < 0.0).any())
            refuse("a spacing that is negative or isn't finite");
    const auto check = [&](Index pair) {
        if (pair < 0 || pair >= pairs) refuse("pair " + std::to_string(pair));
    };
    const auto check_weight = [&](double weight) {
        constexpr double kRounding = 1e-9;
        if (!(weight >= -kRounding && weight <= 1.0 + kRounding))
            refuse("a weight of " + in_short(weight));
    };
    for (const InsertedPoint& point : plan_.points) {
        std::ranges::for_each(point.pairs, check);
        std::ranges::for_each(point.weights, check_weight);
    }
    for (const HiddenPair& hidden : plan_.hidden) check(hidden.pair);
}

double Resampling::unit_area(double t) const {
    const double size = (1.0 - t) * plan_.source_size + t * plan_.target_size;
    return size * size;
}

Resampling::Alive Resampling::at(double t, const OrientedPoints& frame, Progress& progress,
                                 const std::function<void()>& meanwhile) const {
    Alive alive;
    for (std::size_t i = 0; i < plan_.points.size(); ++i)
        if (plan_.points[i].lifetime.share(t) > 0.0) alive.ids.push_back(to_index(i));
    const auto count = to_index(alive.ids.size());
    alive.share.resize(count);
    alive.positions.resize(count, 3);
    alive.normals.resize(count, 3);
    if (count == 0) {
        if (meanwhile) meanwhile();
        return alive;
    }

    Normalization unit;
    Positions positions;
    std::optional<KdTree<3>> tree;
    parallel_invoke(2, [&](int k, bool) {
        if (k == 1) {
            unit = normalization(frame.positions);
            if (!(unit.scale > 0.0)) unit.scale = 1.0;  // all points lie in one place
            positions = unit.apply(frame.positions);
            tree.emplace(positions);
        } else if (meanwhile) {
            meanwhile();
        }
    });
    MlsOptions mls = options_.mls;
    if (mls.width) *mls.width /= unit.scale;
    constexpr Index kChunk = 32;
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            MlsProjection project(*tree, frame.normals, mls);
            for (Index i = begin; i < end; ++i) {
                const InsertedPoint& point = plan_.points[to_size(alive.ids[to_size(i)])];
                Vector3 place = blend(positions, point);
                Vector3 normal = gap_triangle_normal(positions, frame.normals, point);
                const double wanted =
                    blend(point, [&](Index pair) { return spacing(pair, t); }) / unit.scale;
                const double apart = edge_length(positions, point.pairs);
                const double coherence =
                    std::clamp((kTorn - apart / wanted) / (kTorn - kCoherent), 0.0, 1.0);
                if (coherence > 0.0) {
                    const double around = std::clamp(apart / kEvenEdge, wanted, kWidest * wanted);
                    const MlsFoot foot = project(place, normal, around);
                    place += coherence * (foot.position - place);
                    normal = (normal + coherence * (foot.normal - normal)).normalized();
                }
                alive.share[i] = point.lifetime.share(t);
                alive.positions.row(i) = (place * unit.scale + unit.center).transpose();
                alive.normals.row(i) = normal.transpose();
            }
        },
        0.0, 1.0, kChunk);
    return alive;
}

Values Resampling::pair_shares(double t) const {
    Values shares = Values::Ones(plan_.source_spacing.size());
    for (const HiddenPair& hidden : plan_.hidden)
        shares[hidden.pair] = std::min(shares[hidden.pair], 1.0 - hidden.lifetime.share(t));
    return shares;
}

}  // namespace pointmorph
