#include "disk/cut_ground.hpp"

#include <algorithm>

namespace pointmorph {

namespace {

/// Where each of `rows` stands among the features of a ground.
std::vector<Index> places_of(std::span<const Index> rows, std::span<const Index> features) {
    std::vector<Index> places;
    for (const Index row : rows)
        places.push_back(to_index(std::ranges::find(features, row) - features.begin()));
    return places;
}

/// Rows and columns so that feature k is the one that was `places[k]`.
Eigen::MatrixXd in_new_order(const Eigen::MatrixXd& from, std::span<const Index> places) {
    Eigen::MatrixXd result(from.rows(), from.cols());
    for (std::size_t k = 0; k < places.size(); ++k)
        result.col(static_cast<Eigen::Index>(k)) = from.col(places[k]);
    const Eigen::MatrixXd first = result.topRows(from.cols());
    for (std::size_t k = 0; k < places.size(); ++k)
        result.row(static_cast<Eigen::Index>(k)) = first.row(places[k]);
    return result;
}

}  // namespace

CutGround::CutGround(const SampledSurface& shape, const KdTree<3>& shape_tree,
                     std::span<const Index> features, const DecompositionOptions& options,
                     Progress& progress)
    : surface(shape),
      tree(shape_tree),
      coarse(surface, tree, features, options.points, progress),
      from(distances_from_features(coarse, features.size())) {
    constexpr Index kMost = 100;
    extremities = pointmorph::extremities(coarse, kMost, progress);
}

CutGround::CutGround(const CutGround& other, std::span<const Index> features)
    : surface(other.surface),
      tree(other.tree),
      coarse(other.coarse, places_of(features, other.features())),
      from(in_new_order(other.from, places_of(features, other.features()))),
      extremities(other.extremities) {
    const std::vector<Index> places = places_of(other.features(), features);
    for (Extremity& e : extremities)
        if (e.point < to_index(places.size())) e.point = places[to_size(e.point)];
}

bool CutGround::has(std::span<const Index> rows) const {
    return std::ranges::is_permutation(rows, features());
}

FeatureReach feature_reach(const CutGround& ground) {
    const auto count = ground.from.cols();
    FeatureReach reach{ground.from.topRows(count).transpose(),
                       std::vector<char>(to_size(count), 0)};
    if (count == 0) return reach;
    for (const Extremity& extremity : ground.extremities) {
        // The nearest feature marks it, if it's near enough.
        Eigen::Index nearest_feature;
        if (ground.from.row(extremity.point).minCoeff(&nearest_feature) <= kMarked)
            reach.at_extremity[to_size(nearest_feature)] = 1;
    }
    return reach;
}

}  // namespace pointmorph
