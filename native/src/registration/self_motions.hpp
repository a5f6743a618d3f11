// Rotations that take a shape onto itself, and what they make of a map: a cube fits a ball in 24
// ways, of which one has to be tried. Not for callers of the library.
#pragma once

#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/pose.hpp"

namespace pointmorph {

/// Tells which motions take a shape onto itself, as far as its samples can tell.
class SelfMotions {
public:
    /// `probes` are rows of the shape that are looked at. Keeps references.
    SelfMotions(const CoarseShape& shape, const std::vector<Index>& probes);

    /// Whether no probe is moved farther off the shape than two spacings, and on average none out
    /// of the surface by more than a fraction of one.
    bool keep(const Similarity& motion) const;
    /// Mean distance by which the probes are moved.
    double distance(const Similarity& motion) const;

private:
    const CoarseShape& shape_;
    const std::vector<Index>& probes_;
    KdTree<3> tree_;
    double spacing_;
};

/// A motion that takes one of the shapes onto itself.
struct SelfMotion {
    Similarity motion;  ///< of the shape at rest
    bool of_source;
};

/// Poses of which none is another one followed or preceded by a motion of a shape onto itself; of
/// those that are, the one that rotates the target least.
struct DistinctPoses {
    std::vector<Similarity> poses;    ///< in the order given
    std::vector<SelfMotion> motions;  ///< those that were met; none twice
};
DistinctPoses distinct_poses(const std::vector<Similarity>& poses, const SelfMotions& source,
                             const SelfMotions& target);

/// The map that another one and a motion make: before it where it is the source's, after it where
/// it is the target's. Its misfit is that of `map`. `target` is at rest.
Candidate followed_by_motion(const Candidate& map, const CoarseShape& source,
                             const CoarseShape& target, const SelfMotion& self);

/// Images of points that are moved first, to `there` (#points by 3), and turned: those of what lies
/// next to where they come to.
DeformedCloud preceded(const DeformedCloud& images, const CoarseShape& shape,
                       const Positions& there, std::span<const Matrix3> rotations);

/// The nodes' deformation that has these images of all coarse points.
Deformation at_nodes(const DeformedCloud& images, const DeformationGraph& graph);

}  // namespace pointmorph
