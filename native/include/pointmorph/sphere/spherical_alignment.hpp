// Stage `spherical_alignment`: two shapes on the unit sphere, laid over each other so that features
// meet and as little as possible is stretched from one to the other.
#pragma once

#include <array>
#include <functional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"

namespace pointmorph {

struct SphericalAlignmentOptions {
    /// Steps at the most in which features come together.
    Index max_steps = 200;
    /// Tips without a mark (ears, a tail) that are looked for on each shape, and the steps in which
    /// those that belong together come near each other; 0 for none.
    Index extremities = 12, max_extremity_steps = 20;
    /// Rounds of evening out at the most, in which one shape's places move, then the other's.
    Index descent_rounds = 12;
    /// Of changes of area against those of angles, when it is evened out; > 0.
    double area_weight = 0.2;
    /// With fewer features than this so many rotations are compared, and the likeliest tried.
    Index features_that_fix_the_rotation = 3;
    Index rotations = 4000, finalists = 6;
};

struct SphericalAlignment {
    Index steps = 0;        ///< until the features, and the extremities, had met
    bool searched = false;  ///< the features left the rotation open
    double energy = 0.0;    ///< see `area_weight`: 2 + 2 · weight where nothing is stretched
    std::vector<IndexPair> extremities;  ///< that were brought together, places in both meshes
};

/// Work for threads that have nothing else to do.
using WorkBeside = std::vector<std::function<void(Progress&)>>;

/// Moves the images of both. `features` are places in `rows` of both; at the end they are at one
/// place to the bit, and no triangle is turned over. Throws ConvergenceError where features can't
/// meet without a fold. `beside` is done by other threads while one evens out, which it can't
/// share; it may not ask for the images.
SphericalAlignment align_on_sphere(SphericalMesh& source, SphericalMesh& target,
                                   std::span<const IndexPair> features,
                                   const SphericalAlignmentOptions& options, Progress& progress,
                                   const WorkBeside& beside = {});

/// Finds triangles of a mesh by places on the sphere.
class SphereLocator {
public:
    SphereLocator(std::span<const Triangle> triangles, const Positions& images);

    /// The same triangles elsewhere.
    void move_to(const Positions& images);

    /// `start` is a triangle near the place: the nearer, the quicker.
    PlaceInMesh find(const Vector3& place, Index start) const;

private:
    std::span<const Triangle> triangles_;
    /// Across the planes through the sides and the middle.
    std::vector<std::array<Vector3, 3>> facing_;
    std::vector<std::array<Index, 3>> across_;  ///< triangle on the other side of corner k, k + 1
};

}  // namespace pointmorph
