#include "morph/wrapped_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/mesh/subdivision.hpp"
#include "pointmorph/surface/boundary.hpp"

namespace pointmorph {

namespace {

/// Many samples of a mesh, that tangent planes at them stand for it.
MeshSamples fine_samples(const Mesh& mesh, Progress& progress) {
    constexpr Index kLeast = 60000, kMost = 200000;
    const auto places = to_index(mesh.positions.rows());
    const Index count = std::clamp(std::min(places, kMost / 3) * 3, kLeast, kMost);
    return sample_mesh(mesh, {}, {.count = count, .even = false}, progress);
}

/// Places on the mesh for points near it, in its lengths.
std::vector<SurfacePoint> places_on(const Mesh& mesh, const Positions& points, Progress& progress) {
    const TriangleTree tree(mesh.positions, mesh.triangles, progress);
    std::vector<SurfacePoint> places(to_size(points.rows()));
    parallel_for(
        to_index(points.rows()), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i)
                places[to_size(i)] = tree.closest(points.row(i).transpose());
        },
        0.0, 0.0, 64);
    return places;
}

/// The parts of the places of a mesh, whose first places are those of `own`, by the numbers there.
std::vector<Index> parts_as_in(const Mesh& own, const Mesh& mesh) {
    std::vector<Index> number(to_size(mesh.part_areas.size()), -1);
    for (std::size_t p = 0; p < own.parts.size(); ++p)
        if (mesh.parts[p] >= 0) number[to_size(mesh.parts[p])] = own.parts[p];
    std::vector<Index> parts;
    for (const Index part : mesh.parts) parts.push_back(part >= 0 ? number[to_size(part)] : -1);
    return parts;
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
        places = carried_positions({mesh.positions, mesh.place_normals, parts_as_in(own, mesh)},
                                   {samples.positions, samples.normals, samples.parts},
                                   unit.apply(source.sample_images), spacing, progress);
    }
    for (std::size_t v = mesh.places.size(); v-- > 0;)
        places.row(mesh.places[v]) = images.row(static_cast<Eigen::Index>(v));
    return places;
}

/// Takes the places of what lies beyond the mesh: of those `points` that are at its border.
void leave_beyond(const Mesh& mesh, const Positions& points, double spacing,
                  std::vector<SurfacePoint>& places) {
    constexpr double kMostSteps = 1000.0;  // along an edge
    std::vector<Eigen::RowVector3d> along;
    for (const std::vector<Index>& border : mesh.borders)
        for (std::size_t k = 0; k < border.size(); ++k) {
            const Eigen::RowVector3d from = mesh.positions.row(border[k]),
                                     to = mesh.positions.row(border[(k + 1) % border.size()]);
            const auto steps = static_cast<Index>(
                std::clamp(std::round((to - from).norm() / spacing), 1.0, kMostSteps));
            for (Index step = 0; step < steps; ++step)
                along.emplace_back(from + static_cast<double>(step) / steps * (to - from));
        }
    Positions border(static_cast<Eigen::Index>(along.size()), 3);
    for (std::size_t k = 0; k < along.size(); ++k)
        border.row(static_cast<Eigen::Index>(k)) = along[k];
    const KdTree<3> tree(border);
    for (std::size_t i = 0; i < places.size(); ++i)
        if (tree.any_within(points.row(static_cast<Eigen::Index>(i)).data(), spacing))
            places[i].triangle = -1;
}

/// But for where its samples lie on the mesh.
WrapTarget target_of(const WrapSide& target, const Normalization& unit, Progress& progress) {
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
    return onto;
}

/// The largest of the vertices at each place.
Values at_places(const Values& of_vertices, const Mesh& mesh, Index places) {
    Values result = Values::Zero(of_vertices.rows() > 0 ? places : 0);
    for (Eigen::Index v = 0; v < of_vertices.rows(); ++v) {
        double& value = result[mesh.places[to_size(v)]];
        value = std::max(value, of_vertices[v]);
    }
    return result;
}

WrapHolds holds_of(const WrapSource& source, std::span<const EdgeEnds> ends,
                   const Normalization& unit, std::span<const WrapMark> marks) {
    const Mesh& own = source.mesh.mesh();
    const auto places = to_index(own.positions.rows());
    WrapHolds holds{.marks = marks};
    const auto at_all = [&](const Values& of_vertices) {
        const Values values = at_places(of_vertices, own, places);
        return values.rows() > 0 ? extended(values, ends) : values;
    };
    holds.rigid = at_all(source.holds.rigid);
    holds.fixed = at_all(source.holds.fixed);
    if (holds.fixed.rows() > 0)
        holds.places = unit.apply(own.unit.restore(extended(own.positions, ends)));
    return holds;
}

}  // namespace

bool is_same_mesh(const WrapSource& source, const WrapSide& target) {
    if (!target.mesh) return false;
    const Mesh &from = source.mesh.mesh(), &to = target.mesh->mesh();
    return from.places == to.places && from.triangles.rows() == to.triangles.rows() &&
           from.triangles == to.triangles && source.images == target.cloud.positions;
}

WrapOnto::WrapOnto(const WrapSource& source, const WrapSide& target,
                   std::span<const IndexPair> pinned, Progress& progress)
    : source_(source),
      other_(target),
      pinned_(pinned),
      unit_(target.mesh ? target.mesh->mesh().unit : normalization(target.cloud.positions)),
      target_(target_of(target, unit_, progress)) {}

Positions WrapOnto::wrapped(const Mesh& mesh, std::span<const EdgeEnds> ends,
                            const WrapOptions& options, Progress& progress) {
    constexpr double kStarts = 0.05;  // of the time
    const Positions back = mesh.unit.apply(other_.images);
    Positions start;
    {
        const Progress::Part part(progress, 0.0, kStarts);
        target_.on_mesh = places_on(mesh, back, progress);
        start = starts(mesh, source_, unit_, progress);
    }
    if (source_.leaves_missing && other_.mesh &&
        goes_on(border_length(source_.mesh.mesh()), border_length(other_.mesh->mesh())))
        leave_beyond(mesh, back,
                     std::sqrt(source_.mesh.mesh().area() / source_.mesh.samples().size()),
                     target_.on_mesh);
    std::vector<WrapMark> marks;
    for (const IndexPair& pair : pinned_) {
        const Positions at = unit_.apply(other_.cloud.positions.row(pair.target));
        marks.push_back({mesh.places[to_size(pair.source)], at.row(0).transpose()});
    }
    WrapOptions wrapping = options;
    // Places that were added aren't seen, and the shape's own have to be on the target.
    const auto own = mesh.positions.rows() - static_cast<Eigen::Index>(ends.size());
    wrapping.keep_uncreased = static_cast<Eigen::Index>(ends.size()) < own;
    const Progress::Part part(progress, kStarts, 1.0);
    return wrap(mesh, std::move(start), target_, holds_of(source_, ends, unit_, marks), wrapping,
                progress);
}

Positions WrapOnto::restored(const Positions& vertices) const {
    Positions result = unit_.restore(vertices);
    for (Eigen::Index v = 0; v < source_.holds.fixed.rows(); ++v)
        if (source_.holds.fixed[v] == 1.0) result.row(v) = source_.cloud.positions.row(v);
    for (const IndexPair& pair : pinned_)
        result.row(pair.source) = other_.cloud.positions.row(pair.target);
    return result;
}

Positions wrapped_vertices(const WrapSource& source, const WrapSide& target,
                           std::span<const IndexPair> pinned, const WrapOptions& options,
                           Progress& progress) {
    if (is_same_mesh(source, target)) return source.images;
    constexpr double kSamples = 0.1;  // of the time
    std::optional<WrapOnto> made;
    {
        const Progress::Part part(progress, 0.0, kSamples);
        made.emplace(source, target, pinned, progress);
    }
    WrapOnto& onto = *made;
    const Progress::Part part(progress, kSamples, 1.0);
    const Mesh& mesh = source.mesh.mesh();
    Positions places;
    if (has_long_edges(mesh, {})) {
        const Subdivision divided = subdivided(mesh, {});
        places = onto.wrapped(divided.mesh, divided.ends, options, progress);
    } else {
        places = onto.wrapped(mesh, {}, options, progress);
    }
    return onto.restored(gather(places, mesh.places));
}

}  // namespace pointmorph
