// Stage `motion`: a cloud on its way along a smooth map, turning and bending instead of shrinking.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/prolongation.hpp"

namespace pointmorph {

/// A similarity that comes about gradually: at t the shape has rotated by t of the angle about
/// `center`, grown by the t-th power of the scale, and its center has gone t of the way.
struct GradualSimilarity {
    Similarity whole;
    Vector3 center;

    Similarity at(double t) const;
    /// The same way back: reversed().at(1 − t) takes the other end where at(t) takes this one.
    GradualSimilarity reversed() const;
};

/// What a shape does as a whole on its way to its images on another: the similarity that fits best,
/// whose scale is within a millionfold of what both sizes ask for. Images that nearly coincide fit
/// one of almost nothing, by which the way back would go through places far from both shapes.
GradualSimilarity whole_motion(const Positions& positions, const Positions& images,
                               const Positions& other);

/// How points go from end to end. kLinear: straight, as in the paper. kSimilarity: straight, while
/// the whole rotates and grows. kRigid: every part rotates as well, so that a raised leg swings.
enum class PathKind { kLinear, kSimilarity, kRigid };

/// Both clouds of a morph at one time.
struct Midway {
    std::vector<OrientedPoint> source, target;
    double t = -1.0;  ///< less than 0: at none yet
};

/// Points at one time as arrays.
OrientedPoints as_arrays(std::span<const OrientedPoint> points);

/// What motions of a cloud take of the cloud alone. It can be made before anyone knows where its
/// points go.
class MotionGround {
public:
    /// Normals have unit length. Throws Cancelled.
    MotionGround(const Positions& positions, const Normals& normals, PathKind path,
                 Progress& progress);
    ~MotionGround();
    MotionGround(MotionGround&&) noexcept;

    /// Lets all points follow the nodes, if there are any; once. `normals` as before.
    void follow(const Normals& normals, Progress& progress);

private:
    friend class Motion;
    struct Nodes;

    Normalization unit_;
    Positions positions_;  ///< normalized
    FloatNormals normals_;
    std::unique_ptr<Nodes> nodes_;  ///< of kRigid
};

/// Where every point of a cloud is at t between itself and its image under a smooth map. Apart
/// from the similarity, points go straight, or, on a rigid path, as rigidly as possible: a
/// thousand nodes turn by t of their own angles, their places follow from these by a Poisson
/// equation (Alexa, Cohen-Or and Levin 2000, on a deformation graph), and all points follow the
/// nodes; what is left of the map is added in proportion to t, turning with what is around it.
class Motion {
public:
    /// All #points by 3; normals have unit length. A linear path takes no notice of the similarity.
    /// Throws Cancelled.
    Motion(const Positions& positions, const Normals& normals, const Positions& images,
           const GradualSimilarity& similarity, PathKind path, Progress& progress);
    ~Motion();
    Motion(Motion&&) noexcept;

    /// What a motion is made of; refers to the arrays, and is used up.
    struct Ends {
        const Positions& positions;
        const Normals& normals;
        const Positions& images;
        GradualSimilarity similarity;
        /// Made of these positions and normals before, as far as it is.
        std::optional<MotionGround> ground = {};
    };
    /// Two motions, laid out next to each other.
    struct BothWays;
    static BothWays both_ways(Ends there, Ends back, PathKind path, Progress& progress);

    /// t from 0 to 1; normals have unit length. At the ends the positions are those given, up to
    /// rounding. May be called from several threads at once.
    OrientedPoints at(double t) const;

private:
    struct Bend;
    struct State;

    friend void find_midway(const Motion& forth, const Motion& back, double t, Midway& midway);

    /// All but what has to be found for each point.
    Motion(Ends&& ends, PathKind path, Progress& progress);
    void follow(const Normals& normals, Progress& progress);

    State state(double t) const;
    void place(const State& state, Index begin, Index end, std::span<OrientedPoint> places) const;

    MotionGround ground_;
    Positions offsets_;   ///< what is added by t = 1, before anything turns
    Positions unturned_;  ///< and after, where turns cancel; no rows where they do nowhere
    GradualSimilarity similarity_;
    std::unique_ptr<Bend> bend_;
};

struct Motion::BothWays {
    Motion there, back;
};

/// Where the source's motion has all its points at t, and the target's own at 1 − t, both at once:
/// the same bits as from `at`. `midway` keeps its memory from one time to the next.
void find_midway(const Motion& forth, const Motion& back, double t, Midway& midway);

/// Pairs at t: from the source's motion to the target's own, run backward, the one fading into the
/// other by 3t² − 2t³. Both lie on the same in-between surface, so that pairing samples with
/// samples leaves no grain, and the ends are the samples themselves. `midway` are both
/// clouds at t; spans hold three numbers a pair, or none. Normals are renormalized (where both
/// cancel, the nearer end's).
template <class Scalar>
void fade(const Midway& midway, std::span<const IndexPair> pairs, double t,
          std::span<Scalar> positions, std::span<Scalar> normals);

}  // namespace pointmorph
