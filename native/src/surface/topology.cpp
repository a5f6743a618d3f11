#include "pointmorph/surface/topology.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <queue>
#include <utility>

#include "base/grouped.hpp"
#include "base/median.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/surface/free_loops.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kNear = 12;      // farther neighbors reach across gaps
constexpr double kGap = 5.0;           // spacings; farther points are not of one component
constexpr double kOneSheet = 0.0;      // cosine between normals
constexpr double kSteepestEdge = 0.8;  // sine of the angle between an edge and a tangent plane
constexpr Index kPointsPerCell = 8;    // so that cells are surface, not single samples
constexpr Index kFewestCells = 16;     // fewer show no handles

/// Whether two neighbors lie on the same side of the same part of the surface.
bool on_one_sheet(const Positions& positions, const Normals& normals, Index i, Index j) {
    if (normals.row(i).dot(normals.row(j)) <= kOneSheet) return false;
    const Eigen::RowVector3d edge = positions.row(j) - positions.row(i);
    const double steep = kSteepestEdge * edge.norm();
    return std::abs(edge.dot(normals.row(i))) <= steep ||
           std::abs(edge.dot(normals.row(j))) <= steep;
}

/// Labels renumbered by size, the largest first; ties by lowest row.
std::vector<Index> by_size(std::vector<Index> labels, Index count) {
    if (count == 1) return labels;
    std::vector<Index> sizes(to_size(count), 0), order(to_size(count)), rank(to_size(count));
    for (const Index label : labels) ++sizes[to_size(label)];
    std::iota(order.begin(), order.end(), 0);
    std::ranges::stable_sort(order, std::greater<>(), [&](Index c) { return sizes[to_size(c)]; });
    for (Index k = 0; k < count; ++k) rank[to_size(order[to_size(k)])] = k;
    for (Index& label : labels) label = rank[to_size(label)];
    return labels;
}

/// For each point the lowest row at the very same place, which stands for all points there.
/// `nearest` is ascending by distance.
std::vector<Index> without_twins(const Positions& positions, const Neighborhoods& nearest) {
    const Index count = to_index(positions.rows());
    std::vector<Index> first(to_size(count));
    std::iota(first.begin(), first.end(), 0);
    bool any = false;
    for (Index i = 0; i < count && !any; ++i)
        any = !nearest[i].empty() && positions.row(nearest[i].front()) == positions.row(i);
    if (!any) return first;

    std::vector<Index> order = first;
    const auto key = [&](Index i) {
        return std::array{positions(i, 0), positions(i, 1), positions(i, 2)};
    };
    std::ranges::stable_sort(order, {}, key);
    for (std::size_t k = 1; k < order.size(); ++k)
        if (key(order[k]) == key(order[k - 1]))
            first[to_size(order[k])] = first[to_size(order[k - 1])];
    return first;
}

/// Adds a few points that are connected to nothing, but lie on a component (a thin rim whose
/// normals agree with no others), to that component.
void absorb_crumbs(std::vector<Index>& labels, const Positions& positions,
                   const Neighborhoods& nearest, const Values& spacing) {
    constexpr double kBeside = 2.0;  // spacings
    std::vector<Index> sizes(to_size(1 + *std::ranges::max_element(labels)), 0);
    for (const Index label : labels) ++sizes[to_size(label)];
    std::vector<Index> into(sizes.size());
    std::iota(into.begin(), into.end(), 0);
    for (Index i = 0; i < nearest.size(); ++i) {
        const Index own = labels[to_size(i)];
        if (sizes[to_size(own)] >= kPointsPerCell || into[to_size(own)] != own) continue;
        for (const Index j : nearest[i])
            if (sizes[to_size(labels[to_size(j)])] >= kPointsPerCell &&
                (positions.row(i) - positions.row(j)).norm() < kBeside * spacing[j]) {
                into[to_size(own)] = labels[to_size(j)];
                break;
            }
    }
    // Close the gaps in the numbers, still by size.
    std::vector<Index> rank(sizes.size(), -1);
    Index count = 0;
    for (std::size_t p = 0; p < into.size(); ++p)
        if (into[p] == to_index(p)) rank[p] = count++;
    for (Index& label : labels) label = rank[to_size(into[to_size(label)])];
}

/// Counts the strays among the components, which are numbered by size, and moves them last: those
/// with few points, and scattered points unless they are many.
void move_strays_last(Topology& topology, const Values& spacing, double smallest_share) {
    constexpr double kFew = 0.02;       // a share of the points
    constexpr double kScattered = 3.0;  // times the largest component's spacing
    const auto count = static_cast<double>(topology.labels.size());
    std::vector<std::vector<double>> spacings(topology.components.size());
    for (std::size_t i = 0; i < topology.labels.size(); ++i)
        spacings[to_size(topology.labels[i])].push_back(spacing[static_cast<Eigen::Index>(i)]);
    const double usual = median(spacings.front());
    std::vector<Index> order, strays;
    for (Index p = 0; p < to_index(spacings.size()); ++p) {
        const auto points = static_cast<double>(spacings[to_size(p)].size());
        const bool is_stray =
            points < smallest_share * count || points < kPointsPerCell ||
            (points < kFew * count && median(spacings[to_size(p)]) > kScattered * usual);
        (p > 0 && is_stray ? strays : order).push_back(p);
    }
    topology.strays = to_index(strays.size());
    order.insert(order.end(), strays.begin(), strays.end());
    std::vector<Index> rank(order.size());
    std::vector<Component> components;
    for (std::size_t k = 0; k < order.size(); ++k) {
        rank[to_size(order[k])] = to_index(k);
        components.push_back(topology.components[to_size(order[k])]);
    }
    topology.components = std::move(components);
    for (Index& label : topology.labels) label = rank[to_size(label)];
}

/// The components that faces give; coincident points belong together.
std::vector<Index> joined_parts(std::span<const Index> parts, std::span<const Index> first) {
    Neighborhoods same;
    std::map<Index, Index> representative;
    for (std::size_t i = 0; i < parts.size(); ++i) {
        const Index one = representative.try_emplace(parts[i], to_index(i)).first->second;
        for (const Index other : {one, first[i]})
            if (other != to_index(i)) same.indices.push_back(other);
        same.offsets.push_back(static_cast<std::int64_t>(same.indices.size()));
    }
    ConnectedComponents components = connected_components(same);
    return by_size(std::move(components.label), components.count());
}

/// Components over neighbors on the same side of the surface.
std::vector<Index> found_parts(const SampledSurface& surface, const Values& spacing,
                               std::span<const Index> first) {
    const auto& [positions, normals, nearest, name] = surface;
    const auto has = [&](Index i, Index j) {
        return std::ranges::find(nearest[i], j) != nearest[i].end();
    };
    // Twins aside, the nearest kNear on the same side count.
    const auto counts = [&](Index i, Index j) {
        return first[to_size(j)] == j && on_one_sheet(positions, normals, i, j);
    };
    GrowingComponents joined(nearest.size());
    for (Index i = 0; i < nearest.size(); ++i) {
        if (first[to_size(i)] != i) {
            joined.join(i, first[to_size(i)]);
            continue;
        }
        const auto near = nearest[i];
        for (std::size_t k = 0; k < near.size(); ++k) {
            const Index j = near[k];
            if (joined.are_joined(i, j) || !counts(i, j)) continue;
            const auto before = near.first(k);
            if (k >= kNear && std::ranges::count_if(before, [&](Index b) {
                                  return counts(i, b);
                              }) >= static_cast<std::ptrdiff_t>(kNear))
                break;
            // A point that floats far off has neighbors, but is a neighbor of none.
            if ((positions.row(j) - positions.row(i)).norm() < kGap * spacing[j] || has(j, i))
                joined.join(i, j);
        }
    }
    ConnectedComponents components = joined.components();
    return by_size(std::move(components.label), components.count());
}

/// Rows of each component, coincident points once.
Grouped<Index> rows_of_components(const Topology& topology, std::span<const Index> first) {
    return {to_index(topology.components.size()), [&](auto&& take) {
                for (std::size_t i = 0; i < first.size(); ++i)
                    if (first[i] == to_index(i)) take(topology.labels[i], to_index(i));
            }};
}

/// Every n-th where there are more than `most`.
std::vector<Index> every_nth(std::span<const Index> rows, Index most) {
    const auto step = (rows.size() + to_size(most) - 1) / to_size(most);
    std::vector<Index> result;
    for (std::size_t k = 0; k < rows.size(); k += step) result.push_back(rows[k]);
    return result;
}

/// Points of one component, none twice, joined along the surface.
struct Sample {
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    Neighborhoods own;             ///< unless the sample is the whole cloud
    const Neighborhoods* nearest;  ///< 12 or more a point, where there are that many
    double area;
    Neighborhoods near;  ///< those of the nearest 12 on the same side of the surface
    SurfaceGraph graph;  ///< symmetric

    Sample(const SampledSurface& all, std::span<const Index> rows, Progress& progress)
        : positions(gather(all.positions, rows)),
          normals(gather(all.normals, rows)),
          tree(positions) {
        const bool whole = to_index(rows.size()) == all.size();
        if (!whole) own = nearest_neighbors(tree, to_index(kNear), progress);
        nearest = whole ? &all.nearest : &own;
        area = estimated_area(positions, *nearest);
        for (Index i = 0; i < tree.size(); ++i) {
            const auto row = (*nearest)[i];
            for (const Index j : row.first(std::min(kNear, row.size())))
                if (on_one_sheet(positions, normals, i, j)) near.indices.push_back(j);
            near.offsets.push_back(static_cast<std::int64_t>(near.indices.size()));
        }
        Neighborhoods joined = symmetrized(near);
        graph.offsets = std::move(joined.offsets);
        graph.neighbors = std::move(joined.indices);
        graph.lengths.reserve(graph.neighbors.size());
        for (Index i = 0; i < tree.size(); ++i)
            for (auto e = graph.offsets[to_size(i)]; e < graph.offsets[to_size(i) + 1]; ++e)
                graph.lengths.push_back(
                    (positions.row(i) - positions.row(graph.neighbors[to_size(e)])).norm());
    }
};

/// Cells of the surface around some of the points: each point's nearest along the surface.
std::vector<Index> cells_around(const Sample& sample, std::span<const Index> centers) {
    const SurfaceGraph& graph = sample.graph;
    std::vector<Index> cells(to_size(graph.size()), -1);
    std::vector<double> distances(cells.size(), std::numeric_limits<double>::infinity());
    using Entry = std::pair<double, Index>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
    for (std::size_t c = 0; c < centers.size(); ++c) {
        distances[to_size(centers[c])] = 0.0;
        cells[to_size(centers[c])] = to_index(c);
        queue.emplace(0.0, centers[c]);
    }
    while (!queue.empty()) {
        const auto [distance, i] = queue.top();
        queue.pop();
        if (distance > distances[to_size(i)]) continue;
        for (auto e = to_size(graph.offsets[to_size(i)]);
             e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
            const Index j = graph.neighbors[e];
            const double through = distance + graph.lengths[e];
            if (through >= distances[to_size(j)]) continue;
            distances[to_size(j)] = through;
            cells[to_size(j)] = cells[to_size(i)];
            queue.emplace(through, j);
        }
    }
    return cells;
}

/// The shortest path of cells, both ends included; empty where there is none.
std::vector<Index> cell_path(const Neighborhoods& neighbors, Index from, Index to) {
    std::vector<Index> before(to_size(neighbors.size()), -1), open{to};
    before[to_size(to)] = to;
    for (std::size_t k = 0; k < open.size() && before[to_size(from)] < 0; ++k)
        for (const Index j : neighbors[open[k]])
            if (before[to_size(j)] < 0) {
                before[to_size(j)] = open[k];
                open.push_back(j);
            }
    std::vector<Index> path;
    if (before[to_size(from)] < 0) return path;
    for (Index i = from; i != to; i = before[to_size(i)]) path.push_back(i);
    path.push_back(to);
    return path;
}

/// The complex of a component's cells: those that meet near a point span a simplex.
Complex complex_of(const Sample& sample, std::span<const Index> cells, Index count) {
    Complex complex(count);
    std::vector<Index> around, before;
    for (Index i = 0; i < sample.tree.size(); ++i) {
        around.assign(1, cells[to_size(i)]);
        for (const Index j : sample.near[i])
            if (std::ranges::find(around, cells[to_size(j)]) == around.end())
                around.push_back(cells[to_size(j)]);
        std::ranges::sort(around);
        if (around.size() == 1 || around.front() < 0 || around == before) continue;
        complex.add(around);
        before.swap(around);
    }
    return complex;
}

/// Closes each border with a lid. `borders` are rows of the sample.
void close(Complex& complex, std::span<const Index> cells,
           std::span<const std::vector<Index>> borders) {
    if (borders.empty()) return;
    const Neighborhoods neighbors = complex.neighbors();
    for (const std::vector<Index>& border : borders) {
        const Index lid = complex.add_vertex();
        for (std::size_t k = 0; k < border.size(); ++k) {
            const Index here = cells[to_size(border[k])],
                        next = cells[to_size(border[(k + 1) % border.size()])];
            if (here < 0 || next < 0) continue;
            const std::vector<Index> path = cell_path(neighbors, here, next);
            for (std::size_t m = 0; m + 1 < path.size(); ++m)
                complex.add(std::array{std::min(path[m], path[m + 1]),
                                       std::max(path[m], path[m + 1]), lid});
        }
    }
}

/// Handles of a component, two free loops each. If no loop is free among the most cells, or only an
/// odd number of short ones, there is no handle, since fewer cells can only lose some; else the
/// number on which two counts of cells agree. Gaps in the sampling add loops: then only wide loops
/// count, which thin handles lack.
std::optional<Index> genus_of(const Sample& sample, std::span<const std::vector<Index>> borders,
                              Index most, Progress& progress) {
    const Index most_cells = std::min(most, sample.tree.size() / kPointsPerCell);
    std::vector<FreeLoops> found;
    for (const double share : {1.0, 0.5, 0.7}) {
        const auto count = static_cast<Index>(share * most_cells);
        if (count < kFewestCells) return std::nullopt;
        const std::vector<Index> centers =
            poisson_disk_subset(sample.tree, sample.normals, {}, count, progress, sample.nearest)
                .rows;
        const std::vector<Index> cells = cells_around(sample, centers);
        Complex complex = complex_of(sample, cells, to_index(centers.size()));
        close(complex, cells, borders);
        found.emplace_back(complex);
        const FreeLoops& first = found.front();
        if (found.size() == 1) {
            if (first.all == 0 || (first.wide == 0 && first.all % 2 == 1)) return 0;
            continue;
        }
        if (found.size() == 2 && first.all == found[1].all && first.all % 2 == 0)
            return first.all / 2;
        for (std::size_t a = 0; a < found.size(); ++a)
            for (std::size_t b = a + 1; b < found.size(); ++b)
                if (found[a].wide == found[b].wide)
                    return found[a].wide % 2 == 0 ? std::optional(found[a].wide / 2) : std::nullopt;
        if (first.wide == 0) return 0;
    }
    return std::nullopt;
}

std::string kind_in_words(const Component& component, bool plural) {
    if (component.is_open) return plural ? "open surfaces" : "an open surface";
    if (component.borders > 0) return plural ? "surfaces" : "a surface";
    return plural ? "closed surfaces" : "a closed surface";
}

std::string counted(Index count, const char* one) {
    return std::to_string(count) + " " + one + (count == 1 ? "" : "s");
}

/// Handles, as the holes that they go around: through a ring goes one.
std::string genus_in_words(const Component& component, bool plural) {
    if (!component.genus) return "holes through " + std::string(plural ? "them" : "it");
    return counted(*component.genus, "hole") + " through " + (plural ? "each" : "it");
}

/// What isn't there, as far as "closed" or "open" doesn't say it.
std::string openings_in_words(const Component& component) {
    if (component.borders <= (component.is_open ? 1 : 0)) return "";
    return counted(component.borders, "opening");
}

/// Of each component what faces say of it: nothing where they say nothing sure, or where it has
/// points of several parts.
std::vector<const PartCounts*> counted(const Topology& topology, const KnownParts& parts) {
    std::vector<const PartCounts*> result(topology.components.size(), nullptr);
    if (parts.counts.empty()) return result;
    std::vector<Index> part(result.size(), -1);
    for (std::size_t i = 0; i < topology.labels.size(); ++i) {
        const std::size_t component = to_size(topology.labels[i]);
        const PartCounts& counts = parts.counts[to_size(parts.labels[i])];
        const bool is_first = part[component] < 0;
        if (is_first && counts.is_surface) result[component] = &counts;
        if (!is_first && part[component] != parts.labels[i]) result[component] = nullptr;
        part[component] = parts.labels[i];
    }
    return result;
}

/// What tells of components of which faces say nothing sure.
struct Sampled {
    const SampledSurface& surface;
    std::span<const BoundaryLoop> loops;
    std::span<const Index> labels;
    Index cells;

    /// Fills in component `number`, from `rows` of it.
    void look_at(Component& component, Index number, std::span<const Index> rows,
                 Progress& progress) const {
        const Sample sample(surface, rows, progress);
        std::vector<std::vector<Index>> borders;
        for (const BoundaryLoop& loop : loops) {
            if (labels[to_size(loop.front())] != number) continue;
            component.is_open |= is_rim(loop_length(surface.positions, loop), sample.area);
            std::vector<Index>& border = borders.emplace_back();
            for (const Index i : loop)
                border.push_back(nearest_on_sheet(
                    sample.tree, sample.normals, surface.positions.row(i), surface.normals.row(i)));
        }
        component.borders = to_index(borders.size());
        component.genus = genus_of(sample, borders, cells, progress);
    }
};

}  // namespace

std::string in_words(const Component& component, bool plural) {
    std::string words = kind_in_words(component, plural), openings = openings_in_words(component);
    if (!openings.empty()) words += " with " + openings;
    if (!component.genus) return words + ", perhaps with " + genus_in_words(component, plural);
    if (*component.genus > 0)
        words += (openings.empty() ? " with " : " and ") + genus_in_words(component, plural);
    return words;
}

bool is_rim(double length, double area) {
    // 4π for a flat disk, 2π for half a sphere, and less the more of a sphere is there.
    constexpr double kSquaredLengthToArea = 4.0;
    return length * length > kSquaredLengthToArea * area;
}

Topology find_topology(const SampledSurface& surface, std::span<const BoundaryLoop> loops,
                       const KnownParts& parts, const TopologyOptions& options,
                       Progress& progress) {
    const Positions& positions = surface.positions;
    const std::vector<Index> first = without_twins(positions, surface.nearest);
    const Values spacing = local_spacing(positions, surface.nearest);
    Topology result;
    result.labels = parts.labels.empty() ? found_parts(surface, spacing, first)
                                         : joined_parts(parts.labels, first);
    const auto components = [&] { return 1 + *std::ranges::max_element(result.labels); };
    if (parts.labels.empty() && components() > 1)
        absorb_crumbs(result.labels, positions, surface.nearest, spacing);
    result.components.resize(to_size(components()));
    for (const Index label : result.labels) ++result.components[to_size(label)].points;
    if (result.components.size() > 1) move_strays_last(result, spacing, options.smallest_share);

    const auto count = to_index(result.components.size());
    const std::vector<const PartCounts*> known = counted(result, parts);
    const Grouped<Index> rows = rows_of_components(result, first);
    for (Index c = 0; c < count - result.strays; ++c) {
        Component& component = result.components[to_size(c)];
        if (const PartCounts* counts = known[to_size(c)]) {
            component.borders = counts->borders;
            component.is_open = is_rim(counts->longest_border, counts->area);
            component.genus = counts->genus;
        } else {
            const Sampled sampled{surface, loops, result.labels, options.cells};
            const Progress::Part part(progress, static_cast<double>(c) / count,
                                      static_cast<double>(c + 1) / count);
            sampled.look_at(component, c, every_nth(rows[c], options.points), progress);
        }
        progress.report(static_cast<double>(c + 1) / count);
    }
    return result;
}

std::string in_words(const Topology& topology) {
    const auto main = topology.main();
    std::string strays;
    if (topology.strays > 0)
        strays = " and " + std::to_string(topology.strays) +
                 (topology.strays == 1 ? " speck" : " specks");
    if (main.size() == 1) return in_words(main.front()) + strays;
    std::vector<std::pair<std::string, std::string>> kinds;  // singular, plural
    std::vector<Index> counts;
    for (const Component& component : main) {
        const std::pair kind(in_words(component), in_words(component, true));
        const auto known = std::ranges::find(kinds, kind);
        if (known == kinds.end()) {
            kinds.push_back(kind);
            counts.push_back(1);
        } else {
            ++counts[to_size(known - kinds.begin())];
        }
    }
    if (kinds.size() == 1) return std::to_string(main.size()) + " " + kinds[0].second + strays;
    std::string words = std::to_string(main.size()) + " pieces (";
    for (std::size_t k = 0; k < kinds.size(); ++k) {
        if (k > 0) words += k + 1 < kinds.size() ? ", " : " and ";
        words +=
            counts[k] == 1 ? kinds[k].first : std::to_string(counts[k]) + " " + kinds[k].second;
    }
    return words + ")" + strays;
}

bool differ(const Component& source, const Component& target) {
    const bool handles = source.genus && target.genus && *source.genus != *target.genus;
    return source.is_open != target.is_open || handles;
}

std::string difference_in_words(const Topology& source, const std::string& source_name,
                                const Topology& target, const std::string& target_name) {
    const Component &s = source.components.front(), &t = target.components.front();
    if (!differ(s, t)) return "";
    const bool are_whole = source.main().size() == 1 && target.main().size() == 1;
    const std::string one = are_whole ? "" : "the largest piece of ";
    return (are_whole ? "" : "The largest piece of ") + source_name + " is " + in_words(s) +
           " and " + one + target_name + " " + in_words(t) +
           ": where they differ, the surface tears or folds during the morph.";
}

std::string in_words(const Topology& source, const Topology& target) {
    const auto s = source.main(), t = target.main();
    const std::string one = in_words(source), other = in_words(target);
    if (s.size() == 1 && t.size() == 1 && source.strays + target.strays == 0 && one == other)
        return in_words(s.front(), true);
    return one == other ? "on both sides " + one : one + ", to " + other;
}

}  // namespace pointmorph
