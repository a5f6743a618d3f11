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

}  // namespace

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

struct WrapTrees::Tree {
    KdTree<6>::Points places;  ///< and normals times their weight
    KdTree<6> search;

    explicit Tree(KdTree<6>::Points points) : places(std::move(points)), search(places) {}
};

WrapTrees::WrapTrees(const WrapTarget& target, double scale) : target_(target), scale_(scale) {}

WrapTrees::~WrapTrees() = default;

double WrapTrees::weight(Kind kind) {
    return kind == kCoarse ? kCoarseNormals : kFineNormals;
}

const WrapTrees::Tree& WrapTrees::of_part(Kind kind, Index part, Progress& progress) {
    auto& trees = trees_[kind];
    if (trees.size() < to_size(part) + 2) trees.resize(to_size(part) + 2);
    auto& tree = trees[to_size(part + 1)];
    if (tree) return *tree;
    const OrientedPoints& samples = kind == kCoarse ? target_.coarse : target_.fine;
    const std::vector<Index>& labels = kind == kCoarse ? target_.coarse_parts : target_.fine_parts;
    Normals smooth;
    if (kind == kCoarse) smooth = smoothed(samples, progress);
    const Normals& normals = kind == kCoarse ? smooth : samples.normals;
    const auto all = static_cast<Index>(samples.positions.rows());
    const Index count = part < 0 ? all : static_cast<Index>(std::ranges::count(labels, part));
    KdTree<6>::Points places(count, 6);
    for (Index i = 0, row = 0; i < all; ++i)
        if (part < 0 || labels[to_size(i)] == part)
            places.row(row++) << scale_ * samples.positions.row(i), weight(kind) * normals.row(i);
    progress.report(0.0);
    tree = std::make_unique<Tree>(std::move(places));
    return *tree;
}

WrapSamples::WrapSamples(const Mesh& mesh, const Positions& start,
                         const std::vector<SurfacePoint>& on_mesh, WrapTrees& trees)
    : mesh_(mesh), on_mesh_(on_mesh), trees_(trees) {
    const WrapTarget& target = trees.target();
    target_parts_ =
        parts_kept_to(mesh, start, target.coarse.positions * trees.scale(), target.coarse_parts);
}

WrapPartners WrapSamples::partners(const Positions& x, const Normals& normals, Kind kind,
                                   Progress& progress) {
    const double weight = WrapTrees::weight(kind);
    constexpr double kBarelyMore = 1.0 + 1e-9;
    std::vector<const WrapTrees::Tree*> of_parts;
    for (const Index part : target_parts_)
        of_parts.push_back(&trees_.of_part(kind, part, progress));
    last_[kind].resize(mesh_.parts.size(), -1);
    WrapPartners result{x, normals};
    parallel_for(
        static_cast<Index>(x.rows()), progress,
        [&](Index begin, Index end) {
            Eigen::Matrix<double, 1, 6> query;
            for (Index v = begin; v < end; ++v) {
                if (mesh_.parts[to_size(v)] < 0) continue;
                const WrapTrees::Tree& samples = *of_parts[to_size(mesh_.parts[to_size(v)])];
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

std::pair<Vector3, Vector3> WrapSamples::partner(Index vertex, const Vector3& place,
                                                 const Vector3& normal) const {
    const Index part = target_parts_[to_size(mesh_.parts[to_size(vertex)])];
    const WrapTrees::Tree& samples = trees_.made(WrapTrees::kFine, part);
    Eigen::Matrix<double, 1, 6> query;
    query << place.transpose(), kFineNormals * normal.transpose();
    Index nearest = 0;
    double squared = 0.0;
    samples.search.nearest(query.data(), {&nearest, 1}, {&squared, 1});
    return {samples.places.row(nearest).head<3>().transpose(),
            samples.places.row(nearest).tail<3>().transpose() / kFineNormals};
}

std::vector<Index> WrapSamples::uncovered(const TriangleTree& mesh, double distance,
                                          Progress& progress) const {
    const auto count = static_cast<Index>(on_mesh_.size());
    std::vector<char> is_far(to_size(count), 0);
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index s = begin; s < end; ++s) {
                const Index face = on_mesh(s).triangle;
                if (face < 0) continue;
                const Index part =
                    target_parts_[to_size(mesh_.parts[to_size(mesh_.triangles(face, 0))])];
                if (part >= 0 && part != trees_.target().coarse_parts[to_size(s)]) continue;
                is_far[to_size(s)] = mesh.closest(position(s), distance, face).triangle < 0;
            }
        },
        0.0, 0.0, 128);
    std::vector<Index> result;
    for (Index s = 0; s < count; ++s)
        if (is_far[to_size(s)]) result.push_back(s);
    return result;
}

Vector3 WrapSamples::position(Index sample) const {
    return trees_.scale() * trees_.target().coarse.positions.row(sample).transpose();
}

double WrapSamples::share() const {
    return 1.0 / static_cast<double>(trees_.target().coarse.positions.rows());
}

}  // namespace pointmorph
