#include "mesh/wrap_samples.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

/// How far apart, in √area, opposite normals count as; halved.
constexpr double kCoarseNormals = 0.06, kFineNormals = 0.005;

/// Normals averaged over those around on the same side, a few times.
Normals smoothed(const OrientedPoints& points, Progress& progress) {
    constexpr Index kAround = 8;
    constexpr int kTimes = 3;
    const KdTree<3> tree(points.positions);
    const Neighborhoods nearest = nearest_neighbors(tree, kAround, progress);
    Normals now = points.normals, next(now.rows(), 3);
    for (int time = 0; time < kTimes; ++time) {
        parallel_for(static_cast<Index>(now.rows()), progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                Eigen::RowVector3d sum = now.row(i);
                for (const Index j : nearest[i])
                    if (now.row(j).dot(now.row(i)) > 0.0) sum += now.row(j);
                next.row(i) = sum.normalized();
            }
        });
        now.swap(next);
    }
    return now;
}

/// The part of the target whose samples lie nearest to most of each part of the mesh; −1 where
/// none has most.
std::vector<Index> parts_kept_to(const Mesh& mesh, const Positions& start, const Positions& samples,
                                 const std::vector<Index>& parts) {
    constexpr double kMost = 0.6;
    const auto count = static_cast<Index>(mesh.part_areas.size());
    std::vector<Index> result(to_size(count), -1);
    if (parts.empty()) return result;
    const Index targets = 1 + *std::ranges::max_element(parts);
    if (count == 1 && targets == 1) return result;
    const KdTree<3> tree(samples);
    Eigen::MatrixXd votes = Eigen::MatrixXd::Zero(count, targets);
    for (Index p = 0; p < mesh.positions.rows(); ++p) {
        if (mesh.parts[to_size(p)] < 0) continue;
        Index nearest = 0;
        double squared = 0.0;
        tree.nearest(start.row(p).data(), {&nearest, 1}, {&squared, 1});
        votes(mesh.parts[to_size(p)], parts[to_size(nearest)]) += 1.0;
    }
    for (Index part = 0; part < count; ++part) {
        Index best = 0;
        const double most = votes.row(part).maxCoeff(&best);
        if (most > kMost * votes.row(part).sum()) result[to_size(part)] = best;
    }
    return result;
}

}  // namespace

struct WrapSamples::Tree {
    KdTree<6>::Points places;  ///< and normals times their weight
    KdTree<6> search;

    explicit Tree(KdTree<6>::Points points) : places(std::move(points)), search(places) {}
};

WrapSamples::WrapSamples(const Mesh& mesh, const Positions& start, const WrapTarget& target,
                         double scale)
    : mesh_(mesh), target_(target), scale_(scale) {
    target_parts_ =
        parts_kept_to(mesh, start, target.coarse.positions * scale, target.coarse_parts);
}

/// When first asked for: fine samples are many.
void WrapSamples::make_trees(Kind kind, Progress& progress) {
    const OrientedPoints& samples = kind == kCoarse ? target_.coarse : target_.fine;
    const std::vector<Index>& labels = kind == kCoarse ? target_.coarse_parts : target_.fine_parts;
    const double weight = kind == kCoarse ? kCoarseNormals : kFineNormals;
    Normals smooth;
    if (kind == kCoarse) smooth = smoothed(samples, progress);
    const Normals& normals = kind == kCoarse ? smooth : samples.normals;
    const Index parts = labels.empty() ? 1 : 1 + *std::ranges::max_element(labels);
    trees_[kind].resize(to_size(parts) + 1);
    for (Index part = -1; part < parts; ++part) {
        if (std::ranges::find(target_parts_, part) == target_parts_.end()) continue;
        const auto is_inside = [&](Index i) { return part < 0 || labels[to_size(i)] == part; };
        const auto all = static_cast<Index>(samples.positions.rows());
        Index count = all;
        if (part >= 0) count = static_cast<Index>(std::ranges::count(labels, part));
        KdTree<6>::Points places(count, 6);
        for (Index i = 0, row = 0; i < all; ++i)
            if (is_inside(i))
                places.row(row++) << scale_ * samples.positions.row(i), weight * normals.row(i);
        trees_[kind][to_size(part + 1)] = std::make_unique<Tree>(std::move(places));
    }
    last_[kind].assign(mesh_.parts.size(), -1);
}

WrapSamples::~WrapSamples() = default;

const WrapSamples::Tree& WrapSamples::tree(Kind kind, Index part) const {
    return *trees_[kind][to_size(target_parts_[to_size(part)] + 1)];
}

WrapPartners WrapSamples::partners(const Positions& x, const Normals& normals, Kind kind,
                                   Progress& progress) {
    const double weight = kind == kCoarse ? kCoarseNormals : kFineNormals;
    constexpr double kBarelyMore = 1.0 + 1e-9;
    if (trees_[kind].empty()) make_trees(kind, progress);
    WrapPartners result{x, normals};
    parallel_for(
        static_cast<Index>(x.rows()), progress,
        [&](Index begin, Index end) {
            Eigen::Matrix<double, 1, 6> query;
            for (Index v = begin; v < end; ++v) {
                if (mesh_.parts[to_size(v)] < 0) continue;
                const Tree& samples = tree(kind, mesh_.parts[to_size(v)]);
                query << x.row(v), weight * normals.row(v);
                Index& nearest = last_[kind][to_size(v)];
                double radius = std::numeric_limits<double>::infinity(), squared = 0.0;
                if (nearest >= 0)
                    radius = (samples.places.row(nearest) - query).norm() * kBarelyMore;
                else
                    nearest = 0;
                if (radius > 0.0)
                    samples.search.nearest_within(query.data(), radius, {&nearest, 1},
                                                  {&squared, 1});
                result.positions.row(v) = samples.places.row(nearest).head<3>();
                result.normals.row(v) = samples.places.row(nearest).tail<3>() / weight;
            }
        },
        0.0, 0.0, 128);
    return result;
}

std::vector<Index> WrapSamples::uncovered(const TriangleTree& mesh, double distance,
                                          Progress& progress) const {
    const auto count = static_cast<Index>(target_.on_mesh.size());
    std::vector<char> is_far(to_size(count), 0);
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index s = begin; s < end; ++s) {
                const Index face = on_mesh(s).triangle;
                if (face < 0) continue;
                const Index part =
                    target_parts_[to_size(mesh_.parts[to_size(mesh_.triangles(face, 0))])];
                if (part >= 0 && part != target_.coarse_parts[to_size(s)]) continue;
                is_far[to_size(s)] = mesh.closest(position(s), distance, face).triangle < 0;
            }
        },
        0.0, 0.0, 128);
    std::vector<Index> result;
    for (Index s = 0; s < count; ++s)
        if (is_far[to_size(s)]) result.push_back(s);
    return result;
}

const SurfacePoint& WrapSamples::on_mesh(Index sample) const {
    return target_.on_mesh[to_size(sample)];
}

Vector3 WrapSamples::position(Index sample) const {
    return scale_ * target_.coarse.positions.row(sample).transpose();
}

double WrapSamples::share() const {
    return 1.0 / static_cast<double>(target_.coarse.positions.rows());
}

}  // namespace pointmorph
