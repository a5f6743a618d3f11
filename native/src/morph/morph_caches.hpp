// What a Morph makes when it is first asked for. Not for callers of the library.
#pragma once

#include <mutex>
#include <optional>

#include "pointmorph/frames/mesh_motion.hpp"
#include "pointmorph/frames/motion.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

/// Each is guarded by the mutex above it.
struct Morph::Caches {
    std::mutex paths_mutex;
    std::optional<StraightPath<float>> single_path;
    std::optional<StraightPath<double>> double_path;
    std::optional<Motion> source_motion, target_motion;

    std::mutex wrapping_mutex;
    std::optional<Positions> wrapped;  ///< of the source's vertices, at 1
    std::optional<MeshMotion> wrapped_motion;

    std::mutex resampling_mutex;
    std::optional<Resampling> resampling;

    std::mutex quality_mutex;
    std::optional<Quality> quality;

    std::mutex mesh_quality_mutex;
    std::optional<MeshQuality> mesh_quality;
};

}  // namespace pointmorph
