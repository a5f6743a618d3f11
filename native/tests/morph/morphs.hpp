// Shapes that the tests of whole morphs share.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "pointmorph/morph/morph.hpp"
#include "shapes.hpp"

namespace pointmorph {

/// z of a soft bump over the square [−1, 1]².
inline double bump(double x, double y) {
    return 0.8 * std::exp(-3.0 * (x * x + y * y));
}

inline Cloud plane_cloud(Index side) {
    Cloud cloud;
    cloud.name = "plane";
    cloud.positions = shapes::grid(side);
    return cloud;
}

inline Cloud bump_cloud(Index side) {
    Cloud cloud = plane_cloud(side);
    cloud.name = "bump";
    for (Index i = 0; i < cloud.size(); ++i)
        cloud.positions(i, 2) = bump(cloud.positions(i, 0), cloud.positions(i, 1));
    return cloud;
}

inline Cloud hemisphere(Index count) {
    Cloud cloud;
    cloud.name = "hemisphere";
    cloud.positions = shapes::sphere(count, 0.0);
    return cloud;
}

/// Source rows near where they should be: the row of the grid nearest to (x, y).
inline Index grid_row(Index side, double x, double y) {
    const auto cell = [&](double c) { return to_index(std::lround((c + 1) / 2 * (side - 1))); };
    return cell(x) * side + cell(y);
}

inline std::vector<Feature> grid_features(Index source_side, Index target_side) {
    std::vector<Feature> features;
    int number = 0;
    for (const auto& [x, y] : {std::pair{0.0, 0.0}, {0.5, 0.5}, {-0.5, 0.5}, {0.5, -0.25}})
        features.push_back(point_feature("f" + std::to_string(number++),
                                         grid_row(source_side, x, y), grid_row(target_side, x, y)));
    return features;
}

/// Pairs of a morph of the same shapes, the source's points in another order, as rows of the order
/// that was given. Features are points.
inline Pairing pairs_in_another_order(MorphInput input, const MorphOptions& options) {
    const auto order = shapes::permutation(input.source.size(), 3);
    const auto rank = inverse_order(order);
    input.source.positions = gather(input.source.positions, order);
    for (Feature& feature : input.features)
        feature.source.rows[0] = rank[to_size(feature.source.rows[0])];
    Progress progress;
    Pairing pairs = Morph(std::move(input), options, progress).pairs();
    for (IndexPair& pair : pairs) pair.source = order[to_size(pair.source)];
    std::ranges::sort(pairs);
    return pairs;
}

inline Morph make(Cloud source, Cloud target, std::vector<Feature> features,
                  MorphOptions options = {}) {
    Progress progress;
    return Morph({std::move(source), std::move(target), std::move(features), {}, {}, {}}, options,
                 progress);
}

inline MorphOptions paper() {
    MorphOptions options;
    options.method = Method::kPaper;
    return options;
}

/// A closed egg with a belly, seen differently on both ends.
inline Cloud egg(Index count, double belly) {
    Cloud cloud;
    cloud.name = "egg";
    cloud.positions = shapes::sphere(count);
    for (Index i = 0; i < count; ++i) {
        const Eigen::RowVector3d p = cloud.positions.row(i);
        cloud.positions.row(i) << 1.6 * p.x(), p.y() * (1.0 + 0.2 * p.x()),
            p.z() * (p.z() < 0.0 ? belly : 1.0);
    }
    return cloud;
}

inline Index row_near(const Cloud& cloud, double x, double y, double z) {
    Index row;
    (cloud.positions.rowwise() - Eigen::RowVector3d(x, y, z))
        .rowwise()
        .squaredNorm()
        .minCoeff(&row);
    return row;
}

/// Two eggs with four features around them, the loop, one on top and one below.
inline MorphInput two_eggs(Index source_count, Index target_count) {
    MorphInput input{egg(source_count, 1.0), egg(target_count, 1.4), {}, {}, {}, {}};
    const auto mark = [&](const char* name, double x, double y, double z) {
        input.features.push_back(
            point_feature(name, row_near(input.source, x, y, z),
                          row_near(input.target, x, y, z < 0.0 ? 1.4 * z : z)));
    };
    mark("front", 1.6, 0, 0);
    mark("left", 0, 1, 0);
    mark("back", -1.6, 0, 0);
    mark("right", 0, -1, 0);
    input.loop = {"front", "left", "back", "right"};
    mark("top", 0.3, 0, 0.95);
    mark("bottom", -0.2, 0, -0.95);
    return input;
}

}  // namespace pointmorph
