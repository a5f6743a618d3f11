#include "pointmorph/frames/stagger.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kPlaces = 9;

/// 0 to 1, of a corner of a cell.
double hashed(const std::array<std::int64_t, 3>& corner, Index seed) {
    auto bits = static_cast<std::uint64_t>(seed) + 0x9e3779b97f4a7c15U;
    for (const std::int64_t k : corner) {
        bits ^= static_cast<std::uint64_t>(k);
        bits *= 0xbf58476d1ce4e5b9U;
        bits ^= bits >> 31U;
        bits *= 0x94d049bb133111ebU;
        bits ^= bits >> 29U;
    }
    return static_cast<double>(bits >> 11U) * 0x1p-53;
}

/// Between the corners of the cells of side 1: smooth.
double noise(const Vector3& place, Index seed) {
    const Vector3 cell = place.array().floor();
    const Vector3 x = place - cell;
    const Vector3 share = x.array().cube() * (x.array() * (6.0 * x.array() - 15.0) + 10.0);
    double sum = 0.0;
    for (unsigned corner = 0; corner < 8; ++corner) {
        double weight = 1.0;
        std::array<std::int64_t, 3> at{};
        for (unsigned d = 0; d < 3; ++d) {
            const bool far = ((corner >> d) & 1U) != 0;
            weight *= far ? share[d] : 1.0 - share[d];
            at[d] = static_cast<std::int64_t>(cell[d]) + (far ? 1 : 0);
        }
        sum += weight * hashed(at, seed);
    }
    return sum;
}

/// Stretched so that the least is 0 and the largest 1.
void spread(Values& values) {
    const double least = values.minCoeff(), extent = values.maxCoeff() - least;
    values = extent > 0.0 ? Values((values.array() - least) / extent)
                          : Values(Values::Zero(values.size()));
}

void check(const Values& given, Eigen::Index count) {
    const auto refuse = [](const std::string& found) {
        throw CloudError("delay", "a number from 0 to 1 for each point", found,
                         "Give the source valid delays.");
    };
    if (given.size() == 0) refuse("none");
    if (given.size() != count) refuse(std::to_string(given.size()) + " numbers");
    for (const double value : given)
        if (!(value >= 0.0 && value <= 1.0)) refuse(in_short(value));
}

}  // namespace

Values delays(const Positions& positions, const Values& given, const StaggerOptions& options) {
    if (options.kind == StaggerKind::kNone) return {};
    Values found;
    if (options.kind == StaggerKind::kDelay) {
        check(given, positions.rows());
        found = given;
    } else if (options.kind == StaggerKind::kNoise) {
        const Vector3 least = positions.colwise().minCoeff().transpose();
        const Vector3 extent = positions.colwise().maxCoeff().transpose() - least;
        const double side = std::max(options.size * extent.norm(), 1e-300);
        found.resize(positions.rows());
        Progress silent;
        parallel_for(to_index(found.size()), silent, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i)
                found[i] = noise((positions.row(i).transpose() - least) / side, options.seed);
        });
        spread(found);
    } else {
        found = positions.col(static_cast<int>(options.kind) - static_cast<int>(StaggerKind::kX));
        spread(found);
    }
    if (options.is_reversed) found = 1.0 - found.array();
    return found;
}

double local_time(double t, double delay, const StaggerOptions& options) {
    constexpr double kLeast = 0.01;
    if (t <= 0.0 || t >= 1.0) return t <= 0.0 ? 0.0 : 1.0;
    const double takes = std::max(options.overlap, kLeast);
    const double done = std::clamp((t - delay * (1.0 - takes)) / takes, 0.0, 1.0);
    return done + options.falloff * (done * done * (3.0 - 2.0 * done) - done);
}

PointwisePath::PointwisePath(OrientedPoints start, OrientedPoints end,
                             const std::function<OrientedPoints(double)>& at) {
    // Closer near the ends (Chebyshev and Lobatto), so that the polynomial doesn't swing.
    for (std::size_t k = 0; k < kPlaces; ++k)
        times_.push_back(0.5 - 0.5 * std::cos(std::numbers::pi * static_cast<double>(k) /
                                              static_cast<double>(kPlaces - 1)));
    times_.front() = 0.0;
    times_.back() = 1.0;
    places_.push_back(std::move(start));
    for (std::size_t k = 1; k + 1 < kPlaces; ++k) places_.push_back(at(times_[k]));
    places_.push_back(std::move(end));
}

OrientedPoints PointwisePath::at(const Values& times) const {
    const bool with_normals = places_.front().normals.rows() > 0;
    OrientedPoints result{Positions(times.size(), 3), Normals(with_normals ? times.size() : 0, 3)};
    std::array<double, kPlaces> scales{};
    for (std::size_t k = 0; k < kPlaces; ++k) {
        scales[k] = 1.0;
        for (std::size_t j = 0; j < kPlaces; ++j)
            if (j != k) scales[k] /= times_[k] - times_[j];
    }
    Progress silent;
    parallel_for(to_index(times.size()), silent, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const double t = times[i];
            if (t <= 0.0 || t >= 1.0) {
                const OrientedPoints& given = t <= 0.0 ? places_.front() : places_.back();
                result.positions.row(i) = given.positions.row(i);
                if (with_normals) result.normals.row(i) = given.normals.row(i);
                continue;
            }
            Vector3 place = Vector3::Zero(), normal = Vector3::Zero();
            for (std::size_t k = 0; k < kPlaces; ++k) {
                double share = scales[k];
                for (std::size_t j = 0; j < kPlaces; ++j)
                    if (j != k) share *= t - times_[j];
                place += share * places_[k].positions.row(i).transpose();
                if (with_normals) normal += share * places_[k].normals.row(i).transpose();
            }
            result.positions.row(i) = place.transpose();
            if (with_normals) result.normals.row(i) = normal.normalized().transpose();
        }
    });
    return result;
}

}  // namespace pointmorph
