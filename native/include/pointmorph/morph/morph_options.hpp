// Every setting of a morph.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "pointmorph/base/types.hpp"
#include "pointmorph/disk/alignment.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/disk/parameterization.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/frames/resampling.hpp"
#include "pointmorph/frames/stagger.hpp"
#include "pointmorph/mesh/wrapping.hpp"
#include "pointmorph/registration/components.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/sphere/spherical_alignment.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/pairing.hpp"
#include "pointmorph/surface/topology.hpp"
#include "pointmorph/surface/transfer.hpp"

namespace pointmorph {

/// kPaper: the paper's pipeline and nothing else. kAuto: the best that the library knows.
enum class Method { kAuto, kPaper };

/// The common domain of both clouds. kDisk: open patches on the unit disk. kCut: closed shapes, cut
/// in two along the loop, on two disks that are glued along their rims. kSphere: closed shapes of
/// genus 0 on the unit sphere, uncut. kNetwork: closed shapes of any genus, cut into patches by a
/// network of curves between all features, each patch on a disk of its own. With method auto, the
/// refinement starts from the map found there. kAuto: with the paper's method the disk, the cut
/// where a loop is given, or the network for several loops and for shapes with handles; with method
/// auto the product space, which takes shapes of any topology.
enum class Domain { kAuto, kDisk, kCut, kSphere, kNetwork };

/// Where one shape ends, at a border, and the other goes on: a bust and a whole figure. kLeave:
/// what only the other has grows out of the border, or shrinks into it. kStretch: the one is
/// stretched over all of the other.
enum class MissingParts { kLeave, kStretch };

/// Points of the common domain, one a row: 2 columns in the disk, 3 on the sphere (also the one
/// that two disks are glued to), 12 in the product space.
using DomainPoints = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// `option_table()` lists them for the user.
struct MorphOptions {
    Method method = Method::kAuto;
    Domain domain = Domain::kAuto;
    /// Nearest neighbors in the covariance analysis and in the search for the boundary; 8 to 64.
    Index covariance_neighbors = 16;
    BoundaryOptions boundary;
    TopologyOptions topology;
    DecompositionOptions decomposition;
    ParameterizationOptions parameterization;
    AlignmentOptions alignment;
    SphericalOptions spherical_parameterization;
    SphericalAlignmentOptions spherical_alignment;
    PairingOptions pairing;
    TransferOptions transfer;
    RefinementOptions refinement;
    ComponentOptions components;
    MissingParts missing_parts = MissingParts::kLeave;
    /// None: rigid, or straight with the paper's method.
    std::optional<PathKind> path;
    StaggerOptions stagger;
    ResamplingOptions resampling;
    WrapOptions wrapping;
    /// Threads; 0 takes all. The result doesn't depend on it.
    int threads = 0;
    /// Frames will be asked for: what paths take of both shapes alone is made while the map is
    /// found, as far as a thread has nothing else to do; for bare clouds of fewer than 300,000
    /// points together, as it takes memory. The result doesn't depend on it.
    bool expects_frames = false;

    PathKind path_kind() const {
        return path.value_or(method == Method::kPaper ? PathKind::kLinear : PathKind::kRigid);
    }
};

}  // namespace pointmorph
