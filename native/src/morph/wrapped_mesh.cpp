#include "morph/wrapped_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/mesh/subdivision.hpp"

namespace pointmorph {

namespace {

/// Many samples of a mesh, that tangent planes at them stand for it.
MeshSamples fine_samples(const Mesh& mesh, Progress& progress) {
    constexpr Index kLeast = 60000, kMost = 400000;
    const auto places = static_cast<Index>(mesh.positions.rows());
    const Index count = std::clamp(std::min(places, kMost / 3) * 3, kLeast, kMost);
    return sample_mesh(mesh, {}, {.count = count, .even = false}, progress);
}

/// Places on the mesh for points near it, in its lengths.
std::vector<SurfacePoint> places_on(const Mesh& mesh, const Positions& points, Progress& progress) {
    const TriangleTree tree(mesh.positions, mesh.triangles);
    std::vector<SurfacePoint> places(to_size(points.rows()));
    parallel_for(
        static_cast<Index>(points.rows()), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i)
                places[to_size(i)] = tree.closest(points.row(i).transpose());
        },
        0.0, 0.0, 64);
    return places;
}

/// Whether the vertices start as the target's own mesh, which is then what they end as.
bool is_same_mesh(const WrapSource& source, const WrapSide& target) {
    if (!target.mesh) return false;
    const Mesh &from = source.mesh.mesh(), &to = target.mesh->mesh();
    return from.places == to.places && from.triangles.rows() == to.triangles.rows() &&
           from.triangles == to.triangles && source.images == target.cloud.positions;
}

/// Where the places of the mesh start; those beyond the vertices' own follow the samples, too.
Positions starts(const Mesh& mesh, const WrapSource& source, const Normalization& unit,
                 Progress& progress) {
    const Positions images = unit.apply(source.images);
    Positions places(mesh.positions.rows(), 3);
    const Mesh& own = source.mesh.mesh();
    if (places.rows() > own.positions.rows()) {
        const MeshSamples& samples = source.mesh.samples();
        const double spacing = std::sqrt(own.area() / samples.size());
        const VertexImages carried({mesh.positions, mesh.place_normals},
                                   {samples.positions, samples.normals}, spacing, progress);
        places = carried.positions(unit.apply(source.sample_images), progress);
    }
    for (std::size_t v = mesh.places.size(); v-- > 0;)
        places.row(mesh.places[v]) = images.row(static_cast<Eigen::Index>(v));
    return places;
}

WrapTarget target_of(const WrapSide& target, const Normalization& unit, const Mesh& mesh,
                     Progress& progress) {
    WrapTarget onto;
    if (target.mesh) {
        const MeshSamples& coarse = target.mesh->samples();
        MeshSamples fine = fine_samples(target.mesh->mesh(), progress);
        onto.mesh = &target.mesh->mesh();
        onto.coarse = {coarse.positions, coarse.normals};
        onto.coarse_parts = coarse.parts;
        onto.fine = {std::move(fine.positions), std::move(fine.normals)};
        onto.fine_parts = std::move(fine.parts);
        onto.area = target.mesh->mesh().area();
        for (const std::vector<Index>& border : onto.mesh->borders)
            onto.borders.push_back(gather(onto.mesh->positions, border));
    } else {
        onto.coarse = {unit.apply(target.cloud.positions), target.cloud.normals};
        onto.coarse.normals.rowwise().normalize();
        onto.fine = onto.coarse;
        onto.area = estimated_area(KdTree<3>(onto.coarse.positions));
    }
    onto.on_mesh = places_on(mesh, mesh.unit.apply(target.images), progress);
    return onto;
}

}  // namespace

Positions wrapped_vertices(const WrapSource& source, const WrapSide& target,
                           std::span<const IndexPair> pinned, const WrapOptions& options,
                           Progress& progress) {
    if (is_same_mesh(source, target)) return source.images;
    const Normalization unit =
        target.mesh ? target.mesh->mesh().unit : normalization(target.cloud.positions);
    const Mesh mesh = subdivided(source.mesh.mesh(), {});
    const WrapTarget onto = target_of(target, unit, mesh, progress);
    const Positions start = starts(mesh, source, unit, progress);
    std::vector<WrapMark> marks;
    for (const IndexPair& pair : pinned) {
        const Positions at = unit.apply(target.cloud.positions.row(pair.target));
        marks.push_back({mesh.places[to_size(pair.source)], at.row(0).transpose()});
    }
    const Positions wrapped = wrap(mesh, start, onto, marks, options, progress);
    Positions result = gather(unit.restore(wrapped), mesh.places);
    for (const IndexPair& pair : pinned)
        result.row(pair.source) = target.cloud.positions.row(pair.target);
    return result;
}

}  // namespace pointmorph
