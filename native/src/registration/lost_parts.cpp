#include "registration/lost_parts.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

#include "base/grouped.hpp"
#include "base/median.hpp"
#include "base/quietly.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"

namespace pointmorph {

namespace {

constexpr double kLost = 2.0, kDeepest = 5.0;  // spacings from the images: a part, and some of it
constexpr double kAtEnd = 4.0;                 // spacings of a part's rim from images of ends
constexpr double kRimAtEnd = 0.2;              // share of its rim
constexpr std::size_t kFewestLost = 10;        // points
constexpr double kOtherSide = -0.2;            // product of normals

/// The map from one of the clouds, and what it needs of the map back. Whole: the cloud that a part
/// is looked for on.
struct WholeOntoPart {
    const SampledSurface& whole;
    const SampledSurface& part;
    std::span<const Index> ends;  ///< of the part
    const Positions& part_images;
    Positions& images;  ///< of the whole
    const ProductPoints& part_product;
    ProductPoints& product;
    Index IndexPair::*row;      ///< of the whole
    Index IndexPair::*partner;  ///< on the part
    Eigen::Index column;        ///< of the part's coordinates in the product space
};

/// How far the part's images lie apart around each of them.
Values steps_of_images(const WholeOntoPart& map) {
    constexpr std::size_t kAround = 6;
    constexpr double kMost = 3.0;  // medians: what is stretched over a part that is missing
    Values steps(map.part.size());
    for (Index i = 0; i < map.part.size(); ++i) {
        const auto near = map.part.nearest[i].first(std::min(map.part.nearest[i].size(), kAround));
        double sum = 0.0;
        for (const Index j : near) sum += (map.part_images.row(i) - map.part_images.row(j)).norm();
        steps[i] = sum / static_cast<double>(std::max<std::size_t>(near.size(), 1));
    }
    return steps.cwiseMin(kMost * median(steps));
}

/// How far each point of the whole is from the part's images, in spacings. `spacing`: of the whole,
/// around each of its points and usually.
Values distances_from_images(const WholeOntoPart& map, const Values& spacing, double usual,
                             Progress& progress) {
    const Values steps = steps_of_images(map);
    const KdTree<3> tree(map.part_images);
    Values result(map.whole.size());
    parallel_for(map.whole.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            Index nearest = 0;
            double squared = 0.0;
            tree.nearest(map.whole.positions.row(i).data(), {&nearest, 1}, {&squared, 1});
            const double unit = std::max({usual, spacing[i], steps[nearest]});
            result[i] = unit > 0.0 ? std::sqrt(squared) / unit : 0.0;
        }
    });
    return result;
}

/// A connected part of the whole that no image comes near.
struct LostPart {
    std::vector<Index> rows;
    std::vector<Index> rim;        ///< points around it
    std::vector<IndexPair> links;  ///< rows of it, and of it or the rim, that lie side by side
    double deepest = 0.0;          ///< largest distance from the images, in spacings
};

/// Asks every so often whether to end. Throws Cancelled.
void look_whether_to_end(std::size_t done, Progress& progress) {
    constexpr std::size_t kOften = 1024;
    if (done % kOften == 0 && !progress.poll()) progress.throw_if_cancelled();
}

bool is_among(Index row, std::span<const Index> ascending) {
    return std::ranges::binary_search(ascending, row);
}

/// Takes in what a part surrounds, such as points that a stray image comes near, if they are fewer
/// than `most` and none is marked. `state`: 0 where nothing is lost.
void take_islands(const SampledSurface& surface, LostPart& part, std::size_t most,
                  std::span<const Index> marked, std::vector<char>& state, Progress& progress) {
    constexpr char kLostHere = 1, kOutside = 2;
    std::vector<Index> outside;
    for (const Index first : part.rim) {
        if (state[to_size(first)] != 0) continue;
        std::vector<Index> island{first};
        state[to_size(first)] = kLostHere;
        bool is_outside = false;
        for (std::size_t k = 0; k < island.size() && !is_outside; ++k) {
            look_whether_to_end(k, progress);
            is_outside |= is_among(island[k], marked);
            for (const Index j : surface.nearest[island[k]]) {
                if (surface.normals.row(island[k]).dot(surface.normals.row(j)) < kOtherSide)
                    continue;
                is_outside |= state[to_size(j)] == kOutside;
                if (state[to_size(j)] == 0) {
                    state[to_size(j)] = kLostHere;
                    island.push_back(j);
                }
            }
            is_outside |= island.size() > most;
        }
        if (is_outside) {
            for (const Index i : island) state[to_size(i)] = kOutside;
            outside.insert(outside.end(), island.begin(), island.end());
        } else {
            part.rows.insert(part.rows.end(), island.begin(), island.end());
        }
    }
    std::erase_if(part.rim, [&](Index i) { return state[to_size(i)] != kOutside; });
    for (const Index i : outside) state[to_size(i)] = 0;
}

std::vector<LostPart> lost_parts(const WholeOntoPart& map, const Values& distances,
                                 std::span<const Index> marked, Progress& progress) {
    // Times: what surrounds, and all that isn't lost, than what is surrounded.
    constexpr std::size_t kLarger = 4, kStray = 10;
    const auto left = static_cast<std::size_t>((distances.array() <= kLost).count());
    std::vector<char> known(to_size(map.whole.size()), 0);
    std::vector<LostPart> parts;
    for (Index first = 0; first < map.whole.size(); ++first) {
        if (known[to_size(first)] != 0 || !(distances[first] > kLost)) continue;
        LostPart part{{first}, {}, {}, 0.0};
        known[to_size(first)] = 1;
        for (std::size_t k = 0; k < part.rows.size(); ++k) {
            look_whether_to_end(k, progress);
            const Index i = part.rows[k];
            part.deepest = std::max(part.deepest, distances[i]);
            for (const Index j : map.whole.nearest[i]) {
                if (map.whole.normals.row(i).dot(map.whole.normals.row(j)) < kOtherSide) continue;
                if (!(distances[j] > kLost)) part.rim.push_back(j);
                if (!(distances[j] > kLost) || std::exchange(known[to_size(j)], 1) != 0) continue;
                part.rows.push_back(j);
            }
        }
        std::ranges::sort(part.rim);
        part.rim.erase(std::unique(part.rim.begin(), part.rim.end()), part.rim.end());
        if (part.rows.size() < kFewestLost || !(part.deepest > kDeepest)) continue;
        const std::size_t most = std::min(part.rows.size() / kLarger, left / kStray);
        take_islands(map.whole, part, most, marked, known, progress);
        parts.push_back(std::move(part));
    }
    return parts;
}

/// A part and its rim, which comes after its rows, as a graph along the surface: each is joined to
/// its neighbors, and to those that have it for one.
class PartGraph {
public:
    /// `places`: −1 for each row of the surface, and again afterwards.
    PartGraph(const SampledSurface& surface, const LostPart& part, std::vector<Index>& places,
              Progress& progress)
        : rows_(part.rows), own_(part.rows.size()) {
        rows_.insert(rows_.end(), part.rim.begin(), part.rim.end());
        for (std::size_t k = 0; k < rows_.size(); ++k) places[to_size(rows_[k])] = to_index(k);
        std::vector<std::pair<Index, Step>> steps;
        const auto join = [&](Index from, Index to) {
            const Index a = rows_[to_size(from)], b = rows_[to_size(to)];
            steps.push_back(
                {from, {to, (surface.positions.row(a) - surface.positions.row(b)).norm()}});
        };
        for (std::size_t k = 0; k < rows_.size(); ++k) {
            look_whether_to_end(k, progress);
            const Index row = rows_[k];
            for (const Index j : surface.nearest[row]) {
                const Index other = places[to_size(j)];
                if (other < 0 || (k >= own_ && to_size(other) >= own_)) continue;
                if (surface.normals.row(row).dot(surface.normals.row(j)) < kOtherSide) continue;
                join(to_index(k), other);
                const auto back = surface.nearest[j];
                if (std::ranges::find(back, row) == back.end()) join(other, to_index(k));
            }
        }
        for (const auto& [from, to] : part.links) {
            join(places[to_size(from)], places[to_size(to)]);
            join(places[to_size(to)], places[to_size(from)]);
        }
        steps_ = Grouped<Step>(to_index(rows_.size()), [&](auto&& take) {
            for (const auto& [from, step] : steps) take(from, step);
        });
        for (const Index row : rows_) places[to_size(row)] = -1;
    }

    /// How far each of the part's rows is along the surface from a place in its rim; infinite where
    /// nothing leads there.
    Values distances_from(Index place, Progress& progress) const {
        constexpr double kNowhere = std::numeric_limits<double>::infinity();
        Values distances = Values::Constant(to_index(rows_.size()), kNowhere);
        using Entry = std::pair<double, Index>;
        std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
        const Index first = to_index(own_) + place;
        distances[first] = 0.0;
        open.emplace(0.0, first);
        for (std::size_t done = 0; !open.empty(); ++done) {
            look_whether_to_end(done, progress);
            const auto [distance, i] = open.top();
            open.pop();
            if (distance > distances[i]) continue;
            for (const Step& step : steps_[i]) {
                const double there = distance + step.length;
                if (!(there < distances[step.to])) continue;
                distances[step.to] = there;
                open.emplace(there, step.to);
            }
        }
        return distances.head(to_index(own_));
    }

    /// The surface's rows of the part, and of its rim after them.
    std::span<const Index> rows() const { return rows_; }

private:
    struct Step {
        Index to;
        double length;
    };

    std::vector<Index> rows_;  ///< of the surface
    std::size_t own_;          ///< how many of them aren't the rim
    Grouped<Step> steps_;
};

/// Some of the points, as far from each other as they can be.
std::vector<Index> spread(const Positions& points, Index most) {
    std::vector<Index> chosen{0};
    Values away = (points.rowwise() - points.row(0)).rowwise().squaredNorm();
    while (to_index(chosen.size()) < most) {
        Index next = 0;
        if (!(away.maxCoeff(&next) > 0.0)) break;
        chosen.push_back(next);
        away = away.cwiseMin((points.rowwise() - points.row(next)).rowwise().squaredNorm());
    }
    return chosen;
}

/// For each row of a part, the place in its rim that it hangs on: one that is near along the
/// surface, and to which the straight way stays close to the part. Where a limb is bent, the way
/// from its end to the nearest place leaves it, and what lies between is torn apart.
/// `places`: see PartGraph.
std::vector<Index> places_to_hang_on(const SampledSurface& surface, const LostPart& part,
                                     std::vector<Index>& places, Progress& progress) {
    constexpr Index kPlaces = 12;
    constexpr double kAlong = 0.5;  // against how far the middle of the way is from the part
    const PartGraph graph(surface, part, places, progress);
    const Positions of_rim = gather(surface.positions, part.rim),
                    of_part = gather(surface.positions, part.rows),
                    of_both = gather(surface.positions, graph.rows());
    const KdTree<3> tree(of_both);
    const std::vector<Index> chosen = spread(of_rim, kPlaces);
    Eigen::MatrixXd costs(of_part.rows(), to_index(chosen.size()));
    parallel_invoke(static_cast<int>(chosen.size()), progress, [&](int c, Progress& its) {
        const Index of_place = chosen[static_cast<std::size_t>(c)];
        costs.col(c) = kAlong * graph.distances_from(of_place, its);
        for (Index k = 0; k < of_part.rows(); ++k) {
            look_whether_to_end(to_size(k), its);
            const Eigen::RowVector3d middle = (of_part.row(k) + of_rim.row(of_place)) / 2.0;
            Index nearest = 0;
            double squared = 0.0;
            tree.nearest(middle.data(), {&nearest, 1}, {&squared, 1});
            costs(k, c) += std::sqrt(squared);
        }
    });
    std::vector<Index> result(part.rows.size(), -1), unreached;
    for (std::size_t k = 0; k < result.size(); ++k) {
        Index best = 0;
        if (std::isfinite(costs.row(to_index(k)).minCoeff(&best)))
            result[k] = chosen[to_size(best)];
        else
            unreached.push_back(part.rows[k]);
    }
    if (unreached.empty()) return result;
    // What no neighbor leads to takes the nearest in a straight line.
    const std::vector<Index> straight =
        nearest_rows(KdTree<3>(of_rim), gather(surface.positions, unreached));
    for (std::size_t k = 0, next = 0; k < result.size(); ++k)
        if (result[k] < 0) result[k] = straight[next++];
    return result;
}

/// What isn't lost, and each part that is, in trees of their own: so the nearest row outside of a
/// part is found without another tree for each.
class PartTrees {
public:
    PartTrees(const Positions& positions, std::span<const LostPart> parts, Progress& progress)
        : positions_(positions), part_of_(to_size(positions.rows()), -1) {
        for (std::size_t p = 0; p < parts.size(); ++p)
            for (const Index row : parts[p].rows) part_of_[to_size(row)] = to_index(p);
        std::vector<std::vector<Index>> rows(parts.size() + 1);  // the first: what isn't lost
        for (Index i = 0; i < to_index(part_of_.size()); ++i)
            rows[to_size(part_of_[to_size(i)] + 1)].push_back(i);
        for (std::vector<Index>& some : rows) {
            if (!progress.poll()) progress.throw_if_cancelled();
            const Positions places = gather(positions, some);
            trees_.push_back({std::move(some), KdTree<3>(places), to_index(trees_.size()) - 1});
        }
    }

    /// −1: it isn't lost.
    Index part_of(Index row) const { return trees_[to_size(part_of_[to_size(row)] + 1)].part; }
    void join(Index part, Index into) {
        for (Tree& tree : trees_)
            if (tree.part == part) tree.part = into;
    }

    /// The nearest row outside of a part to each of its rows; none where all rows are of it.
    std::vector<Index> beside(std::span<const Index> rows, Index part, Progress& progress) const {
        std::vector<Index> result(rows.size(), -1);
        parallel_for(to_index(rows.size()), progress, [&](Index begin, Index end) {
            for (std::size_t k = to_size(begin); k < to_size(end); ++k)
                result[k] = outside(rows[k], part);
        });
        if (std::ranges::find(result, -1) != result.end()) result.clear();
        return result;
    }

private:
    struct Tree {
        std::vector<Index> rows;
        KdTree<3> tree;
        Index part;  ///< that its rows are of by now
    };

    Index outside(Index row, Index part) const {
        Index result = -1, found = 0;
        double nearest = std::numeric_limits<double>::infinity(), squared = 0.0;
        for (const Tree& tree : trees_) {
            if (tree.part == part || tree.rows.empty()) continue;
            const double* const place = positions_.row(row).data();
            const Index count =
                result < 0 ? tree.tree.nearest(place, {&found, 1}, {&squared, 1})
                           : tree.tree.nearest_within(place, nearest, {&found, 1}, {&squared, 1});
            if (count == 0) continue;
            result = tree.rows[to_size(found)];
            nearest = std::sqrt(squared);
        }
        return result;
    }

    const Positions& positions_;
    std::vector<Index> part_of_;  ///< as they were found
    std::vector<Tree> trees_;
};

/// Joins what lies loose, such as a foot that is no one piece with the leg, to what is lost beside
/// it, or lays its rim where it is nearest to what isn't lost.
void join_loose(const SampledSurface& surface, std::vector<LostPart>& parts, double spacing,
                Progress& progress) {
    constexpr double kBeside = 2.0;  // spacings farther than the nearest of it
    if (std::ranges::none_of(parts, [](const LostPart& part) { return part.rim.empty(); })) return;
    PartTrees trees(surface.positions, parts, progress);
    for (std::size_t p = 0; p < parts.size(); ++p) {
        LostPart& loose = parts[p];
        if (!loose.rim.empty()) continue;
        const std::vector<Index> beside = trees.beside(loose.rows, to_index(p), progress);
        if (beside.empty()) continue;
        const Values gaps =
            (gather(surface.positions, loose.rows) - gather(surface.positions, beside))
                .rowwise()
                .norm();
        Index closest = 0;
        const double most = gaps.minCoeff(&closest) + kBeside * spacing;
        const Index into = trees.part_of(beside[to_size(closest)]);
        for (std::size_t k = 0; k < beside.size(); ++k) {
            if (gaps[to_index(k)] > most || trees.part_of(beside[k]) != into) continue;
            loose.links.push_back({loose.rows[k], beside[k]});
            if (into < 0) loose.rim.push_back(beside[k]);
        }
        std::ranges::sort(loose.rim);
        loose.rim.erase(std::unique(loose.rim.begin(), loose.rim.end()), loose.rim.end());
        if (into < 0) continue;
        LostPart& with = parts[to_size(into)];
        trees.join(to_index(p), into);
        with.rows.insert(with.rows.end(), loose.rows.begin(), loose.rows.end());
        with.links.insert(with.links.end(), loose.links.begin(), loose.links.end());
        loose = {};
    }
}

bool has_feature(const LostPart& part, std::span<const Index> marked) {
    return std::ranges::any_of(part.rows, [&](Index i) { return is_among(i, marked); });
}

/// Where the part ends: there, and on the whole.
struct Ends {
    explicit Ends(const WholeOntoPart& map)
        : there(gather(map.part.positions, map.ends)), images(gather(map.part_images, map.ends)) {}

    Positions there, images;
    KdTree<3> tree_there{there}, tree_of_images{images};
};

/// Whether all of it lies at ends already.
bool is_there(const LostPart& part, const WholeOntoPart& map, const Ends& ends) {
    const Positions images = gather(map.images, part.rows);
    return images == gather(ends.there, nearest_rows(ends.tree_there, images));
}

/// Pairs each row that goes to an end with that alone, and what has no other partner then with what
/// lies nearest to its image and stays. `end_of`: −1 for what stays. Throws Cancelled, and changes
/// nothing then.
void pair_with_ends(const WholeOntoPart& map, std::span<const Index> end_of, Pairing& pairs,
                    Progress& progress) {
    const auto goes = [&](const IndexPair& pair) { return end_of[to_size(pair.*map.row)] >= 0; };
    std::vector<char> has_partner(to_size(map.part.size()), 0);
    for (const IndexPair& pair : pairs)
        if (!goes(pair)) has_partner[to_size(pair.*map.partner)] = 1;
    Pairing added;
    const auto add = [&](Index row, Index partner) {
        IndexPair pair;
        pair.*map.row = row;
        pair.*map.partner = partner;
        added.push_back(pair);
    };
    std::vector<Index> staying, alone;
    for (Index i = 0; i < map.whole.size(); ++i)
        if (end_of[to_size(i)] < 0)
            staying.push_back(i);
        else
            add(i, end_of[to_size(i)]);
    for (Index i = 0; i < map.part.size(); ++i)
        if (has_partner[to_size(i)] == 0) alone.push_back(i);
    if (!progress.poll()) progress.throw_if_cancelled();
    if (!alone.empty() && !staying.empty()) {
        const Positions there = gather(map.whole.positions, staying);
        const std::vector<Index> nearest =
            nearest_rows(KdTree<3>(there), gather(map.part_images, alone));
        for (std::size_t k = 0; k < alone.size(); ++k) add(staying[to_size(nearest[k])], alone[k]);
    }
    std::erase_if(pairs, goes);
    pairs.insert(pairs.end(), added.begin(), added.end());
    std::ranges::sort(pairs);
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
}

/// The ends that the places around a lost part go to; none if they aren't at ends.
std::vector<Index> ends_at_rim(const WholeOntoPart& map, const Ends& ends, const LostPart& part,
                               double spacing) {
    const Positions rim = gather(map.whole.positions, part.rim);
    std::vector<Index> rows = nearest_rows(ends.tree_of_images, rim);
    const Values gaps = (rim - gather(ends.images, rows)).rowwise().norm();
    const auto near = (gaps.array() < kAtEnd * spacing).count();
    if (static_cast<double>(near) < kRimAtEnd * static_cast<double>(rim.rows())) return {};
    for (Index& row : rows) row = map.ends[to_size(row)];
    return rows;
}

/// Returns how many points of the whole go there.
Index send_to_ends(const WholeOntoPart& map, std::span<const Index> marked, Pairing& pairs,
                   Progress& progress) {
    if (map.ends.empty()) return 0;
    const Values spacings = local_spacing(map.whole.positions, map.whole.nearest);
    const double spacing = median(spacings);
    std::vector<LostPart> parts =
        lost_parts(map, distances_from_images(map, spacings, spacing, progress), marked, progress);
    if (parts.empty()) return 0;
    join_loose(map.whole, parts, spacing, progress);
    const Ends ends(map);
    std::vector<Index> end_of(to_size(map.whole.size()), -1), places(end_of.size(), -1);
    Index count = 0;
    for (const LostPart& part : parts) {
        if (part.rim.empty() || has_feature(part, marked) || is_there(part, map, ends)) continue;
        const std::vector<Index> at_rim = ends_at_rim(map, ends, part, spacing);
        if (at_rim.empty()) continue;
        const std::vector<Index> beside = places_to_hang_on(map.whole, part, places, progress);
        for (std::size_t k = 0; k < part.rows.size(); ++k)
            end_of[to_size(part.rows[k])] = at_rim[to_size(beside[k])];
        count += to_index(part.rows.size());
    }
    if (count == 0) return 0;
    pair_with_ends(map, end_of, pairs, progress);
    for (Index i = 0; i < map.whole.size(); ++i) {
        const Index end = end_of[to_size(i)];
        if (end < 0) continue;
        map.images.row(i) = map.part.positions.row(end);
        for (const Eigen::Index column : {map.column, map.column + 6})
            map.product.row(i).segment<3>(column) = map.part_product.row(end).segment<3>(column);
    }
    return count;
}

}  // namespace

LostPoints send_lost_parts_to_ends(Refinement& map, const EndingCloud& source,
                                   const EndingCloud& target, std::span<const Feature> features,
                                   Progress& progress) {
    if (source.ends.empty() && target.ends.empty()) return {};
    progress.enter("missing parts");
    const auto marked = [&](Marked Feature::*side) {
        std::vector<Index> rows;
        for (const Feature& feature : features)
            rows.insert(rows.end(), (feature.*side).rows.begin(), (feature.*side).rows.end());
        std::ranges::sort(rows);
        return rows;
    };
    return quietly(progress, [&](Progress& quiet) {
        LostPoints lost;
        lost.of_target = send_to_ends(
            {target.surface, source.surface, source.ends, map.source_images, map.target_images,
             map.source_product, map.target_product, &IndexPair::target, &IndexPair::source, 3},
            marked(&Feature::target), map.pairs, quiet);
        lost.of_source = send_to_ends(
            {source.surface, target.surface, target.ends, map.target_images, map.source_images,
             map.target_product, map.source_product, &IndexPair::source, &IndexPair::target, 0},
            marked(&Feature::source), map.pairs, quiet);
        return lost;
    });
}

}  // namespace pointmorph
