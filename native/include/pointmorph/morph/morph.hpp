// The whole morph: the one place that knows all stages.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/frames/path.hpp"
#include "pointmorph/frames/resampling.hpp"
#include "pointmorph/measures/cracks.hpp"
#include "pointmorph/measures/local_confidence.hpp"
#include "pointmorph/measures/mesh_quality.hpp"
#include "pointmorph/measures/quality.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "pointmorph/morph/denser_mesh.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/morph/morph_options.hpp"
#include "pointmorph/morph/report.hpp"
#include "pointmorph/registration/refinement.hpp"
#include "pointmorph/surface/pairing.hpp"

namespace pointmorph {

/// A frame without cracks: as many rows as it takes. Row-major, numbers a point as in a FrameView.
template <class Scalar>
struct ResampledFrame {
    std::vector<Scalar> positions, normals, colors, radii;
    std::vector<Scalar> velocities;  ///< 3 a point, distance for t from 0 to 1 at this speed
    /// Ascending; a point keeps its own over the whole morph: the row of a pair, or #pairs + the
    /// row of Resampling::points().
    std::vector<Index> ids;
};

/// What a morph leaves: its frames can be made of it again, with the same bits.
struct KeptMorph {
    Cloud source, target;  ///< with normals and radii; those of Morph::source() and target()
    Pairing pairs;
    /// Where all points go, rows as in the clouds; empty: at their partners' mean.
    RefinementStart images{};
    Values delays{};  ///< as in MorphInput
    /// Where the vertices of meshes end, wrapped(1) and wrapped_target(0); empty: no such mesh.
    Positions source_ends{}, target_ends{};
    std::optional<ResamplingPlan> resampling{};  ///< none: found when first asked for
};

struct Correspondence;
struct FoundMap;
struct MeshMorph;

/// Computed once by the constructor; cheap to ask afterward. All queries are const and may come
/// from several threads.
class Morph {
public:
    /// Throws the errors of all stages, and Cancelled.
    Morph(MorphInput input, const MorphOptions& options, Progress& progress);
    /// A morph that was found earlier, for its frames. There is no domain, and nothing to report.
    /// Throws CloudError.
    Morph(KeptMorph kept, const MorphOptions& options);
    /// Morphs in a row, at least one, as one, for its frames: each begins at the shape where the
    /// one before ends, and row i of the pairs of all is the same point. With `options.stagger`,
    /// each point goes through all of them in a time of its own. Throws CloudError.
    Morph(std::vector<std::shared_ptr<const Morph>> legs, const MorphOptions& options,
          const Values& delays);
    ~Morph();

    /// The morph of these clouds for other features, from where this one is; see LiveMorph, which
    /// is quicker where there are several. Throws what LiveMorph throws.
    Morph updated(std::vector<Feature> features, Progress& progress) const;

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

    /// Where every source point goes on the target, #source by 3: smooth, not snapped to samples.
    Positions source_to_target(Progress& progress) const;
    Positions target_to_source(Progress& progress) const;

    /// Whether the source has faces that can be wrapped.
    bool has_mesh() const noexcept;
    /// The vertices of the source at t, #source by 3, along the paths of `options().path`: at 0
    /// where they are, at 1 where they end when its faces are wrapped smoothly onto the target; see
    /// wrap(), which is done when first asked for. Throws CloudError unless has_mesh().
    Positions wrapped(double t, Progress& progress) const;
    /// The same of the target's mesh: its vertices at t, #target by 3, at 1 where they are, at 0
    /// where they end on the source.
    bool has_target_mesh() const noexcept;
    Positions wrapped_target(double t, Progress& progress) const;
    /// How far each vertex of the source's mesh, or of the target's, has gone from source to target
    /// at t, 0 to 1: t itself unless `options().stagger` says otherwise.
    Values vertex_times(bool of_source, double t) const;
    /// The mesh of the source, or of the target, with more triangles where the other shape has what
    /// it can't show, wrapped onto that; takes a few times as long as wrapped(). Throws CloudError
    /// unless there is such a mesh.
    DenserMesh denser(bool of_source, const DensityOptions& options, Progress& progress) const;

    /// Straight paths; laid out when first asked for. Scalar: float or double.
    template <class Scalar>
    const StraightPath<Scalar>& straight_path() const;

    /// The in-between cloud at t along the paths of `options().path`, a row a pair of `pairs()`; at
    /// t = 0 and t = 1 the inputs' own numbers. Colors and radii change linearly on any path. With
    /// `options().stagger`, each pair is at a time of its own: see local_time(). What
    /// straight_path() says of spans and errors holds here.
    template <class Scalar>
    void frame(double t, const FrameView<Scalar>& out) const;

    /// Where the source's points are at t, 0 to 1, on their way to source_to_target(), all at the
    /// same time; #source by 3. Takes no time where the frame at t was the latest. Throws
    /// OptionError, and CloudError for several morphs in a row.
    Positions source_at(double t, Progress& progress) const;

    /// Lays out paths that aren't straight, which the first frame does otherwise, without a word.
    void lay_out_paths(Progress& progress) const;

    /// Which points are inserted; found when first asked for, which takes some frames' time.
    const Resampling& resampling(Progress& progress) const;

    /// frame(t) with new points where it would show cracks, which come and go with their radius;
    /// their colors and radii are those of the pairs around. Rows of pairs are frame(t)'s own,
    /// unless they are hidden (`ResamplingOptions::crowding`). Neighboring frames may be asked for
    /// in any order.
    template <class Scalar>
    ResampledFrame<Scalar> resampled_frame(double t, Progress& progress) const;

    /// See find_cracks().
    std::vector<Cracks> cracks(std::span<const double> times, Progress& progress) const;

    /// See measure_quality(); made when first asked for.
    const Quality& quality(Progress& progress) const;
    /// See measure_local_confidence(), which takes quality(); made when first asked for. Throws
    /// CloudError for a morph that was restored.
    const LocalConfidence& local_confidence(Progress& progress) const;
    /// How good wrapped(1) looks; see measure_mesh_quality(). Made when first asked for. Throws
    /// CloudError unless has_mesh().
    const MeshQuality& mesh_quality(Progress& progress) const;

    const MorphReport& report() const noexcept { return report_; }
    const MorphOptions& options() const noexcept { return options_; }

private:
    friend class LiveMorph;
    /// A map that has been found already, with the shapes that it was found on.
    Morph(FoundMap found, const MorphOptions& options, Progress& progress);
    /// From scratch instead of by an update; `why` in words.
    Morph(MorphInput input, const MorphOptions& options, Progress& progress,
          const std::string& why);
    static Pairing pairs_through(const std::vector<std::shared_ptr<const Morph>>& legs);
    MorphInput input() const;  // with the maps as its start
    std::vector<std::string> warnings_of_shapes() const;
    void conclude(Progress& progress, std::chrono::steady_clock::time_point began);
    void meet_smoothly(std::span<const IndexPair> pinned);
    /// Rows of what a map is found for: those given, or samples of faces, whose vertices frames
    /// show.
    enum class FoundOn { kPoints, kSamples };
    void find_map(MorphInput input, FoundOn rows, Progress& progress);
    void make_grounds(Progress& progress);
    void take(Correspondence found);
    void carry(MorphInput input, const RefinementStart& offsets, Progress& progress);
    const OrderedNeighbors& neighbors(bool of_source, Progress& progress) const;
    const Positions& images_of(bool of_source, Positions& own, Progress& progress) const;
    Positions through_domain(const Positions& images, const DomainPoints& from,
                             const DomainPoints& to, const Cloud& other, Progress& progress) const;
    Positions velocities(double t) const;
    Values pair_times(double t) const;
    template <class Scalar>
    void frame_at(const Values& times, const FrameView<Scalar>& out) const;
    template <class Scalar>
    void chained_frame(double t, const FrameView<Scalar>& out) const;
    const PointwisePath& pointwise_path() const;
    bool has_mesh_of(bool is_source) const noexcept;
    Positions along_path(bool is_source, double share, Progress& progress) const;
    Positions staggered(bool is_source, double share, Progress& progress) const;
    struct Wrapped;
    struct WrappedSides;
    WrappedSides wrapped_sides(bool is_source) const;  // throws CloudError
    const Mesh& own_mesh(bool is_source) const;
    Positions on_the_way(bool is_source, double share, Progress& progress) const;
    template <class Scalar>
    void insert_points(ResampledFrame<Scalar>& frame, double t, Progress& progress) const;

    MorphOptions options_;
    Cloud source_, target_;
    std::vector<Feature> features_;
    Parts source_parts_, target_parts_;  ///< as they were given
    Pairing pairs_;
    Values delays_;  ///< of the source's points; empty where all go together
    std::vector<std::shared_ptr<const Morph>> legs_;  ///< empty unless it is several in a row
    DomainPoints source_domain_, target_domain_;
    Positions source_images_, target_images_;  ///< empty where the domain gives them
    BoundaryLoop source_boundary_, target_boundary_;
    MorphReport report_;
    std::size_t of_shapes_ = 0;  ///< the first warnings, which hold whatever is marked
    std::unique_ptr<const MeshMorph> meshes_;  ///< null where both clouds are bare

    struct Caches;
    std::unique_ptr<Caches> caches_;
};

extern template const StraightPath<float>& Morph::straight_path<float>() const;
extern template const StraightPath<double>& Morph::straight_path<double>() const;
extern template void Morph::frame<float>(double, const FrameView<float>&) const;
extern template void Morph::frame<double>(double, const FrameView<double>&) const;
extern template ResampledFrame<float> Morph::resampled_frame<float>(double, Progress&) const;
extern template ResampledFrame<double> Morph::resampled_frame<double>(double, Progress&) const;

}  // namespace pointmorph
