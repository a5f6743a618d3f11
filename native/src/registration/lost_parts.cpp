#include "registration/lost_parts.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

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

/// How far each point of the whole is from the part's images, in spacings.
Values distances_from_images(const WholeOntoPart& map, Progress& progress) {
    const Values steps = steps_of_images(map),
                 spacing = local_spacing(map.whole.positions, map.whole.nearest);
    const double usual = median(spacing);
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
    std::vector<Index> rim;  ///< points around it
    double deepest = 0.0;    ///< largest distance from the images, in spacings
};

/// Asks every so often whether to end. Throws Cancelled.
void look_whether_to_end(std::size_t done, Progress& progress) {
    constexpr std::size_t kOften = 1024;
    if (done % kOften == 0 && !progress.poll()) progress.throw_if_cancelled();
}

std::vector<LostPart> lost_parts(const WholeOntoPart& map, const Values& distances,
                                 Progress& progress) {
    std::vector<char> known(to_size(map.whole.size()), 0);
    std::vector<LostPart> parts;
    for (Index first = 0; first < map.whole.size(); ++first) {
        if (known[to_size(first)] != 0 || !(distances[first] > kLost)) continue;
        LostPart part{{first}, {}, 0.0};
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
        if (part.rows.size() >= kFewestLost && part.deepest > kDeepest)
            parts.push_back(std::move(part));
    }
    return parts;
}

/// How far a row of a part is from its rim along the surface, and the place there.
struct FromRim {
    double distance = std::numeric_limits<double>::infinity();
    Index rim = -1;
    bool is_part = false;
};

/// For each row of a part, the place in its rim that is nearest along the surface: like this, only
/// what is far from all of it is torn apart. `reached`: scratch memory, as it is left.
std::vector<Index> nearest_of_rim(const SampledSurface& surface, const LostPart& part,
                                  std::vector<FromRim>& reached, Progress& progress) {
    reached.resize(to_size(surface.size()));
    for (const Index i : part.rows) reached[to_size(i)].is_part = true;
    using Entry = std::pair<double, Index>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    const auto step = [&](Index from, double distance, Index rim, Index to) {
        FromRim& there = reached[to_size(to)];
        if (!there.is_part) return;
        if (surface.normals.row(from).dot(surface.normals.row(to)) < kOtherSide) return;
        distance += (surface.positions.row(from) - surface.positions.row(to)).norm();
        if (!(distance < there.distance)) return;
        there.distance = distance;
        there.rim = rim;
        open.emplace(distance, to);
    };
    for (std::size_t k = 0; k < part.rim.size(); ++k)
        for (const Index j : surface.nearest[part.rim[k]]) step(part.rim[k], 0.0, to_index(k), j);
    // Where the rim is denser than the part, it has only neighbors of its own.
    for (const Index i : part.rows)
        for (const Index j : surface.nearest[i]) {
            const auto found = std::ranges::lower_bound(part.rim, j);
            if (found != part.rim.end() && *found == j)
                step(j, 0.0, to_index(found - part.rim.begin()), i);
        }
    for (std::size_t done = 0; !open.empty(); ++done) {
        look_whether_to_end(done, progress);
        const auto [distance, i] = open.top();
        open.pop();
        const FromRim there = reached[to_size(i)];
        if (distance > there.distance) continue;
        for (const Index j : surface.nearest[i]) step(i, there.distance, there.rim, j);
    }
    std::vector<Index> result, unreached;
    for (const Index i : part.rows) {
        result.push_back(std::exchange(reached[to_size(i)], {}).rim);
        if (result.back() < 0) unreached.push_back(i);
    }
    if (unreached.empty()) return result;
    // What no neighbor leads to takes the nearest in a straight line.
    const Positions rim = gather(surface.positions, part.rim);
    const std::vector<Index> straight =
        nearest_rows(KdTree<3>(rim), gather(surface.positions, unreached));
    for (std::size_t k = 0, next = 0; k < result.size(); ++k)
        if (result[k] < 0) result[k] = straight[next++];
    return result;
}

bool has_feature(const LostPart& part, std::span<const Index> marked) {
    return std::ranges::any_of(part.rows,
                               [&](Index i) { return std::ranges::binary_search(marked, i); });
}

/// Whether all of it lies at ends already.
bool is_there(const LostPart& part, const WholeOntoPart& map) {
    const Positions ends = gather(map.part.positions, map.ends),
                    images = gather(map.images, part.rows);
    return images == gather(ends, nearest_rows(KdTree<3>(ends), images));
}

/// Pairs each of the part's rows with the end that it goes to alone, as far as others keep a
/// partner. `end_of`: −1 for what stays.
void pair_with_ends(const WholeOntoPart& map, std::span<const Index> end_of, Pairing& pairs) {
    std::vector<Index> partners(to_size(map.part.size()), 0);
    for (const IndexPair& pair : pairs) ++partners[to_size(pair.*map.partner)];
    std::erase_if(pairs, [&](const IndexPair& pair) {
        Index& left = partners[to_size(pair.*map.partner)];
        const bool goes = end_of[to_size(pair.*map.row)] >= 0 && left > 1;
        if (goes) --left;
        return goes;
    });
    for (std::size_t i = 0; i < end_of.size(); ++i) {
        if (end_of[i] < 0) continue;
        IndexPair pair;
        pair.*map.row = to_index(i);
        pair.*map.partner = end_of[i];
        pairs.push_back(pair);
    }
    std::ranges::sort(pairs);
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
}

/// Returns how many points of the whole go there.
Index send_to_ends(const WholeOntoPart& map, std::span<const Index> marked, Pairing& pairs,
                   Progress& progress) {
    if (map.ends.empty()) return 0;
    const Positions ends = gather(map.part_images, map.ends);
    const KdTree<3> ends_tree(ends);
    const double at_end = kAtEnd * median(local_spacing(map.whole.positions, map.whole.nearest));
    std::vector<Index> end_of(to_size(map.whole.size()), -1);
    std::vector<FromRim> reached;
    Index count = 0;
    for (const LostPart& part : lost_parts(map, distances_from_images(map, progress), progress)) {
        if (part.rim.empty() || has_feature(part, marked) || is_there(part, map)) continue;
        const Positions rim = gather(map.whole.positions, part.rim);
        const std::vector<Index> end_of_rim = nearest_rows(ends_tree, rim);
        const Values gaps = (rim - gather(ends, end_of_rim)).rowwise().norm();
        const auto near = (gaps.array() < at_end).count();
        if (static_cast<double>(near) < kRimAtEnd * static_cast<double>(rim.rows())) continue;
        const std::vector<Index> beside = nearest_of_rim(map.whole, part, reached, progress);
        for (std::size_t k = 0; k < part.rows.size(); ++k)
            end_of[to_size(part.rows[k])] = map.ends[to_size(end_of_rim[to_size(beside[k])])];
        count += to_index(part.rows.size());
    }
    if (count == 0) return 0;
    for (Index i = 0; i < map.whole.size(); ++i) {
        const Index end = end_of[to_size(i)];
        if (end < 0) continue;
        map.images.row(i) = map.part.positions.row(end);
        for (const Eigen::Index column : {map.column, map.column + 6})
            map.product.row(i).segment<3>(column) = map.part_product.row(end).segment<3>(column);
    }
    pair_with_ends(map, end_of, pairs);
    return count;
}

}  // namespace

LostPoints send_lost_parts_to_ends(Refinement& map, const EndingCloud& source,
                                   const EndingCloud& target, std::span<const Feature> features,
                                   Progress& progress) {
    if (source.ends.empty() && target.ends.empty()) return {};
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
