// The whole morph: the one place that knows all stages.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/disk/alignment.hpp"
#include "pointmorph/disk/decomposition.hpp"
#include "pointmorph/disk/network.hpp"
#include "pointmorph/disk/parameterization.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/frames/path.hpp"
#include "pointmorph/frames/resampling.hpp"
#include "pointmorph/measures/cracks.hpp"
#include "pointmorph/measures/quality.hpp"
#include "pointmorph/registration/components.hpp"
#include "pointmorph/registration/diagnostics.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/sphere/spherical_alignment.hpp"
#include "pointmorph/sphere/spherical_parameterization.hpp"
#include "pointmorph/surface/boundary.hpp"
#include "pointmorph/surface/features.hpp"
#include "pointmorph/surface/pairing.hpp"
#include "pointmorph/surface/topology.hpp"
#include "pointmorph/surface/transfer.hpp"

namespace pointmorph {

struct Side;

/// kPaper: the paper's pipeline and nothing else. kAuto: the best that the library knows.
enum class Method { kAuto, kPaper };

/// Where both clouds are laid over each other. kDisk: open patches on the unit disk. kCut: closed
/// shapes, cut in two along the loop, on two disks that are glued along their rims. kSphere: closed
/// shapes of genus 0 on the unit sphere, uncut. kNetwork: closed shapes of any genus, cut into
/// patches by a network of curves between all features, each on a disk of its own. With kAuto as
/// the method, the map found there is where the refinement starts. kAuto: for the paper's method
/// the disk, the cut where a loop is given, or the network for several loops and for shapes with
/// handles; for the other the product space, which asks nothing of the topology.
enum class Domain { kAuto, kDisk, kCut, kSphere, kNetwork };

/// Points of the common domain, a row each: 2 columns in the disk, 3 on the sphere, which two disks
/// are glued to as well, 12 in the product space.
using DomainPoints = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// How pairs go from end to end. kLinear: straight, as in the paper. kSimilarity: straight but for
/// the turn and growth of the whole. kRigid: every part turns as well, so that limbs swing. See
/// Motion.
enum class PathKind { kLinear, kSimilarity, kRigid };

/// Every setting of a morph; `option_table()` lists them for the user.
struct MorphOptions {
    Method method = Method::kAuto;
    Domain domain = Domain::kAuto;
    /// Nearest neighbours in the covariance analysis and in the search for the boundary; 8 to 64.
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
    PieceOptions pieces;
    PathKind path = PathKind::kLinear;
    ResamplingOptions resampling;
    /// OpenMP threads; 0 takes what the machine has. The result doesn't depend on it.
    int threads = 0;
};

/// What is to be morphed. A boundary, where one is given, is that patch's, in order, in either
/// sense.
struct MorphInput {
    Cloud source;
    Cloud target;
    std::vector<Feature> features;
    std::vector<std::string> loop;  ///< features, in order, through which closed models are cut
    BoundaryLoop source_boundary;
    BoundaryLoop target_boundary;
    /// Smooth maps of an earlier morph of these clouds, rows as given, to start from; empty for
    /// none. Only method auto uses them; see refine().
    RefinementStart start{};
    Parts source_parts{}, target_parts{};  ///< what hangs together, as faces say; empty: found
    std::vector<std::vector<std::string>> more_loops{};  ///< as `loop`, for a network of curves
};

/// A frame without cracks: as many rows as it takes. Row-major, numbers a point as in a FrameView.
template <class Scalar>
struct ResampledFrame {
    std::vector<Scalar> positions, normals, colors, radii;
    std::vector<Scalar> velocities;  ///< 3 a point, distance for t from 0 to 1 at this speed
    /// Ascending; a point keeps its own over the whole morph: the row of a pair, or #pairs + the
    /// row of Resampling::points().
    std::vector<Index> ids;
};

/// What one side's parameterization took (the paper's Table I).
struct ParameterizationReport {
    Index unknowns = 0;
    Index iterations = 0;
    double relative_residual = 0.0;
    double solve_seconds = 0.0;
    Index boundary_points = 0;
};

struct MorphReport {
    std::string method;
    std::string domain;
    Topology source_topology, target_topology;  ///< without labels
    /// The domain, and what the shapes are: "product space: closed surfaces of genus 1 and 0".
    std::string choice;
    std::vector<StageTime> stages;
    double seconds = 0.0;
    Index pairs = 0;
    /// Largest distance between hard point features in spacings of the points around them: in the
    /// disk, or of the smooth maps on the other surface. Quality::features has each one's.
    double feature_residual = 0.0;
    /// As they are by default for the paper's method. Rows as given.
    Diagnostics diagnostics;
    double alignment_rotation = 0.0;
    Index alignment_sweeps = 0;
    ParameterizationReport source_parameterization;
    ParameterizationReport target_parameterization;
    /// The loop given, or proposed where the domain is cut and none was given; see propose_loop().
    std::vector<std::string> loop;
    /// Ends of the curves of a network, in the order in which they were traced, and how many
    /// patches they part; see Network.
    std::vector<std::array<std::string, 2>> curves;
    Index patches = 0;
    /// Tips without a mark that were brought together, rows as given; see Decomposition::tips.
    Pairing tips;
    std::vector<std::string> warnings;
};

/// Computed once by the constructor; cheap to ask afterwards. All queries are const and may come
/// from several threads.
class Morph {
public:
    /// Throws the errors of all stages, and Cancelled.
    Morph(MorphInput input, const MorphOptions& options, Progress& progress);
    /// A morph that was found earlier, from what it left: both clouds with normals and radii, its
    /// pairs, and where all points land (rows as in the clouds; empty: at their partners' mean).
    /// There is no domain, and nothing to report. Throws CloudError.
    Morph(Cloud source, Cloud target, Pairing pairs, RefinementStart images,
          const MorphOptions& options);
    ~Morph();

    /// Both clouds in the order given; normals and radii are filled in where they were missing.
    const Cloud& source() const noexcept { return source_; }
    const Cloud& target() const noexcept { return target_; }

    /// Every row of both clouds is in at least one pair. Sorted, none twice.
    const Pairing& pairs() const noexcept { return pairs_; }

    /// Where both clouds lie in the common domain, rows as given.
    const DomainPoints& source_domain() const noexcept { return source_domain_; }
    const DomainPoints& target_domain() const noexcept { return target_domain_; }

    /// The boundary loops in use, anticlockwise; empty where none was needed.
    const BoundaryLoop& source_boundary() const noexcept { return source_boundary_; }
    const BoundaryLoop& target_boundary() const noexcept { return target_boundary_; }

    /// Where every source point lands on the target, #source by 3: smooth, not snapped to samples.
    Positions source_to_target(Progress& progress) const;
    Positions target_to_source(Progress& progress) const;

    /// Straight paths; laid out when first asked for. Scalar: float or double.
    template <class Scalar>
    const Path<Scalar>& path() const;

    /// The in-between cloud at t along the paths of `options().path`, a row a pair of `pairs()`; at
    /// t = 0 and t = 1 the inputs' own numbers. Colours and radii change linearly on any path. What
    /// path() says of spans and errors holds here. What bends is prepared when first asked for.
    template <class Scalar>
    void frame(double t, const FrameView<Scalar>& out) const;

    /// Which points are inserted; found when first asked for, which takes some frames' time.
    const Resampling& resampling(Progress& progress) const;

    /// frame(t) with new points where it would show cracks, which come and go with their radius;
    /// their colours and radii are those of the pairs around. Rows of pairs are frame(t)'s own,
    /// unless they are hidden (`ResamplingOptions::crowding`). Neighbouring frames may be asked for
    /// in any order.
    template <class Scalar>
    ResampledFrame<Scalar> resampled_frame(double t, Progress& progress) const;

    /// See find_cracks().
    std::vector<Cracks> cracks(std::span<const double> times, Progress& progress) const;

    /// See measure_quality(); made when first asked for.
    const Quality& quality(Progress& progress) const;

    const MorphReport& report() const noexcept { return report_; }
    const MorphOptions& options() const noexcept { return options_; }

private:
    void take(Refinement refinement, Side& source, Side& target);
    Positions through_domain(const Positions& images, const DomainPoints& from,
                             const DomainPoints& to, const Cloud& other, Progress& progress) const;
    Positions velocities(double t) const;

    MorphOptions options_;
    Cloud source_, target_;
    std::vector<Feature> features_;
    Pairing pairs_;
    DomainPoints source_domain_, target_domain_;
    Positions source_images_, target_images_;  ///< empty where the domain gives them
    BoundaryLoop source_boundary_, target_boundary_;
    MorphReport report_;

    struct Paths;
    std::unique_ptr<Paths> paths_;
    struct Resampled;
    std::unique_ptr<Resampled> resampled_;
    struct Measured;
    std::unique_ptr<Measured> measured_;
};

/// The cut that a loop makes in a closed shape, to be looked at before it is used: rows and lengths
/// as given. `loop`: rows of `cloud`, called `names`. Normals are estimated where there are none.
/// Throws what Morph throws for such a cloud and loop.
Decomposition decompose(Cloud cloud, std::span<const Index> loop,
                        std::span<const std::string> names, const MorphOptions& options,
                        Progress& progress);

/// Names of features for such a loop, in order: what domain cut takes where none is given. Rows are
/// those of the clouds. Throws FeatureError where there are fewer than three points among them, or
/// a cloud is an open patch.
std::vector<std::string> propose_loop(Cloud source, Cloud target, std::vector<Feature> features,
                                      const MorphOptions& options, Progress& progress);

/// The network that domain network cuts both shapes along, to be looked at before it is used: rows
/// and lengths as given, and the names of its corners. Throws what Morph throws.
struct NamedNetwork {
    Network network;
    std::vector<std::string> corners;
};
NamedNetwork trace_network(MorphInput input, const MorphOptions& options, Progress& progress);

extern template const Path<float>& Morph::path<float>() const;
extern template const Path<double>& Morph::path<double>() const;
extern template void Morph::frame<float>(double, const FrameView<float>&) const;
extern template void Morph::frame<double>(double, const FrameView<double>&) const;
extern template ResampledFrame<float> Morph::resampled_frame<float>(double, Progress&) const;
extern template ResampledFrame<double> Morph::resampled_frame<double>(double, Progress&) const;

}  // namespace pointmorph
