#include "cloud/winding_normals.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

// Rows are summed one after another for some places side by side, so that sums don't depend on how
// many numbers fit into a register.
constexpr int kAtOnce = 16;
using Floats = Eigen::Array<float, kAtOnce, 1>;

constexpr Index kChunk = 4 * kAtOnce;
constexpr Index kNeighborsAround = 16;
/// Widths that winding numbers are smoothed by, in spacings: the first and the last.
constexpr double kWide = 1.5, kNarrow = 0.7;
constexpr int kRounds = 6;

/// Some places, and what each of them is smoothed by.
struct Block {
    Floats x, y, z, area;
    int count;

    Block(const Eigen::ArrayX3f& positions, const Eigen::ArrayXf& areas, Index begin, Index end)
        : count(static_cast<int>(std::min<Index>(kAtOnce, end - begin))) {
        for (int k = 0; k < kAtOnce; ++k) {
            const Index i = begin + std::min(k, count - 1);
            x[k] = positions(i, 0);
            y[k] = positions(i, 1);
            z[k] = positions(i, 2);
            area[k] = areas[i];
        }
    }
};

/// Calls `add(j, dx, dy, dz, k, s)` for each dipole j and `finish(begin, block)` after them, for
/// all places: d from places to the dipole, s = d² + the squared width, k = s^(-3/2) / 4π.
template <class Make>
void for_all(const Eigen::ArrayX3f& places, const Eigen::ArrayXf& place_areas,
             const Eigen::ArrayX3f& dipoles, const Eigen::ArrayXf& areas, double width,
             Progress& progress, Make&& make) {
    const auto scale = static_cast<float>(0.5 * width * width);
    constexpr auto kShare = static_cast<float>(0.25 * std::numbers::inv_pi);
    const Index count = to_index(places.rows()), sources = to_index(dipoles.rows());
    parallel_for(
        count, progress,
        [&](Index first, Index last) {
            for (Index begin = first; begin < last; begin += kAtOnce) {
                const Block block(places, place_areas, begin, last);
                auto sums = make();
                for (Index j = 0; j < sources; ++j) {
                    const Floats dx = dipoles(j, 0) - block.x, dy = dipoles(j, 1) - block.y,
                                 dz = dipoles(j, 2) - block.z;
                    const Floats s = dx * dx + dy * dy + dz * dz + scale * (block.area + areas[j]);
                    const Floats k = kShare / (s * s.sqrt());
                    sums.add(j, dx, dy, dz, k, s);
                }
                sums.finish(begin, block.count);
            }
        },
        0.0, 1.0, kChunk);
}

/// Σ m·d k: the winding number of dipoles.
struct Numbers {
    const Eigen::ArrayX3f& moments;
    Eigen::ArrayXf& result;
    Floats sum = Floats::Zero();

    void add(Index j, const Floats& dx, const Floats& dy, const Floats& dz, const Floats& k,
             const Floats&) {
        sum += (moments(j, 0) * dx + moments(j, 1) * dy + moments(j, 2) * dz) * k;
    }
    void finish(Index begin, int count) const {
        for (int i = 0; i < count; ++i) result[begin + i] = sum[i];
    }
};

/// Σ −d k r: what changes winding numbers by as much as r says.
struct Changes {
    const Eigen::ArrayXf& by;
    Eigen::ArrayX3f& result;
    Floats x = Floats::Zero(), y = Floats::Zero(), z = Floats::Zero();

    void add(Index j, const Floats& dx, const Floats& dy, const Floats& dz, const Floats& k,
             const Floats&) {
        const Floats share = k * by[j];
        x -= dx * share;
        y -= dy * share;
        z -= dz * share;
    }
    void finish(Index begin, int count) const {
        for (int i = 0; i < count; ++i) {
            result(begin + i, 0) = x[i];
            result(begin + i, 1) = y[i];
            result(begin + i, 2) = z[i];
        }
    }
};

/// Σ k m − 3 k (m·d) d / s: how fast winding numbers fall.
struct Falls {
    const Eigen::ArrayX3f& moments;
    Eigen::ArrayX3f& result;
    Floats x = Floats::Zero(), y = Floats::Zero(), z = Floats::Zero();

    void add(Index j, const Floats& dx, const Floats& dy, const Floats& dz, const Floats& k,
             const Floats& s) {
        const float mx = moments(j, 0), my = moments(j, 1), mz = moments(j, 2);
        const Floats along = 3.0f * (mx * dx + my * dy + mz * dz) / s;
        x += k * (mx - along * dx);
        y += k * (my - along * dy);
        z += k * (mz - along * dz);
    }
    void finish(Index begin, int count) const {
        for (int i = 0; i < count; ++i) {
            result(begin + i, 0) = x[i];
            result(begin + i, 1) = y[i];
            result(begin + i, 2) = z[i];
        }
    }
};

double squares(const Eigen::ArrayXf& values) {
    return values.cast<double>().square().sum();
}

Normals unit(const Eigen::ArrayX3f& vectors) {
    Normals result = vectors.cast<double>().matrix();
    for (Index i = 0; i < to_index(result.rows()); ++i) {
        const double length = result.row(i).norm();
        if (length > 0.0)
            result.row(i) /= length;
        else
            result.row(i) << 0.0, 0.0, 1.0;
    }
    return result;
}

Eigen::ArrayX3f moments_of(const Normals& normals, const Eigen::ArrayXf& areas) {
    return normals.array().cast<float>().colwise() * areas;
}

}  // namespace

WindingNormals::WindingNormals(const Positions& positions, const Values& areas)
    : positions_(positions.array().cast<float>()), areas_(areas.array().cast<float>()) {}

Normals WindingNormals::find(const Normals& first, Progress& progress) const {
    const Index count = to_index(positions_.rows());
    Eigen::ArrayX3f moments = moments_of(first, areas_), changes(count, 3), falls(count, 3);
    Eigen::ArrayXf missing(count), changed(count);
    for (int round = 0; round < kRounds; ++round) {
        const Progress::Part part(progress, static_cast<double>(round) / kRounds,
                                  static_cast<double>(round + 1) / kRounds);
        const double width = kWide + (kNarrow - kWide) * round / (kRounds - 1);
        const auto for_points = [&](double begin, double end, auto&& make) {
            const Progress::Part its(progress, begin, end);
            for_all(positions_, areas_, positions_, areas_, width, progress, make);
        };
        // A step of steepest descent toward winding numbers of ½ on the surface.
        for_points(0.0, 0.25, [&] { return Numbers{moments, missing}; });
        missing = 0.5f - missing;
        for_points(0.25, 0.5, [&] { return Changes{missing, changes}; });
        for_points(0.5, 0.75, [&] { return Numbers{changes, changed}; });
        double slope = 0.0;
        for (int axis = 0; axis < 3; ++axis) slope += squares(changes.col(axis));
        const double curve = squares(changed);
        if (curve > 0.0) moments += static_cast<float>(slope / curve) * changes;
        for_points(0.75, 1.0, [&] { return Falls{moments, falls}; });
        moments = moments_of(unit(falls), areas_);
    }
    return unit(moments);
}

double WindingNormals::misfit(const Normals& normals, Progress& progress) const {
    constexpr float kOff = 0.5f;     // spacings
    constexpr double kSmooth = 0.4;  // of a disk instead of a point
    const Eigen::ArrayX3f moments = moments_of(normals, areas_);
    const Index count = to_index(positions_.rows());
    Eigen::ArrayXf found(count), off(count);
    for (const bool is_inside : {false, true}) {
        const Eigen::ArrayXf step = (is_inside ? -kOff : kOff) * areas_.sqrt();
        const Eigen::ArrayX3f places = positions_ + normals.array().cast<float>().colwise() * step;
        for_all(places, areas_, positions_, areas_, kSmooth, progress, [&] {
            return Numbers{moments, found};
        });
        const Eigen::ArrayXf wrong = areas_ * (found - (is_inside ? 1.0f : 0.0f)).square();
        off = is_inside ? Eigen::ArrayXf(off + wrong) : wrong;
    }
    return off.cast<double>().sum() / areas_.cast<double>().sum();
}

Normals WindingNormals::fall_at(const Normals& normals, const Positions& places,
                                const Values& areas, Progress& progress) const {
    const Eigen::ArrayX3f moments = moments_of(normals, areas_);
    Eigen::ArrayX3f falls(places.rows(), 3);
    for_all(places.array().cast<float>(), areas.array().cast<float>(), positions_, areas_, kNarrow,
            progress, [&] {
                return Falls{moments, falls};
            });
    return unit(falls);
}

void orient_by_winding(const Positions& positions, std::span<const Index> rows, Normals& normals,
                       Progress& progress) {
    constexpr Index kMost = 2500;
    constexpr Index kFewest = 100;                  // fewer hardly enclose anything
    constexpr double kClear = 0.035;                // what right normals of smooth surfaces leave
    constexpr double kBetter = 0.8, kClosed = 0.2;  // an open surface leaves more
    constexpr double kReversed = 0.005;             // a share: else only what is right is smoothed
    const Index count = to_index(rows.size());
    if (count < kFewest) return;
    const Index some = std::min(count, kMost);
    std::vector<Index> sampled;  // evenly, if rows next to each other are near each other
    for (Index k = 0; k < some; ++k)
        sampled.push_back(rows[static_cast<std::size_t>(std::int64_t{k} * count / some)]);

    Positions places = gather(positions, sampled);
    const Eigen::RowVector3d middle = places.colwise().mean();
    places.rowwise() -= middle;
    const double size = std::sqrt(places.squaredNorm() / static_cast<double>(some));
    if (!(size > 0.0)) return;
    places /= size;  // so that floats are enough
    const Normals given = gather(normals, sampled);
    const KdTree<3> tree(places);
    const auto part = [&](double first, double last, auto&& work) {
        const Progress::Part its(progress, first, last);
        return work();
    };
    const Neighborhoods near =
        part(0.0, 0.0, [&] { return nearest_neighbors(tree, kNeighborsAround, progress); });
    const Values found_areas = local_spacing(places, near, kNeighborsAround).array().square();
    constexpr double kLeast = 1e-4;  // of the mean, for points at one place
    const Values areas = found_areas.cwiseMax(kLeast * found_areas.mean());
    const WindingNormals winding(places, areas);
    const double before = part(0.0, 0.1, [&] { return winding.misfit(given, progress); });
    if (!(before >= kClear)) return;
    const Normals found = part(0.1, 0.7, [&] { return winding.find(given, progress); });
    const double after = part(0.7, 0.8, [&] { return winding.misfit(found, progress); });
    if (!(after < std::min(kBetter * before, kClosed))) return;
    const double reversed =
        ((found.array() * given.array()).rowwise().sum() < 0.0).cast<double>().mean();
    if (reversed < kReversed) return;
    if (some == count) {
        for (Index k = 0; k < count; ++k) normals.row(rows[to_size(k)]) = found.row(k);
        return;
    }
    const Positions all = (gather(positions, rows).rowwise() - middle) / size;
    const Values spread = Values::Constant(count, areas.mean());
    const Normals falls =
        part(0.8, 1.0, [&] { return winding.fall_at(found, all, spread, progress); });
    for (Index k = 0; k < count; ++k)
        if (falls.row(k).dot(normals.row(rows[to_size(k)])) < 0.0)
            normals.row(rows[to_size(k)]) *= -1.0;
}

}  // namespace pointmorph
