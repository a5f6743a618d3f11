// Stage `deformation`: a cloud that bends nearly rigidly with some hundred nodes on it (embedded
// deformation, Sumner et al. 2007, with as-rigid-as-possible rotations, Sorkine and Alexa 2007).
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

constexpr int kNodesPerPoint = 6;

/// Where the entries lie of the equations that a graph's deformations are solved from, and those of
/// their lower triangular factor L of L Lᵀ. Nodes are in an order that keeps factors sparse
/// (approximate minimum degree, Amestoy et al. 1996). Four columns are a panel; of that, four rows
/// are a tile, in which one column comes after the other.
struct DeformationPattern {
    static constexpr Index kSide = 4;
    static constexpr std::size_t kTile = kSide * kSide;
    static constexpr std::size_t kProducts = kNodesPerPoint * (kNodesPerPoint + 1) / 2;

    std::vector<Index> order;  ///< row of each node

    // Values of the equations, panel by panel:
    std::vector<Index> laplacian;                      ///< place of each edge (i > j), else −1
    std::vector<Index> diagonal;                       ///< place of each node's diagonal
    std::vector<std::array<Index, kProducts>> blocks;  ///< places of each point's weights' products
    std::vector<Index> value_begins;                   ///< of each panel
    std::vector<Index> value_places;  ///< of each value, where all tiles of its panel are kept

    // Tiles of the factor that aren't empty, panel by panel, from the diagonal down:
    std::vector<Index> tile_begins;  ///< of each panel
    std::vector<Index> tile_rows;    ///< the number of rows above each, over four
    /// Those to the left of each panel's own rows: from which tile on a panel before it matters.
    struct Tiles {
        Index begin, end;
    };
    std::vector<Index> row_begins;  ///< of each panel
    std::vector<Tiles> row_tiles;

    std::size_t panels() const { return tile_begins.size() - 1; }
};

/// Nodes of a cloud, which of them each point hangs on, and which hold one another.
struct DeformationGraph {
    std::vector<Index> node_rows;  ///< of each node: the cloud's row that it sits on
    double spacing = 0.0;          ///< distance between nodes that is about the smallest there is

    /// Each point's geodesically nearest nodes, ascending by distance, and their weights, ≥ 0 and
    /// of sum 1. Where there are fewer, the rest repeats the first with weight 0.
    std::vector<std::array<Index, kNodesPerPoint>> point_nodes;
    std::vector<std::array<double, kNodesPerPoint>> point_weights;

    /// Edges between nodes, both directions; weights 1/√(degree · degree).
    std::vector<std::int64_t> edge_offsets{0};
    std::vector<Index> edge_ends;
    std::vector<double> edge_weights;

    /// Of all the above; shared by all deformations.
    std::shared_ptr<const DeformationPattern> pattern;

    Index size() const { return to_index(node_rows.size()); }
    Index points() const { return to_index(point_nodes.size()); }
};

/// `subset` becomes the nodes. Weights fall like (1 − d/(1.05 d_max))² with the geodesic distance;
/// nodes closer than 2.1 spacings along the surface are joined.
DeformationGraph deformation_graph(const SurfaceGraph& graph, const Subset& subset,
                                   Progress& progress);

/// From a graph's nodes, points and edges.
std::shared_ptr<const DeformationPattern> deformation_pattern(const DeformationGraph& graph);

/// The nodes and their edges as a graph of its own; `positions` are the cloud's.
SurfaceGraph node_graph(const Positions& positions, const DeformationGraph& nodes);

/// Where the nodes of a cloud have gone, and how their surroundings have turned and grown.
struct Deformation {
    Positions positions;             ///< #nodes by 3
    std::vector<Matrix3> rotations;  ///< #nodes, of determinant 1
    Values scales;                   ///< #nodes, > 0
};

/// Rotation and scale of every node: the similarity that best maps the edges around it onto the
/// deformed ones, from covariances that are averaged over the node graph `smoothing` times.
/// Scales stay within [1/`largest_scale`, `largest_scale`].
void fit_similarities(const Positions& positions, const DeformationGraph& graph, int smoothing,
                      double largest_scale, Deformation& deformation);

/// Points under a deformation: Σ_k w_k (x_k + s_k R_k (p − c_k)) over the point's nodes, and the
/// normals turned by the blended rotations, unit length.
struct DeformedCloud {
    Positions positions;
    Normals normals;
    std::vector<Matrix3> linear;  ///< Σ_k w_k s_k R_k: what happens right around each point
};
DeformedCloud deformed(const Positions& positions, const Normals& normals,
                       const DeformationGraph& graph, const Deformation& deformation);
/// The same without normals.
DeformedCloud deformed_places(const Positions& positions, const DeformationGraph& graph,
                              const Deformation& deformation);
/// One for each of `rows`, which index `positions` and `normals`.
DeformedCloud deformed(const Positions& positions, const Normals& normals,
                       const DeformationGraph& graph, const Deformation& deformation,
                       std::span<const Index> rows);

/// A point that should go somewhere.
struct Attraction {
    Index point;     ///< row of the cloud
    double weight;   ///< ≥ 0
    Vector3 target;  ///< where to
};

/// Solves for the nodes: least squares of κ Σ_edges w_ij |x_j − x_i − ½(s_i R_i + s_j R_j)(c_j −
/// c_i)|² + Σ_attractions weight |X(point) − target|².
class DeformationSolver {
public:
    DeformationSolver(const Positions& positions, const DeformationGraph& graph);

    /// Sets up and factorizes the matrix, which depends on points and weights alone.
    void factorize(double stiffness, std::span<const Attraction> attractions);

    /// New positions of the nodes for the present rotations and scales; the attractions and
    /// stiffness are those given to factorize().
    void solve(std::span<const Attraction> attractions, Deformation& deformation) const;

private:
    const Positions& positions_;
    const DeformationGraph& graph_;
    const DeformationPattern& pattern_;
    double stiffness_ = 0.0;
    std::vector<double> values_, factor_;  ///< of the pattern
};

}  // namespace pointmorph
