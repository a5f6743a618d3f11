// Stages that the package doesn't reach, for the pictures of their pages.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <numeric>
#include <utility>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/lod.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/disk/homology.hpp"
#include "pointmorph/mesh/mesh.hpp"
#include "pointmorph/mesh/mesh_samples.hpp"
#include "pointmorph/mesh/subdivision.hpp"
#include "pointmorph/mesh/vertex_images.hpp"
#include "pointmorph/registration/anchored_start.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/deformation.hpp"
#include "pointmorph/registration/extremities.hpp"
#include "pointmorph/registration/product_space.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/registration/thin_plate.hpp"
#include "pointmorph/surface/extremity_pairing.hpp"
#include "pointmorph/surface/free_loops.hpp"
#include "pointmorph/surface/geodesics.hpp"
#include "pointmorph/surface/graph_extremities.hpp"
#include "pointmorph/surface/local_triangles.hpp"
#include "pointmorph/surface/mls.hpp"
#include "pointmorph/surface/projection.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {
namespace {

namespace py = pybind11;

using Rows = std::vector<Index>;
using Lists = std::vector<Rows>;
using Pair = std::pair<Index, Index>;

Progress& silent() {
    static Progress progress;
    return progress;
}

Lists lists_of(const Neighborhoods& neighborhoods) {
    Lists lists;
    for (Index i = 0; i < neighborhoods.size(); ++i)
        lists.emplace_back(neighborhoods[i].begin(), neighborhoods[i].end());
    return lists;
}

std::vector<Pair> pairs_of(const std::vector<IndexPair>& pairs) {
    std::vector<Pair> result;
    for (const auto& [source, target] : pairs) result.emplace_back(source, target);
    return result;
}

std::vector<IndexPair> index_pairs(const std::vector<Pair>& pairs) {
    std::vector<IndexPair> result;
    for (const auto& [source, target] : pairs) result.push_back({source, target});
    return result;
}

std::vector<std::pair<Index, double>> points_of(const std::vector<Extremity>& found) {
    std::vector<std::pair<Index, double>> result;
    for (const Extremity& e : found) result.emplace_back(e.point, e.prominence);
    return result;
}

std::vector<Extremity> extremities_of(const std::vector<std::pair<Index, double>>& points) {
    std::vector<Extremity> result;
    for (const auto& [point, prominence] : points) result.push_back({point, prominence});
    return result;
}

Mesh mesh_of_faces(const Positions& positions, const Lists& faces) {
    Cloud cloud;
    cloud.positions = positions;
    for (const Rows& face : faces) {
        cloud.faces.corners.insert(cloud.faces.corners.end(), face.begin(), face.end());
        cloud.faces.offsets.push_back(static_cast<std::int64_t>(cloud.faces.corners.size()));
    }
    return make_mesh(cloud);
}

void bind_cloud(py::module_& module) {
    module.def("spatial_order", &spatial_order);
    module.def("normalized", [](const Positions& p) { return normalization(p).apply(p); });
    module.def("radius_neighbors", [](const Positions& p, double radius) {
        return lists_of(radius_neighbors(KdTree<3>(p), radius, silent()));
    });
    module.def("moved", [](const Positions& from, const Positions& to, const Positions& points) {
        return fit_similarity(from, to).apply(points);
    });
    module.def("subset", [](const Positions& p, const Normals& n, const Rows& required, Index k) {
        return poisson_disk_subset(KdTree<3>(p), n, required, k, silent()).rows;
    });
    module.def("covariance", [](const Positions& p) {
        const Neighborhoods near = nearest_neighbors(KdTree<3>(p), 16, silent());
        Covariance found = covariance_analysis(p, near, silent());
        orient_normals(p, near, found.normals, silent());
        return py::make_tuple(found.normals, found.variation);
    });
    module.def("lod", [](const Positions& p, Index size) {
        Rows rows(to_size(p.rows()));
        std::iota(rows.begin(), rows.end(), 0);
        const Lod lod = simplify(p, rows, {.max_cluster_size = size}, silent());
        return py::make_tuple(lod.cluster, lod.centroids);
    });
    module.def("estimated_area", [](const Positions& p) { return estimated_area(KdTree<3>(p)); });
}

void bind_mesh(py::module_& module) {
    module.def("mesh", [](const Positions& positions, const Lists& faces) {
        const Mesh mesh = mesh_of_faces(positions, faces);
        return py::make_tuple(mesh.unit.restore(mesh.positions), mesh.triangles, mesh.parts,
                              mesh.borders);
    });
    module.def("mesh_samples", [](const Positions& positions, const Lists& faces, Index count) {
        const Mesh mesh = mesh_of_faces(positions, faces);
        const MeshSamples samples = sample_mesh(mesh, {}, {.count = count}, silent());
        return py::make_tuple(mesh.unit.restore(samples.positions), samples.normals,
                              samples.border);
    });
    module.def("subdivided", [](const Positions& positions, const Lists& faces, double longest) {
        const Subdivision finer = subdivided(mesh_of_faces(positions, faces), {.longest = longest});
        return py::make_tuple(finer.mesh.unit.restore(finer.mesh.positions), finer.mesh.triangles);
    });
    module.def("vertex_images", [](const Positions& vertices, const Normals& vertex_normals,
                                   const Positions& samples, const Normals& sample_normals,
                                   const Positions& images, double spacing) {
        return VertexImages({vertices, vertex_normals}, {samples, sample_normals}, spacing,
                            silent())
            .positions(images, silent());
    });
}

void bind_surface(py::module_& module) {
    py::class_<SurfaceGraph>(module, "SurfaceGraph")
        .def_readonly("offsets", &SurfaceGraph::offsets)
        .def_readonly("neighbors", &SurfaceGraph::neighbors)
        .def_readonly("lengths", &SurfaceGraph::lengths);
    module.def("surface_graph", [](const Positions& p, const Normals& n, Index neighbors) {
        return surface_graph(KdTree<3>(p), n, {.neighbors = neighbors}, silent());
    });
    module.def("shortest_path", [](const SurfaceGraph& graph, Index from, Index to) {
        return cheapest_path(graph, from, to, {});
    });
    module.def("geodesic", [](const Positions& p, const Normals& n, const Rows& path) {
        const KdTree<3> tree(p);
        const Values spacing = local_spacing(p, nearest_neighbors(tree, 6, silent()));
        return geodesic(tree, n, path, spacing.mean(), silent()).points;
    });
    module.def("distances", [](const SurfaceGraph& graph, Index from) {
        GeodesicSearch search(graph);
        Values result(graph.size());
        for (const auto& [row, distance] : search.from(from)) result[row] = distance;
        return result;
    });
    module.def("graph_extremities", [](const SurfaceGraph& graph, double unit) {
        return points_of(extremities(graph, unit, {}, silent()));
    });
    py::class_<UnmarkedExtremities>(module, "UnmarkedExtremities")
        .def_readonly("rows", &UnmarkedExtremities::rows)
        .def_readonly("distances", &UnmarkedExtremities::distances);
    module.def("unmarked_extremities",
               [](const SurfaceGraph& graph, double unit, const Rows& features) {
                   return unmarked_extremities(graph, unit, distances_from(graph, unit, features),
                                               {}, silent());
               });
    module.def("paired_unmarked",
               [](const UnmarkedExtremities& source, const UnmarkedExtremities& target) {
                   const auto beside = [](Index, Index) { return 0.0; };
                   return pairs_of(paired_extremities(source, target, 0.35, beside));
               });
    module.def("loop_classes", [](const SurfaceGraph& graph) {
        const LoopClasses classes = loop_classes(graph);
        return py::make_tuple(classes.bits, classes.rank);
    });
    module.def("free_loops", [](Index vertices, const Lists& simplices) {
        Complex complex(vertices);
        for (const Rows& simplex : simplices) complex.add(simplex);
        const FreeLoops loops(complex);
        return py::make_tuple(loops.all, loops.wide, lists_of(complex.neighbors()),
                              EdgeLoops(complex).sums);
    });
    module.def("local_triangles", [](const Positions& p, const Normals& n, double reach) {
        const Neighborhoods near = nearest_neighbors(KdTree<3>(p), 16, silent());
        return local_triangles(p, n, near, local_spacing(p, near), reach, silent());
    });
    module.def("mls", [](const Positions& p, const Normals& n, const Positions& places,
                         const Normals& directions, double spacing, Index degree) {
        const KdTree<3> tree(p);
        MlsProjection project(tree, n, {.degree = degree});
        Positions feet(places.rows(), 3);
        for (Eigen::Index i = 0; i < places.rows(); ++i)
            feet.row(i) = project(places.row(i).transpose(), directions.row(i).transpose(), spacing)
                              .position.transpose();
        return feet;
    });
    module.def("projected", [](const Positions& images, const Rows& anchors, const Positions& p,
                               const Normals& n) {
        return project_onto_surface(images, anchors, KdTree<3>(p), n, silent());
    });
}

/// Some of a shape's points drawn to where they should go.
DeformedCloud drawn(const CoarseShape& shape, Index level, const Rows& points,
                    const Positions& targets) {
    constexpr double kStiffness = 1.0, kWeight = 3.0, kLargestScale = 3.0;
    constexpr int kRounds = 60, kSmoothing = 1;
    const DeformationGraph& graph = shape.levels[to_size(level)];
    std::vector<Attraction> attractions;
    for (std::size_t k = 0; k < points.size(); ++k)
        attractions.push_back({points[k], kWeight, targets.row(static_cast<Index>(k)).transpose()});
    Deformation deformation{gather(shape.positions, graph.node_rows),
                            std::vector<Matrix3>(to_size(graph.size()), Matrix3::Identity()),
                            Values::Ones(graph.size())};
    DeformationSolver solver(shape.positions, graph);
    solver.factorize(kStiffness, attractions);
    for (int round = 0; round < kRounds; ++round) {
        solver.solve(attractions, deformation);
        fit_similarities(shape.positions, graph, kSmoothing, kLargestScale, deformation);
    }
    return deformed(shape.positions, shape.normals, graph, deformation);
}

void bind_registration(py::module_& module) {
    py::class_<CoarseShape>(module, "CoarseShape")
        .def(py::init([](const Positions& p, const Normals& n, const Rows& required, Index points,
                         const Rows& nodes) {
            const CoarseShapeOptions options{.points = points, .nodes = nodes, .graph = {}};
            return coarse_shape(KdTree<3>(p), n, required, options, silent());
        }))
        .def_readonly("cloud_rows", &CoarseShape::cloud_rows)
        .def_readonly("positions", &CoarseShape::positions)
        .def_readonly("graph", &CoarseShape::graph)
        .def("nodes", [](const CoarseShape& shape,
                         Index level) { return shape.levels[to_size(level)].node_rows; })
        .def("node_graph", [](const CoarseShape& shape, Index level) {
            return node_graph(shape.positions, shape.levels[to_size(level)]);
        });
    py::class_<DeformedCloud>(module, "DeformedCloud")
        .def_readonly("positions", &DeformedCloud::positions);
    module.def("drawn", &drawn);
    module.def("prolonged", [](const CoarseShape& shape, const DeformedCloud& coarse,
                               const Positions& p, const Normals& n) {
        return Prolongation(shape, p, n, silent())(shape, coarse, p, n, silent()).positions;
    });
    module.def("anchored_start", [](const CoarseShape& source, const CoarseShape& target,
                                    const std::vector<Pair>& anchors) {
        const RegistrationStart start =
            anchored_start(source, target, node_distances(source, target), index_pairs(anchors));
        return py::make_tuple(start.source, start.target);
    });
    module.def("thin_plate", [](const Positions& from, const Positions& to, const Positions& at) {
        const ThinPlate plate(from, to);
        Positions images(at.rows(), 3);
        for (Eigen::Index i = 0; i < at.rows(); ++i) images.row(i) = plate(at.row(i));
        return images;
    });
    module.def("coarse_extremities", [](const CoarseShape& shape) {
        return points_of(extremities(shape, node_distances(shape), {}));
    });
    using Points = std::vector<std::pair<Index, double>>;
    module.def("paired_extremities", [](const CoarseShape& source, const Positions& source_images,
                                        const Points& s, const CoarseShape& target,
                                        const Positions& target_images, const Points& t) {
        const auto on_source = extremities_of(s), on_target = extremities_of(t);
        std::vector<Pair> pairs;
        for (const ExtremityPair& pair : paired_extremities({source, source_images, on_source},
                                                            {target, target_images, on_target}, {}))
            pairs.emplace_back(pair.source, pair.target);
        return pairs;
    });
    module.def("product_pairs", [](const Positions& source_images, const Positions& source,
                                   const Positions& target, const Positions& target_images) {
        const Normals n = Normals::Zero(source.rows(), 3), m = Normals::Zero(target.rows(), 3);
        const ProductPoints s = product_points({source_images, n}, {source, n}, 0.0);
        const ProductPoints t = product_points({target, m}, {target_images, m}, 0.0);
        return pairs_of(mutual_pairs<12>(s, t, {}, silent()));
    });
}

}  // namespace
}  // namespace pointmorph

PYBIND11_MODULE(inner_stages, module) {
    pointmorph::bind_cloud(module);
    pointmorph::bind_mesh(module);
    pointmorph::bind_surface(module);
    pointmorph::bind_registration(module);
}
