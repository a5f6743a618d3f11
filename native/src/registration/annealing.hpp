// One level of a registration: both shapes are matched and solved for in turn, while they soften.
// Not for callers of the library.
#pragma once

#include <memory>
#include <random>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/deformation.hpp"
#include "pointmorph/registration/registration.hpp"

namespace pointmorph {

/// What all rounds of a level share.
struct Annealing {
    const CoarsePair& shapes;
    Index level;
    const RegistrationLevel& schedule;
    const RegistrationOptions& options;
};

/// All rounds of a level. Points are drawn with `random`.
Registration annealed(const Annealing& annealing, const RegistrationStart& start,
                      std::mt19937_64& random, Progress& progress);

/// The same, some rounds at a time. Refers to all that it is given but the start.
class AnnealingRun {
public:
    AnnealingRun(const Annealing& annealing, const RegistrationStart& start,
                 const std::mt19937_64& random);
    ~AnnealingRun();
    AnnealingRun(const AnnealingRun&) = delete;
    AnnealingRun& operator=(const AnnealingRun&) = delete;

    int rounds() const;  ///< of the level
    /// The next rounds, or what is left of them.
    void advance(int count, Progress& progress);
    /// What it has come to.
    Registration result() const;
    const std::mt19937_64& random() const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

/// How stiff the shapes are in one round, and what counts in it.
struct AnnealingRound {
    bool is_stiff;       ///< the data hardly count
    bool draws;          ///< other points are matched than in the round before
    bool matches_all;    ///< all points are matched
    double stiffness;    ///< for each node
    int smoothing;       ///< see fit_similarities()
    double area_weight;  ///< of local areas in the matching
};
AnnealingRound annealing_round(const RegistrationLevel& schedule, int round, Index nodes);

/// `count` coarse rows: the nodes, then others drawn at random, ascending.
std::vector<Index> draw_points(const CoarseShape& shape, const DeformationGraph& graph, Index count,
                               std::mt19937_64& random);

/// 1/(1 + (d/(k · median))²) of every distance d.
std::vector<double> robust_weights(const std::vector<double>& distances, double medians);

/// Nodes where they are now, and where they were matched.
struct MatchedNodes {
    const Positions& positions;  ///< #nodes by 3
    const Positions& matches;    ///< #nodes by 3
};

/// 1 for nodes in components of at least `smallest` of all nodes, 0 for others, once the node graph
/// is cut where the matches of neighbors lie more than twice as far apart as they do themselves,
/// plus `spacing`.
std::vector<double> untorn(const DeformationGraph& graph, const MatchedNodes& nodes, double spacing,
                           double smallest);

}  // namespace pointmorph
