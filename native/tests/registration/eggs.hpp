// Two ellipsoids with marks at the ends of their axes, for the tests of registrations.
#pragma once

#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "shapes.hpp"

namespace pointmorph {

/// An ellipsoid of about unit area with three different axes.
struct Egg {
    Positions positions;
    Normals normals;
};
inline Egg oriented_egg(Index count, unsigned seed) {
    const Positions d = shapes::sphere(count) * shapes::rotation(seed).transpose();
    const Eigen::RowVector3d axes(0.42, 0.3, 0.2);
    Egg e{d.array().rowwise() * axes.array(), d.array().rowwise() / axes.array()};
    e.normals.rowwise().normalize();
    return e;
}

struct Eggs {
    Egg source = oriented_egg(1500, 1), target = oriented_egg(1200, 2);
    std::vector<Index> source_rows, target_rows;
    std::vector<IndexPair> features;
    CoarseShape coarse_source, coarse_target;

    Eggs() {
        const CoarseShapeOptions options{600, {40, 150}, {}};
        for (Index k = 0; k < 6; ++k) {
            const Vector3 mark =
                (k % 2 ? -1.0 : 1.0) * Vector3::Unit(k / 2).cwiseProduct(Vector3(0.42, 0.3, 0.2));
            source_rows.push_back(shapes::nearest_row(source.positions, mark));
            target_rows.push_back(shapes::nearest_row(target.positions, mark));
            features.push_back({k, k});
        }
        Progress progress;
        coarse_source = coarse_shape(KdTree<3>(source.positions), source.normals, source_rows,
                                     options, progress);
        coarse_target = coarse_shape(KdTree<3>(target.positions), target.normals, target_rows,
                                     options, progress);
    }

    CoarsePair pair() const { return {coarse_source, coarse_target, features}; }
};

}  // namespace pointmorph
