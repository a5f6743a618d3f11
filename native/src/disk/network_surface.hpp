// One shape with a network of curves on it; not for callers of the library.
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

    /// Whether the way from p to q, seen along `normal`, crosses the curve; touching isn't
    /// crossing.
    bool is_crossed(const Eigen::RowVector3d& p, const Eigen::RowVector3d& q,
                    const Eigen::RowVector3d& normal) const;
    /// Whether any part of another curve, or of this one, does.
    bool is_crossed(const SurfaceCurve& other) const;

private:
    SurfaceCurve curve_;
    KdTree<3> tree_;
    double longest_;
};

/// The space at a corner from the curve that leaves along `dart` on, anticlockwise, to the next
/// one; −1 for all of it where there is none.
struct Sector {
    Index corner;
    Dart dart;
};

/// Coarse points from one sector to another, and which handles they go round.
struct Way {
    std::vector<Index> nodes;
    std::uint32_t bits = 0;
    double length = 0.0;  ///< in √area
};

/// What doesn't depend on the curves: the places among which they are searched for, and what the
/// handles may count as, with larger and larger gaps in the sampling taken for surface.
struct CoarseModel {
    CoarseCloud cloud;
    std::vector<LoopClasses> scales;

    CoarseModel(const NetworkSide& side, const DecompositionOptions& options, Progress& progress);
};

/// Keeps references to what it is made from.
class NetworkSurface {
public:
    NetworkSurface(const NetworkSide& side, const CoarseModel& model,
                   const DecompositionOptions& options);

    const NetworkSide& side() const noexcept { return side_; }
    const CoarseCloud& coarse() const noexcept { return coarse_; }
    /// Settles on the rank of one of the model's scales, before anything else is asked.
    void take_rank(Index rank);
    Index rank() const noexcept { return rank_; }

    /// Darts that leave a corner, anticlockwise.
    std::vector<Dart> darts(Index corner) const;
    std::vector<Sector> sectors(Index corner) const;

    /// The cheapest way that crosses no curve and passes no corner from `from` to each of `to`, for
    /// every class of ways: one for each where `classes` is false. Cheapest first.
    std::vector<std::vector<Way>> ways(const Sector& from, std::span<const Sector> to,
                                       bool classes) const;

    /// The way as a smooth curve on the cloud, where that crosses nothing and stays in its sectors.
    std::optional<SurfaceCurve> traced(const Way& way, const Sector& from, const Sector& to,
                                       Progress& progress) const;

    void add(SurfaceCurve curve, const Sector& from, const Sector& to);

    /// The patch that each point of the cloud lies in; `face` has that of each dart, on its left.
    /// Throws TopologyError where patches aren't closed.
    std::vector<Index> labels(std::span<const Index> face, Index patches, Progress& progress) const;

private:
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
    struct Room {
        double start, width;
    };

    double angle(Index corner, const Eigen::RowVector3d& place) const;
    double leaving_angle(Index corner, const SurfaceCurve& curve, bool from_end) const;
    Room room(const Sector& sector) const;
    bool is_within(const Sector& sector, double angle, double margin) const;
    std::vector<const Link*> doors(const Sector& sector) const;
    /// Which face a point next to a curve lies in; nothing farther off.
    std::optional<Index> face_next_to(const Eigen::RowVector3d& point,
                                      const Eigen::RowVector3d& normal, double reach,
                                      std::span<const Index> face) const;

    const NetworkSide& side_;
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
