#include "pointmorph/sphere/spherical_parameterization.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "sphere/sphere_embedding.hpp"
#include "sphere/sphere_start.hpp"
#include "sphere/sphere_triangulation.hpp"

namespace pointmorph {

namespace {

/// The largest component.
struct LargestPart {
    std::vector<Index> rows;   ///< of the cloud
    std::vector<Index> place;  ///< #cloud: the index of each row here; −1 outside
    Positions positions;
    Normals normals;

    explicit LargestPart(const SampledSurface& surface) {
        const ConnectedComponents components = connected_components(surface.nearest);
        const auto largest = std::ranges::max_element(components.sizes) - components.sizes.begin();
        place.assign(to_size(surface.size()), -1);
        for (Index i = 0; i < surface.size(); ++i)
            if (components.label[to_size(i)] == largest) {
                place[to_size(i)] = to_index(rows.size());
                rows.push_back(i);
            }
        positions = gather(surface.positions, rows);
        normals = gather(surface.normals, rows);
    }

    Index size() const { return to_index(rows.size()); }
};

/// Above 0 where the normals point outward.
double outwardness(const Positions& positions, const Normals& normals) {
    const Eigen::RowVector3d center = positions.colwise().mean();
    return (positions.rowwise() - center).cwiseProduct(normals).sum();
}

/// Shares of the corners in the point of a triangle that is nearest to a place (Ericson 2005).
Vector3 nearest_in_triangle(const Positions& positions, const Triangle& corners,
                            const Eigen::RowVector3d& place) {
    const Eigen::RowVector3d a = positions.row(corners[0]), b = positions.row(corners[1]),
                             c = positions.row(corners[2]);
    const Eigen::RowVector3d ab = b - a, ac = c - a;
    const auto share = [](double to, double from) {
        const double sum = to + from;
        return sum > 0.0 ? to / sum : 0.0;
    };
    const double a1 = ab.dot(place - a), a2 = ac.dot(place - a);
    if (a1 <= 0.0 && a2 <= 0.0) return {1.0, 0.0, 0.0};
    const double b1 = ab.dot(place - b), b2 = ac.dot(place - b);
    if (b1 >= 0.0 && b2 <= b1) return {0.0, 1.0, 0.0};
    const double c1 = ab.dot(place - c), c2 = ac.dot(place - c);
    if (c2 >= 0.0 && c1 <= c2) return {0.0, 0.0, 1.0};
    const double at_c = a1 * b2 - b1 * a2, at_b = c1 * a2 - a1 * c2, at_a = b1 * c2 - c1 * b2;
    if (at_c <= 0.0 && a1 >= 0.0 && b1 <= 0.0) {
        const double v = share(a1, -b1);
        return {1.0 - v, v, 0.0};
    }
    if (at_b <= 0.0 && a2 >= 0.0 && c2 <= 0.0) {
        const double w = share(a2, -c2);
        return {1.0 - w, 0.0, w};
    }
    if (at_a <= 0.0 && b2 - b1 >= 0.0 && c1 - c2 >= 0.0) {
        const double w = share(b2 - b1, c1 - c2);
        return {0.0, 1.0 - w, w};
    }
    const double sum = at_a + at_b + at_c;
    if (!(sum > 0.0)) return {1.0, 0.0, 0.0};
    return Vector3(at_a, at_b, at_c) / sum;
}

/// What lies at a place of a mesh, where `values` lie at its nodes.
Eigen::RowVector3d of_corners(const SphericalMesh& mesh, const Positions& values,
                              const PlaceInMesh& place) {
    Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
    for (Index k = 0; k < 3; ++k)
        sum += place.shares[k] * values.row(mesh.triangles[to_size(place.triangle)][to_size(k)]);
    return sum;
}

/// The triangles of a mesh, to find the one in which a point lies.
class PlacedTriangles {
public:
    explicit PlacedTriangles(const SphericalMesh& mesh)
        : mesh_(mesh), around_(to_size(mesh.size())) {
        double edges = 0.0;
        for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
            const auto& [a, b, c] = mesh.triangles[t];
            for (const Index v : {a, b, c}) around_[to_size(v)].push_back(to_index(t));
            const Eigen::RowVector3d p = mesh.positions.row(a), q = mesh.positions.row(b),
                                     r = mesh.positions.row(c);
            const Eigen::RowVector3d center = (p + q + r) / 3.0;
            const double radius =
                std::sqrt(std::max({(p - center).squaredNorm(), (q - center).squaredNorm(),
                                    (r - center).squaredNorm()}));
            balls_.push_back({(q - p).cross(r - p).normalized(), center, radius});
            edges += (q - p).squaredNorm();
        }
        penalty_ = edges / static_cast<double>(mesh.triangles.size());
    }

    /// For one point after the other. Of triangles that are equally far the first one counts.
    class Search {
    public:
        explicit Search(const PlacedTriangles& all)
            : all_(all), tried_(all.balls_.size(), -1), shares_(Vector3::Zero()) {}

        void begin(const Eigen::RowVector3d& point, const Eigen::RowVector3d& normal) {
            point_ = point;
            normal_ = normal;
            least_ = std::numeric_limits<double>::infinity();
            ++number_;
        }

        void try_around(Index node) {
            for (const Index t : all_.around_[to_size(node)])
                if (std::exchange(tried_[to_size(t)], number_) != number_) try_one(t);
        }

        PlaceInMesh found() const { return {nearest_, shares_}; }

    private:
        void try_one(Index t) {
            const Ball& ball = all_.balls_[to_size(t)];
            const double turned = all_.penalty_ * (1.0 - normal_.dot(ball.facing));
            // How near its surroundings are rules most triangles out.
            const double left = least_ - turned;
            if (left < 0.0) return;
            const double reach = ball.radius + std::sqrt(left);
            if ((point_ - ball.center).squaredNorm() > kSurely * reach * reach) return;
            const Vector3 before = shares_;
            shares_ =
                nearest_in_triangle(all_.mesh_.positions, all_.mesh_.triangles[to_size(t)], point_);
            const double cost =
                (of_corners(all_.mesh_, all_.mesh_.positions, {t, shares_}) - point_)
                    .squaredNorm() +
                turned;
            if (cost < least_ || (cost == least_ && t < nearest_)) {
                least_ = cost;
                nearest_ = t;
            } else {
                shares_ = before;
            }
        }

        static constexpr double kSurely = 1.0 + 1e-9;
        const PlacedTriangles& all_;
        std::vector<Index> tried_;  ///< the number of the point for which each was tried last
        Index number_ = 0;
        Eigen::RowVector3d point_, normal_;
        double least_ = 0.0;
        Index nearest_ = 0;
        Vector3 shares_;  ///< of the corners in the nearest
    };

private:
    struct Ball {
        Eigen::RowVector3d facing, center;
        double radius;  ///< of a ball that holds the triangle
    };
    const SphericalMesh& mesh_;
    std::vector<std::vector<Index>> around_;  ///< triangles of each node
    std::vector<Ball> balls_;
    double penalty_;  ///< what facing the other way costs, next to squared distances
};

/// Share of the area whose triangles face the other way than the points do.
double contradicting(const SphericalMesh& mesh) {
    double wrong = 0.0, all = 0.0;
    for (const auto& [a, b, c] : mesh.triangles) {
        const Eigen::RowVector3d ab = mesh.positions.row(b) - mesh.positions.row(a),
                                 ac = mesh.positions.row(c) - mesh.positions.row(a),
                                 across = ab.cross(ac);
        const double area = across.norm();
        all += area;
        if (across.dot(mesh.normals.row(a) + mesh.normals.row(b) + mesh.normals.row(c)) < 0.0)
            wrong += area;
    }
    return all > 0.0 ? wrong / all : 1.0;
}

/// Throws where the surface can't go onto the sphere as a whole.
void check_part(const LargestPart& part, const SampledSurface& surface,
                const SphericalOptions& options) {
    const Index loose = surface.size() - part.size();
    if (loose > options.largest_loose_share * surface.size())
        throw TopologyError(surface.name, "one closed surface for the sphere",
                            "several parts, the largest with " + std::to_string(part.size()) +
                                " of " + std::to_string(surface.size()) + " points",
                            "Use domain auto, or morph the parts one by one.");
    if (outwardness(part.positions, part.normals) < 0.0)
        throw TopologyError(surface.name, "normals that point outward", "normals that point inward",
                            "Recalculate them, or give none to have them estimated.");
}

/// Rows of the part that become nodes, the `required` rows of the cloud first, and which of them is
/// nearest to each row, as far as that is known.
SubsetCells chosen_nodes(const LargestPart& part, const KdTree<3>& tree,
                         std::span<const Index> required, const std::string& name, Index wanted,
                         Progress& progress) {
    std::vector<Index> kept;
    for (const Index row : required) {
        if (part.place[to_size(row)] < 0)
            throw FeatureError("features", "marks on the largest part of " + name,
                               "one on a separate part",
                               "Move or remove that mark, or use domain auto.");
        kept.push_back(part.place[to_size(row)]);
    }
    // Which nodes touch shows only where each has a few points around it.
    constexpr Index kPointsANode = 5;
    constexpr std::size_t kFewest = 32;
    const Index most = std::max<Index>(kFewest, part.size() / kPointsANode);
    SubsetCells nodes =
        poisson_disk_cells(tree, part.normals, kept, std::min(wanted, most), progress);
    const std::size_t found = nodes.subset.rows.size();
    if (found < kFewest)
        throw CloudError(name, "at least " + std::to_string(kFewest) + " different points",
                         std::to_string(found), "Sample it more densely.");
    return nodes;
}

/// For each point of the cloud the nearest node on its side of the surface; −1 outside of the part.
/// `known` are those of the part that are known, else −1.
std::vector<Index> cells_of(const LargestPart& part, std::span<const Index> known,
                            const SphericalMesh& mesh, Progress& progress) {
    const KdTree<3> nodes(mesh.positions);
    std::vector<Index> cells(part.place.size(), -1);
    parallel_for(
        part.size(), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                const Index node = known[to_size(i)];
                cells[to_size(part.rows[to_size(i)])] =
                    node >= 0 ? node
                              : nearest_on_sheet(nodes, mesh.normals, part.positions.row(i),
                                                 part.normals.row(i));
            }
        },
        0.0, 0.1);
    return cells;
}

/// The triangulation that contradicts the normals least, of those that first guesses at the sphere
/// give; the first that doesn't at all. Throws where even that one contradicts them on much of the
/// surface.
RingMesh triangulated(SphericalMesh& mesh, const CellGraph& cells, const SphericalOptions& options,
                      const std::string& name, Progress& progress) {
    std::optional<RingMesh> rings;
    double least = std::numeric_limits<double>::infinity();
    const auto try_guess = [&](const Positions& guess) {
        RingMesh candidate = hull_on_sphere(guess);
        flip_to_shape(candidate, mesh.positions, mesh.normals, progress);
        mesh.triangles = candidate.triangles();
        const double wrong = contradicting(mesh);
        if (!rings || wrong < least) {
            least = wrong;
            rings = std::move(candidate);
        }
        return least > 0.0;
    };
    each_first_sphere(cells, mesh.positions, mesh.normals, options, try_guess, progress);
    if (least > options.largest_wrong_share)
        throw TopologyError(name, "a closed surface without handles, of genus 0",
                            "one that can't be mapped onto a sphere: " +
                                std::to_string(std::lround(100.0 * least)) +
                                " % of it would be turned over",
                            "Use domain auto, for any topology; or check that the normals point "
                            "outward everywhere and that limbs don't touch.");
    mesh.triangles = rings->triangles();
    return *std::move(rings);
}

}  // namespace

SphericalMesh spherical_mesh(const SampledSurface& surface, std::span<const Index> required,
                             const SphericalOptions& options, Progress& progress,
                             const KdTree<3>* tree) {
    const LargestPart part(surface);
    check_part(part, surface, options);
    const bool is_whole = part.size() == surface.size();
    const KdTree<3> part_tree =
        tree && is_whole ? KdTree<3>(*tree, part.positions) : KdTree<3>(part.positions);
    SphericalMesh mesh;
    mesh.loose = surface.size() - part.size();
    const SubsetCells chosen =
        chosen_nodes(part, part_tree, required, surface.name, options.nodes, progress);
    for (const Index i : chosen.subset.rows) mesh.rows.push_back(part.rows[to_size(i)]);
    mesh.positions = gather(surface.positions, mesh.rows);
    mesh.normals = gather(surface.normals, mesh.rows);

    CellGraph cells = cell_graph(surface.nearest, surface.normals,
                                 cells_of(part, chosen.nearest, mesh, progress), mesh.positions);
    RingMesh rings = triangulated(mesh, cells, options, surface.name, progress);
    mesh.images = embed_on_sphere(std::move(rings), mesh.positions, progress);
    if (!mesh.images.allFinite() || turned_over(mesh.triangles, mesh.images) > 0.0)
        throw ConvergenceError(surface.name, "a sphere without folds", "triangles turned over",
                               "Sample it more densely or evenly, or use domain auto.");
    const double unit = std::sqrt(estimated_area(part_tree));
    for (double& length : cells.graph.lengths) length /= unit;
    mesh.graph = std::move(cells.graph);
    progress.report(1.0);
    return mesh;
}

struct MeshPlaces::Parts {
    const SphericalMesh& mesh;
    PlacedTriangles triangles{mesh};
    KdTree<3> tree{mesh.positions};
};

MeshPlaces::MeshPlaces(const SphericalMesh& mesh)
    : parts_(std::make_unique<const Parts>(Parts{mesh})) {}

MeshPlaces::~MeshPlaces() = default;

void MeshPlaces::find(const Positions& points, const Normals& normals, Index begin, Index end,
                      std::span<PlaceInMesh> places, Progress& progress) const {
    constexpr std::size_t kNodes = 6;  // whose triangles are tried
    const auto& [mesh, triangles, tree] = *parts_;
    parallel_for(end - begin, progress, [&](Index first, Index last) {
        std::array<Index, kNodes> near;
        std::array<double, kNodes> squared;
        PlacedTriangles::Search search(triangles);
        for (Index i = begin + first; i < begin + last; ++i) {
            const auto found = to_size(tree.nearest(points.row(i).data(), near, squared));
            const auto agrees = [&](Index v) {
                return mesh.normals.row(v).dot(normals.row(i)) > 0.0;
            };
            const bool any = std::ranges::any_of(std::span(near).first(found), agrees);
            search.begin(points.row(i), normals.row(i));
            for (const Index v : std::span(near).first(found))
                if (!any || agrees(v)) search.try_around(v);
            places[to_size(i)] = search.found();
        }
    });
}

Positions onto_sphere(const SphericalMesh& mesh, std::span<const PlaceInMesh> places) {
    Positions result(places.size(), 3);
    for (std::size_t i = 0; i < places.size(); ++i)
        result.row(static_cast<Eigen::Index>(i)) =
            of_corners(mesh, mesh.images, places[i]).normalized();
    for (Index v = 0; v < mesh.size(); ++v) result.row(mesh.rows[to_size(v)]) = mesh.images.row(v);
    return result;
}

Positions onto_sphere(const SphericalMesh& mesh, const Positions& points, const Normals& normals,
                      Progress& progress) {
    const auto count = to_index(points.rows());
    std::vector<PlaceInMesh> places(to_size(count));
    MeshPlaces(mesh).find(points, normals, 0, count, places, progress);
    return onto_sphere(mesh, places);
}

double turned_over(std::span<const Triangle> triangles, const Positions& images) {
    std::size_t wrong = 0;
    for (const auto& [a, b, c] : triangles)
        if (!(images.row(a).dot(images.row(b).cross(images.row(c))) > 0.0)) ++wrong;
    return static_cast<double>(wrong) / static_cast<double>(triangles.size());
}

}  // namespace pointmorph
