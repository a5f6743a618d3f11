// What a Morph makes when it is first asked for. Not for callers of the library.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

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
    /// What motions take of a shape alone, made of these normals before the map was there.
    struct Ground {
        Normals normals;
        std::optional<MotionGround> ground;

        /// Leaves nothing here. Null where there is none, or of normals other than `now`.
        std::optional<MotionGround> taken(const Normals& now);
    };
    Ground source_ground, target_ground;
    std::optional<PointwisePath> pointwise;

    /// Where both clouds were at the latest times: as many as were asked for at once. They keep
    /// their memory, which the system takes longer to give than a frame takes.
    std::mutex midways_mutex;
    std::vector<std::unique_ptr<Midway>> midways;
    class LentMidway;

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

inline std::optional<MotionGround> Morph::Caches::Ground::taken(const Normals& now) {
    const bool same = normals.rows() == now.rows() && normals == now;
    std::optional<MotionGround> its(std::move(ground));
    ground.reset();
    normals.resize(0, 3);
    if (!same) its.reset();
    return its;
}

/// Takes both clouds at a time out of the caches, and gives them back at the end of the scope.
class Morph::Caches::LentMidway {
public:
    /// The paths are laid out.
    LentMidway(Caches& caches, double t) : caches_(caches) {
        {
            const std::scoped_lock lock(caches.midways_mutex);
            auto& all = caches.midways;
            auto it = std::ranges::find_if(all, [&](const auto& one) { return one->t == t; });
            if (it == all.end() && !all.empty()) --it;
            if (it != all.end()) {
                midway_ = std::move(*it);
                all.erase(it);
            }
        }
        if (!midway_) midway_ = std::make_unique<Midway>();
        if (midway_->t != t) find_midway(*caches.source_motion, *caches.target_motion, t, *midway_);
    }
    ~LentMidway() {
        const std::scoped_lock lock(caches_.midways_mutex);
        caches_.midways.push_back(std::move(midway_));
    }
    LentMidway(const LentMidway&) = delete;
    LentMidway& operator=(const LentMidway&) = delete;

    const Midway& operator*() const { return *midway_; }

private:
    Caches& caches_;
    std::unique_ptr<Midway> midway_;
};

}  // namespace pointmorph
