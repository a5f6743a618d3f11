// Quick registrations of thinned shapes, from which the search for the pose chooses. Not a part of
// the library.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <functional>
#include <numeric>
#include <optional>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/pose.hpp"
#include "pointmorph/registration/registration.hpp"
#include "registration/likeness.hpp"
#include "registration/self_motions.hpp"

namespace pointmorph {

/// A shape in full, and thinned to the nodes of the coarsest level and some points more: the same
/// deformations, at a fraction of the cost.
struct ThinnedShape {
    const CoarseShape& full;
    CoarseShape thin;                    ///< no surface graph
    std::vector<Extremity> extremities;  ///< rows of `thin`
    std::vector<Index> full_rows = {};   ///< of each row of `thin`: that of `full`
    LocalForms forms = {};               ///< of the thinned points; no rows where they don't count
    std::optional<KdTree<3>> tree =
        {};  ///< of the thinned points, where symmetry or likeness count
};

/// The node of the coarsest level next to a point, a row of `thin`.
inline Index node_at(const ThinnedShape& shape, Index row) {
    return shape.thin.levels.front().point_nodes[to_size(row)][0];
}

/// `extremities` are rows of `shape`, and among the points of the thinned one.
ThinnedShape thinned_shape(const CoarseShape& shape, std::vector<Extremity> extremities,
                           Index points, Progress& progress);

/// What the search for a pose is given.
struct PoseSearch {
    ThinnedShape source, target;
    NodeDistances distances;
    std::array<Symmetry, 2> symmetries;  ///< of the thinned shapes
    /// Coarse rows, and those of the thinned shapes as well: in both, features come first.
    std::span<const IndexPair> features;
    const PoseOptions& options;
    const RegistrationOptions& registration;
    /// Whether maps are dearer that take points to unlike ones; halfway, where images are still off
    /// the other surface, none is.
    bool counts_likeness = false;
    /// What is added to PoseOptions::as_given, as the shapes have little in common.
    double unlike = 0.0;

    bool has_symmetries() const {
        return symmetries[0].images.rows() > 0 && symmetries[1].images.rows() > 0;
    }
    /// Whether something is marked, so that what looks alike needn't be alike.
    bool has_marks() const {
        return !features.empty() || source.full.guides.size() > 0 || source.full.labels.rows() > 0;
    }
};

/// Extremities that may belong together: places in the lists of both shapes; sorted.
using ExtremityMatches = std::vector<IndexPair>;

/// Where the points of a trial start.
enum class StartPlaces : std::uint8_t {
    kAtRest,       ///< extremities are drawn together at first
    kAnchored,     ///< where extremities and features say: anchored_start(); they are let go then
    kTransported,  ///< all over the other shape: transported_start()
};

/// A pose, and extremities that belong together.
struct TrialStart {
    Similarity alignment;
    ExtremityMatches extremities;
    StartPlaces places = StartPlaces::kAtRest;
};

/// A map between the thinned shapes.
struct Trial {
    Similarity alignment;
    Registration registration;
    double energy = 0.0;  ///< with likeness in it once that counts and the trial has ended
};

/// Where a map takes the nodes that it was made on: the source's seen from the target at rest, and
/// the target's.
struct NodePlaces {
    Positions source, target;
};

template <class Map>
NodePlaces node_places(const Map& map) {
    const Registration& its = map.registration;
    return {map.alignment.inverse().apply(its.source.positions), its.target.positions};
}

/// How far two maps lie apart: the mean, or a share of the mean over the worst nodes where that is
/// more, of the distances between a node's two places; on that shape where it is more.
double difference(const NodePlaces& a, const NodePlaces& b);

/// Whether it is less: mostly told without it.
bool differ_by_less(const NodePlaces& a, const NodePlaces& b, double distinct);

template <class Map>
double difference(const Map& a, const Map& b) {
    return difference(node_places(a), node_places(b));
}

/// Maps with a larger difference() belong to another pose cluster: it isn't only some limb.
constexpr double kOtherCluster = 0.2;

/// Of maps that aren't distinct, only the first.
template <class Map>
void keep_distinct(std::vector<Map>& maps, double distinct) {
    std::vector<Map> kept;
    std::vector<NodePlaces> theirs;  // asked for often
    for (Map& map : maps) {
        NodePlaces its = node_places(map);
        if (std::ranges::any_of(theirs, [&](const NodePlaces& other) {
                return differ_by_less(its, other, distinct);
            }))
            continue;
        kept.push_back(std::move(map));
        theirs.push_back(std::move(its));
    }
    maps = std::move(kept);
}

/// Sorted trials that lay the shapes onto each other alike.
using PoseCluster = std::vector<const Trial*>;

/// The clusters of sorted trials, the best first, with the best two trials of each: that of the
/// best trial and up to `others`; none that are worse than the best of all by more than `factor`.
std::vector<PoseCluster> pose_clusters(const std::vector<Trial>& trials, double factor,
                                       Index others);

/// Of 570 maps between animals that came within 1.3 of the best one, 20 were worse halfway, and
/// none of the 420 that came within 1.15.
constexpr double kHopeless = 1.4;

/// Registers from all, side by side, and sorts what is distinct into `trials`. Of those that
/// extremities draw together, only what looks well halfway is followed to its end; of others, all
/// but what looks hopeless there, with over `hopeless` times the least energy.
void try_starts(const PoseSearch& search, const std::vector<TrialStart>& starts,
                std::vector<Trial>& trials, Progress& progress, double hopeless = kHopeless);

/// From now on likeness counts: the trials' energies grow by it, and they are sorted anew.
void count_likeness(PoseSearch& search, std::vector<Trial>& trials);

/// Of trials before likeness counts: what the least product of misfit and Candidate::unlikeness
/// will be at the finest level, about.
double least_disparity(const PoseSearch& search, const std::vector<Trial>& trials);

/// What is added to PoseOptions::as_given between shapes of this disparity.
double added_for_turning(const PoseOptions& options, double disparity);

/// From now on turning costs as much as it does between shapes of this disparity: the
/// energies of trials and of maps, the best first, change by it, and both are sorted anew.
void keep_unlike_as_given(PoseSearch& search, double disparity, std::vector<Trial>& trials,
                          std::span<Candidate> maps);

/// All of them registered for longer; what is distinct, sorted.
std::vector<Trial> relaxed(const PoseSearch& search, const std::vector<Trial>& trials,
                           Progress& progress);

/// A map that has been registered on all points, on the coarsest level's nodes.
struct RelaxedMap {
    Candidate candidate;       ///< with the nodes of the finest level where it has them
    RegistrationStart points;  ///< where it has all points
};

/// All of them on all points.
std::vector<RelaxedMap> relaxed_on_all_points(const PoseSearch& search,
                                              const std::vector<Trial>& trials, Progress& progress);

/// All of them to the finest level.
std::vector<Candidate> continued(const PoseSearch& search, const std::vector<RelaxedMap>& maps,
                                 Progress& progress);

/// Says what a map of the finest level costs.
void rate(const PoseSearch& search, Candidate& map);

/// A map of the finest level with each of the motions, and what that costs.
std::vector<Candidate> with_motions(const PoseSearch& search, const Candidate& map,
                                    std::span<const SelfMotion> motions, Progress& progress);

/// Nodes of the coarsest level that belong together: the features', then those of extremities, but
/// of none that sits on another anchor.
std::vector<IndexPair> anchors(const PoseSearch& search, const ExtremityMatches& extremities);

/// Maps whose images lie so far apart, mean over the source in √area, have nothing in common.
constexpr double kApart = 0.15;

/// A map by its images of the coarsest level's nodes, with both shapes at rest.
struct NodeImages {
    double cost;
    Positions source, target;
};

/// `source_rows`, `target_rows`: coarse rows of the nodes.
NodeImages node_images(const Candidate& map, const std::vector<Index>& source_rows,
                       const std::vector<Index>& target_rows);
std::vector<NodeImages> node_images(std::span<const Trial> trials);

/// What another map costs over what `best` does, or less, where it lays the whole shape otherwise
/// and the trials rank the two another way: of a robot whose front and back look much alike, which
/// of both costs less, and by up to a tenth, depends on the sampling.
double ratio_in_doubt(const NodeImages& best, const NodeImages& other,
                      std::span<const NodeImages> trials);

/// Does `work` as the part of the stage from `first` to `last`.
template <std::invocable Work>
auto in_part(Progress& progress, double first, double last, Work&& work) {
    const Progress::Part part(progress, first, last);
    return work();
}

/// The pose that makes a map rotate as little as it can.
Similarity implied_pose(const Positions& source, const Positions& images,
                        const Similarity& alignment);
Similarity implied_pose(const PoseSearch& search, const Trial& trial);

}  // namespace pointmorph
