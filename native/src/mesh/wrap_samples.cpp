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
        parallel_for(to_index(now.rows()), progress, [&](Index begin, Index end) {
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

/// How many places of a part of the mesh lie nearest to samples of a part of the target.
struct Vote {
    Index part, target, places;
};

/// All but those of no place, by part and target: of very many parts, most have nothing to do with
/// each other.
std::vector<Vote> votes_of(const Mesh& mesh, const Positions& start, const Positions& samples,
                           const std::vector<Index>& parts) {
    const KdTree<3> tree(samples);
    std::vector<std::array<Index, 2>> all;
    for (Index p = 0; p < mesh.positions.rows(); ++p) {
        if (mesh.parts[to_size(p)] < 0) continue;
        Index nearest = 0;
        double squared = 0.0;
        tree.nearest(start.row(p).data(), {&nearest, 1}, {&squared, 1});
        all.push_back({mesh.parts[to_size(p)], parts[to_size(nearest)]});
    }
    std::ranges::sort(all);
    std::vector<Vote> votes;
    for (const auto& [part, target] : all) {
        if (votes.empty() || votes.back().part != part || votes.back().target != target)
            votes.push_back({part, target, 0});
        ++votes.back().places;
    }
    return votes;
}

}  // namespace

std::vector<Index> parts_kept_to(const Mesh& mesh, const Positions& start, const Positions& samples,
                                 const std::vector<Index>& parts) {
    constexpr double kMost = 0.6, kMuch = 0.1;
    const auto count = to_index(mesh.part_areas.size());
    std::vector<Index> result(to_size(count), -1);
    if (parts.empty()) return result;
    const Index targets = 1 + *std::ranges::max_element(parts);
    if (count == 1 && targets == 1) return result;
    const std::vector<Vote> votes = votes_of(mesh, start, samples, parts);
    std::vector<Index> of_part(to_size(count), 0), most_for(to_size(targets), 0);
    for (const Vote& vote : votes) {
        of_part[to_size(vote.part)] += vote.places;
        most_for[to_size(vote.target)] = std::max(most_for[to_size(vote.target)], vote.places);
    }
    // A bottle that becomes a lamp is its foot and its shade as well, which nothing else becomes.
    const auto becomes = [&](const Vote& vote) {
        return vote.places > kMuch * of_part[to_size(vote.part)] &&
               vote.places == most_for[to_size(vote.target)];
    };
    for (auto first = votes.begin(); first != votes.end();) {
        const Index part = first->part;
        const auto last =
            std::find_if(first, votes.end(), [&](const Vote& vote) { return vote.part != part; });
        const auto best = std::max_element(
            first, last, [](const Vote& a, const Vote& b) { return a.places < b.places; });
        const bool is_one = best->places > kMost * of_part[to_size(part)] &&
                            std::none_of(first, last, [&](const Vote& vote) {
                                return vote.target != best->target && becomes(vote);
                            });
        if (is_one) result[to_size(part)] = best->target;
        first = last;
    }
    return result;
}

class WrapTrees::Tree {
public:
    using Query = Eigen::Matrix<double, 1, 6>;

    /// Of the samples in `rows`; of all of them where there are none. Keeps references to all
    /// samples.
    Tree(const Positions& positions, const Normals& normals, std::vector<Index> rows, double scale,
         double weight)
        : positions_(positions),
          normals_(normals),
          rows_(std::move(rows)),
          scale_(scale),
          weight_(weight),
          search_(keys()) {}

    Query query(const Eigen::RowVector3d& place, const Eigen::RowVector3d& normal) const {
        Query result;
        result << place, weight_ * normal;
        return result;
    }
    /// The nearest closer than `radius`; `otherwise` where none is.
    Index nearest(const Query& query, double radius, Index otherwise) const {
        double squared = 0.0;
        search_.nearest_within(query.data(), radius, {&otherwise, 1}, {&squared, 1});
        return otherwise;
    }
    Query key(Index i) const { return query(place(i), normal(i)); }
    Eigen::RowVector3d place(Index i) const { return scale_ * positions_.row(row(i)); }
    Eigen::RowVector3d normal(Index i) const { return normals_.row(row(i)); }

private:
    Index row(Index i) const { return rows_.empty() ? i : rows_[to_size(i)]; }

    KdTree<6> keys() const {
        const Eigen::Index count =
            rows_.empty() ? positions_.rows() : static_cast<Eigen::Index>(rows_.size());
        KdTree<6>::Points keys(count, 6);
        for (Index i = 0; i < count; ++i) keys.row(i) = key(i);
        return KdTree<6>(keys);
    }

    const Positions& positions_;
    const Normals& normals_;
    std::vector<Index> rows_;
    double scale_, weight_;  ///< of positions, and of normals
    KdTree<6> search_;
};

WrapTrees::WrapTrees(const WrapTarget& target, double scale) : target_(target), scale_(scale) {}

WrapTrees::~WrapTrees() = default;

const WrapTrees::Tree& WrapTrees::of_part(Kind kind, Index part, Progress& progress) {
    auto& trees = trees_[kind];
    if (trees.size() < to_size(part) + 2) trees.resize(to_size(part) + 2);
    auto& tree = trees[to_size(part + 1)];
    if (tree) return *tree;
    const OrientedPoints& samples = kind == kCoarse ? target_.coarse : target_.fine;
    const std::vector<Index>& labels = kind == kCoarse ? target_.coarse_parts : target_.fine_parts;
    if (kind == kCoarse && smooth_.rows() == 0) smooth_ = smoothed(samples, progress);
    std::vector<Index> rows;
    if (part >= 0 && !labels.empty()) {
        Grouped<Index>& of_parts = rows_[kind];
        if (of_parts.size() == 0)
            of_parts = Grouped<Index>(1 + *std::ranges::max_element(labels), [&](auto&& take) {
                for (std::size_t i = 0; i < labels.size(); ++i) take(labels[i], to_index(i));
            });
        if (part < of_parts.size()) rows.assign(of_parts[part].begin(), of_parts[part].end());
    }
    progress.report(0.0);
    tree = kind == kCoarse ? std::make_unique<Tree>(samples.positions, smooth_, std::move(rows),
                                                    scale_, kCoarseNormals)
                           : std::make_unique<Tree>(samples.positions, samples.normals,
                                                    std::move(rows), scale_, kFineNormals);
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
    constexpr double kBarelyMore = 1.0 + 1e-9;
    std::vector<const WrapTrees::Tree*> of_parts;
    for (const Index part : target_parts_)
        of_parts.push_back(&trees_.of_part(kind, part, progress));
    last_[kind].resize(mesh_.parts.size(), -1);
    WrapPartners result{x, normals};
    parallel_for(
        to_index(x.rows()), progress,
        [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                if (mesh_.parts[to_size(v)] < 0) continue;
                const WrapTrees::Tree& samples = *of_parts[to_size(mesh_.parts[to_size(v)])];
                const auto query = samples.query(x.row(v), normals.row(v));
                Index& nearest = last_[kind][to_size(v)];
                const double radius = nearest < 0
                                          ? std::numeric_limits<double>::infinity()
                                          : (samples.key(nearest) - query).norm() * kBarelyMore;
                nearest = samples.nearest(query, radius, std::max(nearest, 0));
                result.positions.row(v) = samples.place(nearest);
                result.normals.row(v) = samples.normal(nearest);
            }
        },
        0.0, 0.0, 128);
    return result;
}

std::pair<Vector3, Vector3> WrapSamples::partner(Index vertex, const Vector3& place,
                                                 const Vector3& normal) const {
    const Index part = target_parts_[to_size(mesh_.parts[to_size(vertex)])];
    const WrapTrees::Tree& samples = trees_.made(WrapTrees::kFine, part);
    const Index nearest = samples.nearest(samples.query(place.transpose(), normal.transpose()),
                                          std::numeric_limits<double>::infinity(), 0);
    return {samples.place(nearest).transpose(), samples.normal(nearest).transpose()};
}

std::vector<Index> WrapSamples::uncovered(const TriangleTree& mesh, double distance,
                                          Progress& progress) const {
    const auto count = to_index(on_mesh_.size());
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
