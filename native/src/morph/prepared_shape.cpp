#include "morph/prepared_shape.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>

#include "base/grouped.hpp"
#include "cloud/neighbor_room.hpp"
#include "cloud/stray_points.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

namespace {

PreparedShape ordered(const Cloud& cloud) {
    PreparedShape shape;
    shape.name = cloud.name;
    shape.unit = normalization(cloud.positions);
    shape.sorted_rows.resize(to_size(cloud.size()));
    auto& given_rows = shape.given_rows;
    for (const Index given : spatial_order(cloud.positions)) {
        const bool coincides = !given_rows.empty() &&
                               cloud.positions.row(given) == cloud.positions.row(given_rows.back());
        if (!coincides)
            given_rows.push_back(given);
        else
            given_rows.back() = std::min(given_rows.back(), given);
        shape.sorted_rows[to_size(given)] = shape.size() - 1;
    }
    if (shape.size() < kMinimumPoints)
        throw CloudError(
            cloud.name, "at least " + std::to_string(kMinimumPoints) + " places",
            std::to_string(cloud.size()) + " points at " + std::to_string(shape.size()) + " places",
            "Subdivide the mesh or sample the surface more densely.");
    shape.positions = shape.unit.apply(gather(cloud.positions, given_rows));
    shape.radii = cloud.radii;
    shape.normals_given = cloud.normals.rows() > 0;
    if (!shape.normals_given) return shape;

    Normals& normals = shape.normals = Normals::Zero(shape.size(), 3);
    for (Index given = 0; given < cloud.size(); ++given)
        normals.row(shape.sorted_rows[to_size(given)]) += cloud.normals.row(given).normalized();
    for (Index i = 0; i < shape.size(); ++i) {
        // Both sides of a thin part in one place: take the normal of one of them.
        constexpr double kOpposed = 1e-6;
        if (normals.row(i).norm() < kOpposed)
            normals.row(i) = cloud.normals.row(given_rows[to_size(i)]);
        normals.row(i).normalize();
    }
    return shape;
}

/// Leaves out what lies off the surface before normals and all else are found: of the cloud without
/// them, the shape is the same. The nearest of the other points stands for each.
void leave_out_scattered(PreparedShape& shape, std::span<const Index> strays,
                         const ShapeInput& input, const PreparationOptions& options,
                         Progress& progress) {
    if (strays.empty()) return;
    std::vector<char> is_stray(to_size(shape.size()), 0);
    for (const Index i : strays) is_stray[to_size(i)] = 1;
    std::vector<Index> kept, left_out;  // given rows
    for (Index given = 0; given < input.cloud.size(); ++given) {
        const Index sorted = shape.sorted_rows[to_size(given)];
        (is_stray[to_size(sorted)] ? left_out : kept).push_back(given);
    }
    Cloud rest;
    rest.name = input.cloud.name;
    rest.positions = gather(input.cloud.positions, kept);
    if (shape.normals_given) rest.normals = gather(input.cloud.normals, kept);
    PreparedShape result = ordered(rest);
    result.radii = input.cloud.radii;
    for (Index& given : result.given_rows) given = kept[to_size(given)];
    std::vector<Index> sorted_rows(to_size(input.cloud.size()));
    for (std::size_t k = 0; k < kept.size(); ++k)
        sorted_rows[to_size(kept[k])] = result.sorted_rows[k];
    const KdTree<3> tree(result.positions);
    const Positions places = result.unit.apply(gather(input.cloud.positions, left_out));
    const std::vector<Index> stand_ins = nearest_rows(tree, places);
    for (std::size_t k = 0; k < left_out.size(); ++k)
        sorted_rows[to_size(left_out[k])] = stand_ins[k];
    result.sorted_rows = std::move(sorted_rows);
    result.nearest = nearest_neighbors(tree, options.neighbors, progress);
    result.left_out = to_index(strays.size());
    shape = std::move(result);
}

void find_normals(PreparedShape& shape, Progress& progress) {
    if (shape.normals_given) return;
    {
        const Progress::Part part(progress, 0.0, 0.5);
        shape.normals = covariance_analysis(shape.positions, shape.nearest, progress).normals;
    }
    const Progress::Part part(progress, 0.5, 1.0);
    orient_normals(shape.positions, shape.nearest, shape.normals, progress);
}

void find_radii(PreparedShape& shape) {
    if (shape.radii.rows() == 0)
        shape.radii = gather(local_spacing(shape.positions, shape.nearest), shape.sorted_rows) *
                      shape.unit.scale;
}

void check_parts(const ShapeInput& input) {
    const Index count = input.cloud.size();
    if (input.parts.empty() || to_index(input.parts.size()) == count) return;
    throw CloudError(input.cloud.name, "a part for each of " + std::to_string(count) + " points",
                     std::to_string(input.parts.size()), "Give one label per point, or none.");
}

void find_loops(PreparedShape& shape, const BoundaryOptions& options, Progress& progress) {
    if (!shape.loops)
        shape.loops =
            find_boundary_loops(shape.positions, shape.normals, shape.nearest, options, progress);
}

void reverse_normals(PreparedShape& shape) {
    shape.normals = -shape.normals;
    if (shape.loops)
        for (BoundaryLoop& loop : *shape.loops) std::reverse(loop.begin(), loop.end());
}

/// Whether the largest component is closed and its normals face its inside.
bool faces_inwards(const PreparedShape& shape) {
    const auto is_in_largest = [&](Index i) { return shape.topology.labels[to_size(i)] == 0; };
    const Values spacing = local_spacing(shape.positions, shape.nearest);
    double area = 0.0, flux = 0.0;  // ∫ dA, ∫ p·n dA, which is three times the volume
    Eigen::RowVector3d middle = Eigen::RowVector3d::Zero();
    for (Index i = 0; i < shape.nearest.size(); ++i) {
        if (!is_in_largest(i)) continue;
        const double share = spacing[i] * spacing[i];
        area += share;
        middle += share * shape.positions.row(i);
    }
    if (!(area > 0.0)) return false;
    middle /= area;
    for (Index i = 0; i < shape.nearest.size(); ++i)
        if (is_in_largest(i))
            flux += spacing[i] * spacing[i] *
                    (shape.positions.row(i) - middle).dot(shape.normals.row(i));
    return faces_inside(flux / 3.0, area);
}

void make_outward(PreparedShape& shape) {
    if (!shape.normals_given || shape.topology.components.front().is_open || !faces_inwards(shape))
        return;
    reverse_normals(shape);
    shape.normals_reversed = true;
}

/// The sorted rows of those that are marked.
std::vector<Index> marked_in(const PreparedShape& shape, const ShapeInput& input) {
    return gather(shape.sorted_rows, input.marked);
}

/// Leaves out components that are too small to follow, unless they are marked, or much of the
/// shape: the nearest of the other points stands for each of theirs.
void leave_out_strays(PreparedShape& shape, const ShapeInput& input,
                      const PreparationOptions& options, Progress& progress) {
    const Topology& topology = shape.topology;
    std::vector<char> is_kept(topology.components.size(), 0);
    std::fill_n(is_kept.begin(), topology.main().size(), 1);
    for (const Index i : marked_in(shape, input)) is_kept[to_size(topology.labels[to_size(i)])] = 1;
    std::vector<Index> kept, left_out;
    for (Index i = 0; i < shape.size(); ++i)
        (is_kept[to_size(topology.labels[to_size(i)])] ? kept : left_out).push_back(i);
    const auto before = static_cast<double>(shape.left_out);
    if (left_out.empty() || before + static_cast<double>(left_out.size()) >
                                kMostStrays * (before + static_cast<double>(shape.size())))
        return;

    std::vector<Index> stand_in(to_size(shape.size()));
    for (std::size_t k = 0; k < kept.size(); ++k) stand_in[to_size(kept[k])] = to_index(k);
    const Positions all = std::exchange(shape.positions, gather(shape.positions, kept));
    shape.kept_tree.reset();
    const KdTree<3> tree(shape.positions);
    for (const Index i : left_out) {
        double squared;
        tree.nearest(all.row(i).data(), {&stand_in[to_size(i)], 1}, {&squared, 1});
    }
    shape.normals = gather(shape.normals, kept);
    std::vector<Index> given_rows, labels;
    for (const Index i : kept) {
        given_rows.push_back(shape.given_rows[to_size(i)]);
        labels.push_back(shape.topology.labels[to_size(i)]);
    }
    shape.given_rows = std::move(given_rows);
    shape.topology.labels = std::move(labels);
    for (Index& sorted : shape.sorted_rows) sorted = stand_in[to_size(sorted)];
    {
        const Progress::Part part(progress, 0.0, 0.5);
        shape.nearest = nearest_neighbors(tree, options.neighbors, progress);
    }
    const Progress::Part part(progress, 0.5, 1.0);
    shape.loops.reset();
    find_loops(shape, options.boundary, progress);
    shape.left_out += to_index(left_out.size());
}

/// Calls `work(k)` for k = 0 … count − 1, one after the other, from `first` to `last` of the stage.
void one_by_one(int count, Progress& progress, double first, double last,
                const std::function<void(std::size_t)>& work) {
    for (int k = 0; k < count; ++k) {
        const double share = (last - first) / count;
        const Progress::Part part(progress, first + k * share, first + (k + 1) * share);
        work(to_size(k));
    }
}

/// Fills in the neighborhoods, once scattered points are left out.
void find_neighborhoods(std::span<PreparedShape> shapes, std::span<const ShapeInput> inputs,
                        const PreparationOptions& options, Progress& progress) {
    const auto count = static_cast<int>(shapes.size());
    std::vector<std::optional<KdTree<3>>> trees(shapes.size());
    parallel_invoke(count, [&](int k, bool) {
        PreparedShape& shape = shapes[to_size(k)];
        trees[to_size(k)].emplace(shape.positions);
        shape.nearest = room_for_neighbors(shape.size(), options.neighbors);
    });
    one_by_one(count, progress, 0.0, 0.7, [&](std::size_t k) {
        Neighborhoods& nearest = shapes[k].nearest;
        nearest = nearest_neighbors(*trees[k], std::move(nearest), progress);
        if (options.keep_trees)
            shapes[k].kept_tree = std::make_shared<const KdTree<3>>(std::move(*trees[k]));
    });
    trees.clear();
    std::vector<std::vector<Index>> strays(shapes.size());
    {
        const Progress::Part part(progress, 0.7, 0.8);
        parallel_invoke(count, progress, [&](int number, Progress& its) {
            const std::size_t k = to_size(number);
            if (inputs[k].parts.empty())  // else faces say what is surface
                strays[k] = stray_points(shapes[k].positions, shapes[k].nearest,
                                         marked_in(shapes[k], inputs[k]), its);
        });
    }
    one_by_one(count, progress, 0.8, 1.0, [&](std::size_t k) {
        leave_out_scattered(shapes[k], strays[k], inputs[k], options, progress);
    });
}

/// All shapes next to each other, stage by stage.
std::vector<PreparedShape> prepare_all(std::span<const ShapeInput> inputs,
                                       const PreparationOptions& options, Progress& progress) {
    for (const ShapeInput& input : inputs) check_parts(input);
    const auto count = static_cast<int>(inputs.size());
    std::vector<PreparedShape> shapes(inputs.size());
    parallel_invoke(count,
                    [&](int k, bool) { shapes[to_size(k)] = ordered(inputs[to_size(k)].cloud); });

    progress.enter("neighborhoods");
    find_neighborhoods(shapes, inputs, options, progress);
    progress.enter("covariance");
    one_by_one(count, progress, 0.0, 1.0,
               [&](std::size_t k) { find_normals(shapes[k], progress); });

    progress.enter("topology");
    {
        const Progress::Part part(progress, 0.0, 0.9);
        parallel_invoke(count, progress, [&](int k, Progress& its) {
            PreparedShape& shape = shapes[to_size(k)];
            find_radii(shape);
            const ShapeInput& input = inputs[to_size(k)];
            shape = with_topology(std::move(shape), {input.parts, input.counts}, options.boundary,
                                  options.topology, its);
            if (input.parts.empty()) make_outward(shape);  // else faces say what is outside
        });
    }
    one_by_one(count, progress, 0.9, 1.0,
               [&](std::size_t k) { leave_out_strays(shapes[k], inputs[k], options, progress); });
    return shapes;
}

/// Rows of points and curves: a region may have some that lie off the surface.
std::vector<Index> marked_rows(std::span<const Feature> features, Marked Feature::*marked) {
    std::vector<Index> rows;
    for (const Feature& feature : features)
        if (feature.kind != FeatureKind::kRegion)
            rows.insert(rows.end(), (feature.*marked).rows.begin(), (feature.*marked).rows.end());
    return rows;
}

}  // namespace

PreparedShapes prepare_both(const MorphInput& input, const PreparationOptions& options,
                            Progress& progress) {
    const std::array<ShapeInput, 2> inputs{{{input.source, input.source_parts, input.source_counts,
                                             marked_rows(input.features, &Feature::source)},
                                            {input.target, input.target_parts, input.target_counts,
                                             marked_rows(input.features, &Feature::target)}}};
    std::vector<PreparedShape> shapes = prepare_all(inputs, options, progress);
    return {std::move(shapes[0]), std::move(shapes[1])};
}

PreparedShape prepare(const ShapeInput& input, const PreparationOptions& options,
                      Progress& progress) {
    return std::move(prepare_all({&input, 1}, options, progress).front());
}

PreparedShape with_topology(PreparedShape shape, const KnownParts& parts,
                            const BoundaryOptions& boundary, const TopologyOptions& options,
                            Progress& progress) {
    {
        const Progress::Part part(progress, 0.0, 0.5);
        find_loops(shape, boundary, progress);
    }
    std::vector<Index> sorted_parts;
    if (!parts.labels.empty())
        for (const Index given : shape.given_rows)
            sorted_parts.push_back(parts.labels[to_size(given)]);
    const Progress::Part part(progress, 0.5, 1.0);
    shape.topology = find_topology(shape.surface(), *shape.loops, {sorted_parts, parts.counts},
                                   options, progress);
    return shape;
}

PreparedShape with_normals_reversed(PreparedShape shape) {
    reverse_normals(shape);
    return shape;
}

Boundary find_boundary(const PreparedShape& shape, std::span<const Index> given,
                       const BoundaryOptions& options, Progress& progress) {
    if (given.empty()) {
        std::vector<BoundaryLoop> loops =
            shape.loops ? *shape.loops
                        : find_boundary_loops(shape.positions, shape.normals, shape.nearest,
                                              options, progress);
        const auto found = to_index(loops.size());
        return {loops.empty() ? BoundaryLoop{} : std::move(loops.front()), found};
    }
    const auto count = to_index(shape.sorted_rows.size());
    BoundaryLoop loop;
    for (std::size_t k = 0; k < given.size(); ++k) {
        const Index row = given[k];
        if (row < 0 || row >= count)
            throw FeatureError("boundary of " + shape.name,
                               "points 0 to " + std::to_string(count - 1),
                               "point " + std::to_string(row), "Give the boundary again.");
        const Index sorted = shape.sorted_rows[to_size(row)];
        // Points at one place are one; oriented_loop() refuses a row that is given twice.
        const bool again = std::ranges::find(given.first(k), row) != given.first(k).end();
        if (again || std::ranges::find(loop, sorted) == loop.end()) loop.push_back(sorted);
    }
    return {
        oriented_loop(shape.positions, shape.normals, shape.nearest, std::move(loop), shape.name),
        1};
}

bool is_rim(const PreparedShape& shape, const BoundaryLoop& loop) {
    return !loop.empty() &&
           is_rim(loop_length(shape.positions, loop), estimated_area(KdTree<3>(shape.positions)));
}

std::vector<Index> to_given(std::span<const Index> sorted, const PreparedShape& shape) {
    std::vector<Index> result;
    for (const Index row : sorted) result.push_back(shape.given_rows[to_size(row)]);
    return result;
}

namespace {

/// Given rows that each sorted row stands for, its own first.
Grouped<Index> represented(const PreparedShape& shape) {
    return Grouped<Index>(shape.size(), [&](auto&& take) {
        for (Index sorted = 0; sorted < shape.size(); ++sorted)
            take(sorted, shape.given_rows[to_size(sorted)]);
        for (std::size_t given = 0; given < shape.sorted_rows.size(); ++given) {
            const Index sorted = shape.sorted_rows[given];
            if (shape.given_rows[to_size(sorted)] != to_index(given)) take(sorted, to_index(given));
        }
    });
}

}  // namespace

Pairing to_given(std::span<const IndexPair> sorted, const PreparedShape& source,
                 const PreparedShape& target) {
    const Grouped<Index> from = represented(source), to = represented(target);
    std::vector<char> source_seen(to_size(source.size()), 0),
        target_seen(to_size(target.size()), 0);
    Pairing result;
    result.reserve(sorted.size());
    for (const IndexPair& pair : sorted) {
        const std::span<const Index> s = from[pair.source], t = to[pair.target];
        // All of them at the first pair, side by side: seams stay seams.
        const std::size_t sources =
            std::exchange(source_seen[to_size(pair.source)], 1) ? 1 : s.size();
        const std::size_t targets =
            std::exchange(target_seen[to_size(pair.target)], 1) ? 1 : t.size();
        for (std::size_t k = 0; k < std::max(sources, targets); ++k)
            result.push_back({s[std::min(k, sources - 1)], t[std::min(k, targets - 1)]});
    }
    std::ranges::sort(result);
    result.erase(std::ranges::unique(result).begin(), result.end());
    return result;
}

Normals completed_normals(Normals given, const PreparedShape& shape) {
    if (!shape.normals_given) return gather(shape.normals, shape.sorted_rows);
    return shape.normals_reversed ? Normals(-given) : given;
}

Cloud completed(Cloud cloud, const PreparedShape& shape) {
    cloud.radii = shape.radii;
    cloud.normals = completed_normals(std::move(cloud.normals), shape);
    return cloud;
}

}  // namespace pointmorph
