// Stage `stagger`: which points of a morph go earlier, which later.
#pragma once

#include <functional>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/oriented_points.hpp"

namespace pointmorph {

/// What says when a point goes. kX, kY, kZ: what lies farther along the axis goes later. kNoise:
/// patches, in random order. kDelay: the delays that are given.
enum class StaggerKind { kNone, kX, kY, kZ, kNoise, kDelay };

struct StaggerOptions {
    StaggerKind kind = StaggerKind::kNone;
    /// Share of the whole time that each point takes, 0.01 to 1. 1: all go together.
    double overlap = 0.5;
    /// 0: each point goes at constant speed; 1: it starts and ends slowly.
    double falloff = 1.0;
    bool is_reversed = false;
    /// About how large patches of noise are, in diagonals of the bounding box; > 0.
    double size = 0.2;
    /// Another number gives another noise.
    Index seed = 0;
};

/// When each point goes, from 0 (first) to 1 (last), #points; no rows for kNone. `given`, #points
/// or none, are those of kDelay: 0 to 1, or it is a CloudError. Along an axis, and of noise, the
/// least is 0 and the largest 1; where all are the same, all are 0.
Values delays(const Positions& positions, const Values& given, const StaggerOptions& options);

/// t of a point with that delay, while that of the whole is `t`; all 0 to 1. With d the overlap,
/// the point goes from t = delay (1 − d) to delay (1 − d) + d. 0 at 0 and 1 at 1, exactly.
double local_time(double t, double delay, const StaggerOptions& options);

/// A way whose points needn't be at the same time: kept as places at nine times, and between these
/// the polynomial through them, which meets what turns by half a turn within a millionth.
class PointwisePath {
public:
    /// Where the points are at 0, at 1, and at a time between; normals with as many rows or none.
    PointwisePath(OrientedPoints start, OrientedPoints end,
                  const std::function<OrientedPoints(double)>& at);

    /// Each point at its own time, #points, 0 to 1; at 0 and 1 the places given, to the bit.
    /// Normals have unit length. May be called from several threads at once.
    OrientedPoints at(const Values& times) const;

private:
    std::vector<double> times_;
    std::vector<OrientedPoints> places_;
};

}  // namespace pointmorph
