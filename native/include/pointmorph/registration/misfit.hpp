// Stage `misfit`: how much two shapes had to bend for a registration, what gap is left between
// them, and where it tears them.
#pragma once

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// Means over both directions, at the nodes of a level or the edges between them. All ≥ 0; 0 is
/// perfect.
struct Misfit {
    double gap = 0.0;         ///< from images to where they were matched, in √area
    double round_trip = 0.0;  ///< from a point to where it ends up there and back, in √area
    double normals = 0.0;     ///< 1 − cosine
    double opposed = 0.0;     ///< share whose image is a back face
    double residual = 0.0;    ///< of the edges against their ends' similarities, squared, relative
    double rotation_change = 0.0;  ///< of the rotations along edges
    double scale_change = 0.0;     ///< of the logarithms of the scales along edges
    double geodesics = 0.0;        ///< change of distances along the surface, in √area
    double torn = 0.0;             ///< share of the edges whose length changes by a factor over 2

    /// A weighted geometric mean of all but `torn`; only the ratio of two of them says something.
    double energy() const;
};

/// Of a registration of the level `level`. `distances` are node_distances() of both shapes.
Misfit registration_misfit(const CoarsePair& shapes, Index level, const Registration& registration,
                           const NodeDistances& distances, const RegistrationOptions& options,
                           Progress& progress);

/// Share of the edges of both surface graphs that are torn: whose ends the last matching takes
/// further apart than `tear_stretch` times their length and `tear_gap`.
double torn_share(const CoarsePair& shapes, const Registration& registration,
                  const RegistrationOptions& options, Progress& progress);

}  // namespace pointmorph
