// What a Morph makes when it is first asked for. Not for callers of the library.
#pragma once

#include <mutex>
#include <optional>

#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/frames/mesh_motion.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/frames/stagger.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

/// Of each point, for quality and cracks.
inline constexpr Index kNeighborsToMeasure = 16;

/// A mesh of one side and its way to the other.
struct Morph::Wrapped {
    std::optional<Mesh> kept;       ///< of a morph that was found earlier
    std::optional<Positions> ends;  ///< of its vertices
    std::optional<MeshMotion> motion;
    std::optional<PointwisePath> pointwise;

    /// From an earlier morph: the mesh of a cloud and where its vertices end on the other, or no
    /// rows. Throws CloudError.
    void keep(const Cloud& cloud, const Cloud& other, Positions vertex_ends);
};

/// Each is guarded by the mutex above it.
struct Morph::Caches {
    std::mutex paths_mutex;
    std::optional<StraightPath<float>> single_path;
    std::optional<StraightPath<double>> double_path;
    std::optional<Motion> source_motion, target_motion;
    std::optional<PointwisePath> pointwise;

    std::mutex wrapping_mutex;
    Wrapped wrapped_source, wrapped_target;

    std::mutex resampling_mutex;
    std::optional<Resampling> resampling;

    /// What is near which point: as the map has found it, or made.
    std::mutex neighbors_mutex;
    std::optional<OrderedNeighbors> source_neighbors, target_neighbors;

    std::mutex quality_mutex;
    std::optional<Quality> quality;

    std::mutex local_confidence_mutex;
    std::optional<LocalConfidence> local_confidence;

    std::mutex mesh_quality_mutex;
    std::optional<MeshQuality> mesh_quality;
};

}  // namespace pointmorph
