// One shape with a network of curves on it. Internal.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "pointmorph/disk/homology.hpp"
#include "pointmorph/disk/network.hpp"
#include "pointmorph/surface/geodesics.hpp"
#include "surface/coarse_cloud.hpp"

namespace pointmorph {

/// A curve that others may not cross.
class Wall {
public:
    explicit Wall(SurfaceCurve curve);
    Wall(const Wall&) = delete;
    Wall& operator=(const Wall&) = delete;

    const SurfaceCurve& curve() const noexcept { return curve_; }
    const KdTree<3>& tree() const noexcept { return tree_; }

    /// Whether the edge from p to q crosses the curve, seen along `normal`.
    bool is_crossed(const Eigen::RowVector3d& p, const Eigen::RowVector3d& q,
                    const Eigen::RowVector3d& normal) const;
    /// Whether any edge of another curve, or of this one, does.
    bool is_crossed(const SurfaceCurve& other) const;

private:
    SurfaceCurve curve_;
    KdTree<3> tree_;
    double longest_;
};

/// The space at a corner between the curve that leaves along `dart` and the next one anticlockwise;
/// −1 for all of it, where no curve leaves.
struct Sector {
    Index corner;
    Dart dart;
};

/// Coarse points from one sector to another, and which handles they go round.
struct CoarsePath {
    std::vector<Index> nodes;
    std::uint32_t bits = 0;
    double length = 0.0;  ///< in √area
};

/// What doesn't depend on the curves: the points among which they are searched, and the classes of
/// loops round handles, with larger and larger gaps in the sampling closed.
struct CoarseModel {
    CoarseCloud cloud;
    std::vector<LoopClasses> scales;

    CoarseModel(const NetworkShape& shape, const DecompositionOptions& options, Progress& progress);
};

/// Keeps references to what it is made from.
class NetworkSurface {
public:
    NetworkSurface(const NetworkShape& shape, const CoarseModel& model,
                   const DecompositionOptions& options);

    const NetworkShape& shape() const noexcept { return shape_; }
    const CoarseCloud& coarse() const noexcept { return coarse_; }
    /// Settles on the rank of one of the model's scales, before anything else is asked.
    void take_rank(Index rank);
    Index rank() const noexcept { return rank_; }

    /// Darts that leave a corner, anticlockwise.
    std::vector<Dart> darts(Index corner) const;
    std::vector<Sector> sectors(Index corner) const;

    /// Cheapest paths that cross no curve and pass no corner, from `from` to each of `to`, cheapest
    /// first: one for each class of paths round the handles, or one in all where `classes` is
    /// false.
    std::vector<std::vector<CoarsePath>> paths(const Sector& from, std::span<const Sector> to,
                                               bool classes) const;

    /// The path as a smooth curve on the cloud; none where that crosses a curve or leaves its
    /// sectors.
    std::optional<SurfaceCurve> traced(const CoarsePath& path, const Sector& from, const Sector& to,
                                       Progress& progress) const;

    void add(SurfaceCurve curve, const Sector& from, const Sector& to);

    /// The patch of each point of the cloud; `face` has the one on the left of each dart.
    /// Throws TopologyError where patches aren't closed.
    std::vector<Index> labels(std::span<const Index> face, Index patches, Progress& progress) const;

private:
    class PathSearch;
    struct Link {
        Index to;
        double length;
        std::uint32_t bits = 0;
        bool barred = false;
    };
    struct Spoke {
        Dart dart;
        double angle;
    };
    struct Opening {
        double start, width;  ///< radians
    };

    double angle(Index corner, const Eigen::RowVector3d& place) const;
    double leaving_angle(Index corner, const SurfaceCurve& curve, bool from_end) const;
    Opening opening(const Sector& sector) const;
    bool is_within(const Sector& sector, double angle, double margin) const;
    /// Links that leave a corner within a sector.
    std::vector<const Link*> links_of(const Sector& sector) const;
    /// Which face a point next to a curve lies in; none farther away.
    std::optional<Index> face_next_to(const Eigen::RowVector3d& point,
                                      const Eigen::RowVector3d& normal, double reach,
                                      std::span<const Index> face) const;

    const NetworkShape& shape_;
    const DecompositionOptions& options_;
    const CoarseModel& model_;
    const CoarseCloud& coarse_;
    Index corners_;
    Index rank_ = 0;
    std::vector<std::vector<Link>> links_;
    std::vector<char> closed_;  ///< coarse points that lie on a curve
    Values costs_;
    std::vector<std::vector<Spoke>> spokes_;  ///< of each corner, anticlockwise
    std::vector<std::array<Vector3, 2>> frames_;
    std::deque<Wall> walls_;
};

}  // namespace pointmorph
