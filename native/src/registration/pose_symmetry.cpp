#include "pointmorph/registration/pose_symmetry.hpp"

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/candidate_poses.hpp"
#include "pointmorph/registration/pose.hpp"
#include "registration/pose_trials.hpp"
#include "registration/self_motions.hpp"

namespace pointmorph {

namespace {

CoarseShape mirrored(CoarseShape shape) {
    shape.positions.col(0) *= -1.0;
    shape.normals.col(0) *= -1.0;
    return shape;
}

/// Where a map takes places in space that is known at `points`: as it does the nearest of them.
/// `linear` is what it does to small steps.
Positions mapped(const Positions& places, const std::vector<Index>& nearest,
                 const Positions& points, const Positions& images, const Matrix3& linear) {
    Positions result(places.rows(), 3);
    for (Eigen::Index i = 0; i < places.rows(); ++i) {
        const Index near = nearest[to_size(i)];
        result.row(i) = images.row(near) + (places.row(i) - points.row(near)) * linear.transpose();
    }
    return result;
}

/// Weighted mean of min(1, (d/far)²) over the distances d.
double far_share(const Positions& a, const Positions& b, const Values& weights, double far) {
    const Values squared = (a - b).rowwise().squaredNorm() / (far * far);
    return weights.dot(squared.cwiseMin(1.0)) / weights.sum();
}

/// Whether some other side of a shape looks like the one in front: it has two reflections then, or
/// none.
bool turns_onto_itself(const CoarseShape& shape, const PoseOptions& options) {
    std::vector<Index> rows(to_size(shape.size()));
    std::iota(rows.begin(), rows.end(), 0);
    const SelfMotions motions(shape, rows);
    return std::ranges::any_of(candidate_poses({shape, shape}, options), [&](const Similarity& m) {
        return motions.distance(m) > kOtherCluster && motions.keep(m);
    });
}

/// Of the poses of a shape's mirror image, the few that lay it best onto the shape as they stand;
/// where its axes are told apart there are no more.
std::vector<Similarity> likeliest(const CoarseShape& shape, const CoarseShape& image,
                                  std::vector<Similarity> poses) {
    constexpr std::size_t kMost = 8;
    if (poses.size() <= kMost) return poses;
    const KdTree<3> tree(shape.positions);
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t k = 0; k < poses.size(); ++k) {
        const Positions there = poses[k].apply(image.positions);
        const Positions nearest = gather(shape.positions, nearest_rows(tree, there));
        order.emplace_back((there - nearest).squaredNorm(), k);
    }
    std::ranges::sort(order);
    std::vector<Similarity> result;
    for (std::size_t k = 0; k < kMost; ++k) result.push_back(poses[order[k].second]);
    return result;
}

}  // namespace

Symmetry reflection_symmetry(const CoarseShape& shape, const Eigen::MatrixXd& distances,
                             const PoseOptions& options, const RegistrationOptions& registration,
                             Progress& progress) {
    constexpr double kAlike = 1.2;  // spreads of the same shape
    CoarseShape plain = shape;
    // What is marked on one side alone would speak against any symmetry.
    plain.guides = {};
    plain.labels = {};
    plain.pulls = {};
    PoseOptions its = options;
    its.spread_ratio = kAlike;
    its.as_given = 1.0;  // a shape stands as its mirror image does
    if (turns_onto_itself(plain, its)) return {};
    const CoarseShape image = mirrored(plain);
    const PoseSearch search{
        {plain, plain, {}}, {image, image, {}}, {distances, distances}, {}, {}, its, registration};

    std::vector<TrialStart> starts;
    for (const Similarity& pose : likeliest(plain, image, candidate_poses({plain, image}, its)))
        starts.push_back({pose, {}});
    std::vector<Trial> trials;
    in_part(progress, 0.0, 0.7, [&] { try_starts(search, starts, trials, progress); });
    // The best of these may have left a leg behind: seen along its own plane it lies better.
    starts = {{implied_pose(search, trials.front()), {}}};
    in_part(progress, 0.7, 0.8, [&] { try_starts(search, starts, trials, progress); });
    const auto other = std::ranges::find_if(trials, [&](const Trial& trial) {
        return difference(trial, trials.front()) > kOtherCluster;
    });
    if (other != trials.end() && other->energy < its.symmetry.least_margin * trials.front().energy)
        return {};
    trials.resize(1);
    const Trial best =
        in_part(progress, 0.8, 1.0, [&] { return relaxed(search, trials, progress); }).front();
    const SymmetryOptions& bounds = its.symmetry;
    if (!(best.energy < bounds.most_energy)) return {};
    Symmetry result;
    result.trust = std::min(
        1.0, (bounds.most_energy - best.energy) / (bounds.most_energy - bounds.sure_energy));
    result.images = best.alignment.inverse().apply(best.registration.source_points.positions);
    result.linear = fit_similarity(plain.positions, result.images).rotation;
    result.images.col(0) *= -1.0;
    result.linear.row(0) *= -1.0;
    result.nearest = nearest_rows(KdTree<3>(plain.positions), result.images);
    return result;
}

double asymmetry(const CoarseShape& source, const CoarseShape& target,
                 const std::array<Symmetry, 2>& symmetries, const Images& source_images,
                 const Images& target_images, double far) {
    const auto& [s, t] = symmetries;
    if (s.images.rows() == 0 || t.images.rows() == 0) return 0.0;
    const auto of_one = [far](const CoarseShape& here, const Symmetry& its, const Images& images,
                              const CoarseShape& there, const Symmetry& other) {
        const Matrix3 linear = fit_similarity(here.positions, images.places).rotation;
        return far_share(
            mapped(its.images, its.nearest, here.positions, images.places, linear),
            mapped(images.places, images.nearest, there.positions, other.images, other.linear),
            here.areas, far);
    };
    return std::min(s.trust, t.trust) * 0.5 *
           (of_one(source, s, source_images, target, t) +
            of_one(target, t, target_images, source, s));
}

}  // namespace pointmorph
