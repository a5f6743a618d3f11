#include "morph/mesh_side.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "morph/words.hpp"
#include "registration/marks.hpp"

namespace pointmorph {

namespace {

/// The row with the largest weight.
Index heaviest(const Marked& region) {
    std::size_t best = 0;
    for (std::size_t i = 1; i < region.rows.size(); ++i)
        if (region.weight(i) > region.weight(best)) best = i;
    return region.rows[best];
}

}  // namespace

MeshSide::MeshSide(const Cloud& cloud, Mesh mesh, std::span<const Feature> features,
                   Marked Feature::*side, Progress& progress)
    : mesh_(std::move(mesh)),
      vertices_(to_size(mesh_.positions.rows())),
      spacing_(std::sqrt(mesh_.area() / sample_count(mesh_))) {
    for (auto v = to_index(mesh_.places.size()) - 1; v >= 0; --v)
        vertices_[to_size(mesh_.places[to_size(v)])] = v;
    find_marks(features, side);
    samples_ = sample_mesh(mesh_, kept_, {}, progress);
    carried_.emplace(PointsOfParts{mesh_.positions, mesh_.place_normals, mesh_.parts},
                     PointsOfParts{samples_.positions, samples_.normals, samples_.parts}, spacing_,
                     progress);
    kept_positions_.resize(static_cast<Eigen::Index>(kept_.size()), 3);
    for (std::size_t k = 0; k < kept_.size(); ++k)
        kept_positions_.row(static_cast<Eigen::Index>(k)) =
            cloud.positions.row(vertices_[to_size(kept_[k])]);
}

void MeshSide::find_marks(std::span<const Feature> features, Marked Feature::*side) {
    for (const Feature& feature : features) {
        const Marked& marked = feature.*side;
        std::vector<Index> rows = marked.rows;
        if (feature.kind == FeatureKind::kRegion) rows = {heaviest(marked)};
        if (feature.kind == FeatureKind::kCurve) rows = thinned(feature, marked);
        for (const Index row : rows)
            if (mesh_.parts[to_size(mesh_.places[to_size(row)])] >= 0)
                kept_.push_back(mesh_.places[to_size(row)]);
    }
    std::ranges::sort(kept_);
    kept_.erase(std::ranges::unique(kept_).begin(), kept_.end());
}

/// Ends stay, and of a closed curve at least three vertices.
std::vector<Index> MeshSide::thinned(const Feature& curve, const Marked& marked) const {
    const auto& rows = marked.rows;
    const auto at = [&](std::size_t i) {
        return mesh_.positions.row(mesh_.places[to_size(rows[i % rows.size()])]);
    };
    std::vector<double> along{0.0};
    for (std::size_t i = 1; i < rows.size() + (curve.closed ? 1 : 0); ++i)
        along.push_back(along.back() + (at(i) - at(i - 1)).norm());
    const double length = along.back(), apart = std::min(spacing_, length / 4.0);
    std::vector<Index> result{rows.front()};
    double last = 0.0;
    for (std::size_t i = 1; i < rows.size(); ++i) {
        const bool is_end = !curve.closed && i + 1 == rows.size();
        if (!is_end && (along[i] - last < apart || length - along[i] < apart)) continue;
        result.push_back(rows[i]);
        last = along[i];
    }
    return result.size() >= (curve.closed ? 3u : 2u) ? result : rows;
}

Cloud MeshSide::sampled(const Cloud& cloud) const {
    Cloud result;
    result.name = cloud.name;
    result.positions = mesh_.unit.restore(samples_.positions);
    for (std::size_t k = 0; k < kept_.size(); ++k)
        result.positions.row(samples_.kept[k]) = kept_positions_.row(static_cast<Eigen::Index>(k));
    result.normals = samples_.normals;
    return result;
}

Index MeshSide::row_of(Index vertex) const {
    const Index place = mesh_.places[to_size(vertex)];
    const auto kept = std::ranges::lower_bound(kept_, place);
    if (kept != kept_.end() && *kept == place) return samples_.kept[to_size(kept - kept_.begin())];
    // Without faces around.
    Index row = 0;
    (samples_.positions.rowwise() - mesh_.positions.row(place))
        .rowwise()
        .squaredNorm()
        .minCoeff(&row);
    return row;
}

Marked MeshSide::sampled(const Feature& feature, const Marked& marked) const {
    Marked result;
    if (feature.kind != FeatureKind::kRegion) {
        const bool is_curve = feature.kind == FeatureKind::kCurve;
        for (const Index row : is_curve ? thinned(feature, marked) : marked.rows)
            result.rows.push_back(row_of(row));
        return result;
    }
    Values weights = Values::Zero(mesh_.positions.rows());
    for (std::size_t i = 0; i < marked.rows.size(); ++i) {
        double& weight = weights[mesh_.places[to_size(marked.rows[i])]];
        weight = std::max(weight, marked.weight(i));
    }
    const Values mixed = samples_.mixed(mesh_, weights);
    const Index least = row_of(heaviest(marked));
    for (Index i = 0; i < samples_.size(); ++i) {
        const double weight = i == least ? weights.maxCoeff() : mixed[i];
        if (!(weight > 0.0)) continue;
        result.rows.push_back(i);
        result.weights.push_back(std::min(weight, 1.0));
    }
    return result;
}

Positions MeshSide::sampled(const Positions& at_vertices) const {
    return samples_.mixed(mesh_, gather(at_vertices, vertices_));
}

std::vector<Index> MeshSide::vertices_of_samples() const {
    std::vector<Index> result;
    for (Index i = 0; i < samples_.size(); ++i) {
        Eigen::Index corner = 0;
        samples_.weights.row(i).maxCoeff(&corner);
        const Index f = samples_.triangles[to_size(i)];
        result.push_back(vertices_[to_size(mesh_.triangles(f, corner))]);
    }
    return result;
}

std::vector<Index> MeshSide::samples_of_vertices() const {
    const std::vector<Index> of_places = carried_->nearest();
    std::vector<Index> result;
    for (const Index place : mesh_.places) result.push_back(of_places[to_size(place)]);
    return result;
}

Positions MeshSide::images(const Positions& of_samples, Progress& progress) const {
    return gather(carried_->positions(of_samples, progress), mesh_.places);
}

SampleValues MeshSide::values(const SampleValues& of_samples, Progress& progress) const {
    return gather(carried_->values(of_samples, progress), mesh_.places);
}

void MeshSide::reverse_against(const Normals& normals, Normals& given) const {
    const auto part_of = [&](Index v) { return mesh_.parts[to_size(mesh_.places[to_size(v)])]; };
    Values sums = Values::Zero(mesh_.part_areas.size());
    for (Index v = 0; v < given.rows(); ++v)
        if (part_of(v) >= 0) sums[part_of(v)] += given.row(v).normalized().dot(normals.row(v));
    for (Index v = 0; v < given.rows(); ++v)
        if (part_of(v) >= 0 && sums[part_of(v)] < 0.0) given.row(v) = -given.row(v);
}

Cloud MeshSide::completed(Cloud cloud) const {
    constexpr double kLeastForPoints = 100.0;  // vertices of a mesh whose points fill its surface
    const Normals normals = gather(mesh_.place_normals, mesh_.places);
    if (cloud.normals.rows() == 0)
        cloud.normals = normals;
    else if (mesh_.parts_turned > 0)
        reverse_against(normals, cloud.normals);
    if (cloud.radii.rows() > 0) return cloud;

    Values areas = Values::Zero(mesh_.positions.rows());
    for (Index f = 0; f < mesh_.triangles.rows(); ++f)
        for (Index k = 0; k < 3; ++k) areas[mesh_.triangles(f, k)] += mesh_.areas[f] / 3.0;
    const double mean = mesh_.area() / static_cast<double>(mesh_.positions.rows());
    // No point can stand for the large faces around it: eight balls don't make a cube.
    const double most = mesh_.area() / kLeastForPoints;
    cloud.radii.resize(cloud.positions.rows());
    for (Index v = 0; v < cloud.size(); ++v) {
        const double area = areas[mesh_.places[to_size(v)]];
        cloud.radii[v] = mesh_.unit.scale * std::sqrt(std::min(area > 0.0 ? area : mean, most));
    }
    return cloud;
}

bool is_sampled(const Cloud& cloud, const MorphOptions& options) {
    return options.method == Method::kAuto && cloud.faces.size() > 0;
}

std::optional<MeshSide> mesh_side(const Cloud& cloud, std::span<const Feature> features,
                                  Marked Feature::*side, const MorphOptions& options,
                                  Progress& progress) {
    if (!is_sampled(cloud, options)) return {};
    Mesh mesh = make_mesh(cloud, progress);
    if (mesh.triangles.rows() == 0) return {};
    return MeshSide(cloud, std::move(mesh), features, side, progress);
}

MeshSides mesh_sides(const MorphInput& input, const MorphOptions& options, Progress& progress) {
    MeshSides sides;
    if (!is_sampled(input.source, options) && !is_sampled(input.target, options)) return sides;
    progress.enter("samples");
    {
        const Progress::Part part(progress, 0.0, 0.5);
        sides.source = mesh_side(input.source, input.features, &Feature::source, options, progress);
    }
    const Progress::Part part(progress, 0.5, 1.0);
    sides.target = mesh_side(input.target, input.features, &Feature::target, options, progress);
    return sides;
}

MorphInput sampled_input(const MorphInput& input, const MeshSides& sides) {
    MorphInput result{.source = sides.source ? sides.source->sampled(input.source) : input.source,
                      .target = sides.target ? sides.target->sampled(input.target) : input.target,
                      .features = input.features,
                      .loop = input.loop,
                      .source_boundary = input.source_boundary,
                      .target_boundary = input.target_boundary,
                      .start = input.start,
                      .source_parts = input.source_parts,
                      .target_parts = input.target_parts,
                      .source_counts = input.source_counts,
                      .target_counts = input.target_counts,
                      .more_loops = input.more_loops};
    for (Feature& feature : result.features) {
        if (sides.source) feature.source = sides.source->sampled(feature, feature.source);
        if (sides.target) feature.target = sides.target->sampled(feature, feature.target);
    }
    const auto take = [](const MeshSide& side, BoundaryLoop& boundary, Parts& parts,
                         std::vector<PartCounts>& counts, Positions& start) {
        boundary = side.samples().border;
        parts = side.samples().parts;
        counts = count_parts(side.mesh());
        if (start.rows() > 0) start = side.sampled(start);
    };
    if (sides.source)
        take(*sides.source, result.source_boundary, result.source_parts, result.source_counts,
             result.start.source_images);
    if (sides.target)
        take(*sides.target, result.target_boundary, result.target_parts, result.target_counts,
             result.start.target_images);
    return result;
}

BoundaryLoop rows_along(std::span<const Index> vertices_of_samples, const BoundaryLoop& boundary) {
    BoundaryLoop rows;
    for (const Index sample : boundary) {
        const Index vertex = vertices_of_samples[to_size(sample)];
        if (std::ranges::find(rows, vertex) == rows.end()) rows.push_back(vertex);
    }
    return rows;
}

Pairing pairs_in_domain(const ProductView& points, std::span<const Feature> features,
                        std::span<const IndexPair> pinned, Progress& progress) {
    return pairs_within_regions(
        {points.source, hard_region_members(features, &Feature::source, points.source.rows())},
        {points.target, hard_region_members(features, &Feature::target, points.target.rows())},
        pinned, progress);
}

std::vector<std::string> turned_faces(const MorphInput& input, const MeshSides& sides) {
    std::vector<std::string> warnings;
    const auto add = [&](const std::optional<MeshSide>& side, const Cloud& cloud) {
        if (!side || side->mesh().parts_turned == 0) return;
        warnings.push_back(faces_were_reversed(
            cloud.name, side->mesh().parts_turned < to_index(side->mesh().part_areas.size())));
    };
    add(sides.source, input.source);
    add(sides.target, input.target);
    return warnings;
}

}  // namespace pointmorph
