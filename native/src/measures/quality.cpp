#include "pointmorph/measures/quality.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/neighborhoods.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

namespace {

constexpr Index kNeighbors = 16;
constexpr double kSameSheet = 0.5;  // cosine between normals
constexpr Index kFewest = 6;        // neighbours that a Jacobian is fitted to
constexpr double kOnALine = 1e-4;   // determinant over squared trace
constexpr double kCollapsed = 0.05;
constexpr Index kFeet = 4;             // nearest points among which the foot of an image is sought
constexpr double kReach = 2.0;         // spacings
constexpr Index kMostCenters = 60000;  // points whose edges are kept for the percentile

constexpr double kStrongest = 20.0;     // stretch that still counts
constexpr double kBadRoundTrip = 0.05;  // in √area
constexpr double kFoldDistortion = 2.0;
constexpr double kBad = 1.0;

constexpr double kPlaceRadius = 0.1;  // in √area
constexpr double kPlaceDistance = 0.2;
constexpr double kFoldShows = 0.2;  // of the bad points
constexpr double kSmallestShare = 5e-4;
constexpr std::size_t kMostPlaces = 5;

/// One cloud, in the unit ball.
struct Sheet {
    Sheet(const Cloud& cloud, Progress& progress, double first, double last)
        : unit(normalization(cloud.positions)),
          positions(unit.apply(cloud.positions)),
          normals(cloud.normals.rowwise().normalized()),
          tree(positions) {
        const Progress::Part part(progress, first, last);
        const double area = estimated_area(tree);
        root_area = area > 0.0 ? std::sqrt(area) : 1.0;
        nearest = nearest_neighbors(tree, kNeighbors, progress);
        spacing = local_spacing(positions, nearest);
    }

    Index size() const { return static_cast<Index>(positions.rows()); }
    Vector3 position(Index i) const { return positions.row(i); }
    Vector3 normal(Index i) const { return normals.row(i); }
    bool same_sheet(Index i, Index j) const {
        return normals.row(i).dot(normals.row(j)) > kSameSheet;
    }

    Normalization unit;
    Positions positions;
    Normals normals;
    KdTree<3> tree;
    double root_area;
    Neighborhoods nearest;
    Values spacing;
};

/// The map from one sheet to the other: what `measure` and the passes after it fill.
struct Map {
    Positions images;
    std::vector<Matrix3> jacobian;  ///< takes displacements in the tangent plane to the image's
    std::vector<Index> foot;        ///< row of the other sheet nearest to the image, on its side
    std::vector<double> edges;      ///< stretch of some edges
    Values energy;                  ///< mean squared stretch of the edges of a point; < 0 for none
    PointQuality points;
    MapFigures figures;
};

double quantile(std::vector<double>& values, double share) {
    if (values.empty()) return 0.0;
    const auto nth = values.begin() +
                     static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    return *nth;
}

/// Singular values of J restricted to the plane of two orthonormal vectors, larger first.
std::array<double, 2> singular_values(const Vector3& along_a, const Vector3& along_b) {
    const double aa = along_a.squaredNorm(), bb = along_b.squaredNorm(), ab = along_a.dot(along_b);
    const double larger = (aa + bb + std::hypot(aa - bb, 2.0 * ab)) / 2.0;
    const double area = along_a.cross(along_b).norm();
    const double first = std::sqrt(larger);
    return {first, first > 0.0 ? area / first : 0.0};
}

/// The row of each point's partner that lies nearest to its image; −1 where it has none.
template <class RowOf, class PartnerOf>
std::vector<Index> nearest_partners(std::span<const IndexPair> pairs, const Positions& images,
                                    const Sheet& other, RowOf row_of, PartnerOf partner_of) {
    std::vector<Index> partner(to_size(static_cast<Index>(images.rows())), -1);
    const auto distance = [&](Index row, Index to) {
        return (images.row(row) - other.positions.row(to)).squaredNorm();
    };
    for (const IndexPair& pair : pairs) {
        const Index row = row_of(pair), to = partner_of(pair);
        Index& best = partner[to_size(row)];
        if (best < 0 || distance(row, to) < distance(row, best)) best = to;
    }
    return partner;
}

/// Fits the Jacobians and finds where the images lie.
void measure(const Sheet& sheet, const Sheet& other, std::span<const Index> partners, Map& map,
             Progress& progress, double first, double last) {
    const Index count = sheet.size();
    const double scale = sheet.root_area / other.root_area;
    const Index step = std::max<Index>(1, count / kMostCenters);
    map.jacobian.resize(to_size(count));
    map.foot.resize(to_size(count));
    map.edges.assign(to_size((count + step - 1) / step * kNeighbors), -1.0);
    map.energy.setConstant(count, -1.0);
    map.points.stretch.setOnes(count, 2);
    map.points.measured.assign(to_size(count), 0);
    map.points.flipped.assign(to_size(count), 0);

    const auto fit = [&](Index i) {
        const Vector3 normal = sheet.normal(i), a = normal.unitOrthogonal(), b = normal.cross(a);
        double aa = 0.0, ab = 0.0, bb = 0.0, energy = 0.0;
        Vector3 along_a = Vector3::Zero(), along_b = Vector3::Zero();
        Index used = 0;
        Matrix3& jacobian = map.jacobian[to_size(i)];
        jacobian.setZero();
        for (const Index j : sheet.nearest[i]) {
            if (!sheet.same_sheet(i, j)) continue;
            const Vector3 step_here = sheet.positions.row(j) - sheet.positions.row(i);
            const Vector3 step_there = map.images.row(j) - map.images.row(i);
            const double length = step_here.norm();
            if (!(length > 0.0)) continue;
            const double stretch = scale * step_there.norm() / length;
            energy += stretch * stretch;
            if (i % step == 0) map.edges[to_size(i / step * kNeighbors + used)] = stretch;
            ++used;
            const double x = step_here.dot(a), y = step_here.dot(b);
            aa += x * x;
            ab += x * y;
            bb += y * y;
            along_a += x * step_there;
            along_b += y * step_there;
        }
        if (used > 0) map.energy[i] = energy / used;
        const double determinant = aa * bb - ab * ab;
        if (used < kFewest || !(determinant > kOnALine * (aa + bb) * (aa + bb))) return;
        const Vector3 to_a = (bb * along_a - ab * along_b) / determinant;
        const Vector3 to_b = (aa * along_b - ab * along_a) / determinant;
        jacobian = to_a * a.transpose() + to_b * b.transpose();
        const auto [larger, smaller] = singular_values(to_a, to_b);
        map.points.stretch.row(i) << scale * larger, scale * smaller;
        map.points.measured[to_size(i)] = 1;
        map.points.flipped[to_size(i)] =
            to_a.cross(to_b).dot(other.normal(map.foot[to_size(i)])) < 0.0;
    };
    const auto foot_of = [&](Index i) {
        std::array<Index, kFeet> feet{};
        std::array<double, kFeet> squared_distances{};
        const auto nearest = [&](std::size_t wanted) {
            const std::span<Index> found(feet.data(), wanted);
            const Index count_found = other.tree.nearest(map.images.row(i).data(), found,
                                                         {squared_distances.data(), wanted});
            return found.first(to_size(count_found));
        };
        const Index partner = partners[to_size(i)];
        const auto same_side = [&](Index j) {
            return partner < 0 || other.normals.row(j).dot(other.normals.row(partner)) > 0;
        };
        const Index first_foot = nearest(1).front();
        if (same_side(first_foot)) return first_foot;
        const auto several = nearest(kFeet);
        const auto foot = std::ranges::find_if(several, same_side);
        return foot == several.end() ? first_foot : *foot;
    };
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                map.foot[to_size(i)] = foot_of(i);
                fit(i);
            }
        },
        first, last);
}

/// There by `map`, back by `reverse`: between samples along the Jacobian of the nearest.
void go_there_and_back(const Sheet& sheet, const Sheet& other, const Map& reverse, Map& map,
                       Progress& progress, double first, double last) {
    map.points.round_trip.resize(sheet.size());
    parallel_for(
        sheet.size(), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                const Index foot = map.foot[to_size(i)];
                const Vector3 off = (map.images.row(i) - other.positions.row(foot)).transpose();
                const Vector3 back =
                    reverse.images.row(foot).transpose() + reverse.jacobian[to_size(foot)] * off;
                map.points.round_trip[i] = (back - sheet.position(i)).norm() / sheet.root_area;
            }
        },
        first, last);
}

/// Which points of `sheet` some image of the other's points comes near.
void find_reached(const Sheet& sheet, const Sheet& other, const Map& reverse, Map& map,
                  Progress& progress, double first, double last) {
    const KdTree<3> landed(reverse.images);
    const double scale = sheet.root_area / other.root_area;
    map.points.reached.resize(to_size(sheet.size()));
    parallel_for(
        sheet.size(), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                Index nearest = 0;
                double squared_distance = 0.0;
                landed.nearest(sheet.positions.row(i).data(), {&nearest, 1},
                               {&squared_distance, 1});
                const double limit =
                    kReach * std::max(sheet.spacing[i], scale * other.spacing[nearest]);
                map.points.reached[to_size(i)] = squared_distance <= limit * limit;
            }
        },
        first, last);
}

/// √((ln² s₁ + ln² s₂) / 2), bounded.
double strain(double larger, double smaller) {
    const double limit = std::log(kStrongest);
    const auto bounded = [&](double s) {
        return s > 0.0 ? std::clamp(std::log(s), -limit, limit) : -limit;
    };
    return std::sqrt((bounded(larger) * bounded(larger) + bounded(smaller) * bounded(smaller)) /
                     2.0);
}

bool is_mirrored(const MapFigures& figures) {
    return figures.flipped > 0.5;
}

void sum_up(const PointQuality& other, Map& map) {
    const PointQuality& points = map.points;
    const auto count = points.stretch.rows();
    MapFigures& figures = map.figures;
    std::vector<double> conformal;
    double energy = 0.0;
    Index with_edges = 0, flipped = 0, collapsed = 0;
    for (Eigen::Index i = 0; i < count; ++i) {
        if (map.energy[i] >= 0.0) {
            energy += map.energy[i];
            ++with_edges;
        }
        if (!points.measured[to_size(i)]) continue;
        const double larger = std::max(points.stretch(i, 0), 1e-6);
        const double smaller = std::max(points.stretch(i, 1), 1e-6);
        conformal.push_back((larger / smaller + smaller / larger) / 2.0);
        flipped += points.flipped[to_size(i)];
        collapsed += points.stretch(i, 1) < kCollapsed * points.stretch(i, 0);
    }
    const auto share = [](Index part, std::size_t all) {
        return all > 0 ? part / static_cast<double>(all) : 0.0;
    };
    figures.dirichlet = with_edges > 0 ? energy / with_edges : 0.0;
    std::erase_if(map.edges, [](double stretch) { return stretch < 0.0; });
    figures.stretch_p99 = quantile(map.edges, 0.99);
    figures.flipped = share(flipped, conformal.size());
    figures.collapsed = share(collapsed, conformal.size());
    figures.conformal_median = quantile(conformal, 0.5);
    figures.round_trip_mean = points.round_trip.sum() / static_cast<double>(count);
    std::vector<double> round_trip(points.round_trip.begin(), points.round_trip.end());
    figures.round_trip_p99 = quantile(round_trip, 0.99);
    const auto reached = std::accumulate(other.reached.begin(), other.reached.end(), Index{0});
    figures.coverage = share(reached, other.reached.size());
}

Flaw flaw_of(const PointQuality& points, Index i, bool mirrored) {
    const double larger = points.stretch(i, 0), smaller = points.stretch(i, 1);
    const double lost =
        std::max(points.round_trip[i] / kBadRoundTrip, points.reached[to_size(i)] ? 0.0 : kBad);
    if (points.measured[to_size(i)] && (points.flipped[to_size(i)] != 0) != mirrored)
        return Flaw::kFolded;
    if (lost > strain(larger, smaller)) return Flaw::kLost;
    return larger * smaller > 1.0 ? Flaw::kStretched : Flaw::kSqueezed;
}

void find_distortion(Map& map, Progress& progress, double first, double last) {
    PointQuality& points = map.points;
    const bool mirrored = is_mirrored(map.figures);
    points.distortion.resize(points.round_trip.size());
    parallel_for(
        static_cast<Index>(points.distortion.size()), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                double value = std::max(strain(points.stretch(i, 0), points.stretch(i, 1)),
                                        points.round_trip[i] / kBadRoundTrip);
                if (!points.reached[to_size(i)]) value = std::max(value, kBad);
                if (points.measured[to_size(i)] && (points.flipped[to_size(i)] != 0) != mirrored)
                    value = std::max(value, kFoldDistortion);
                points.distortion[i] = value;
            }
        },
        first, last);
}

/// A place as one side sees it.
struct Spot {
    Index row;
    Flaw flaw;
    double distortion;
    double share;
    double factor;   ///< by which its bad points are stretched or squeezed, median
    double badness;  ///< area times distortion over the limit
};

std::vector<Spot> find_spots(const Sheet& sheet, const Map& map, Progress& progress, double first,
                             double last) {
    const PointQuality& points = map.points;
    // Single bad points are noise: a place is bad on average over neighbours.
    Values smooth(sheet.size());
    parallel_for(
        sheet.size(), progress,
        [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                double sum = points.distortion[i];
                for (const Index j : sheet.nearest[i]) sum += points.distortion[j];
                smooth[i] = sum / static_cast<double>(sheet.nearest[i].size() + 1);
            }
        },
        first, last);
    std::vector<Index> candidates;
    for (Index i = 0; i < sheet.size(); ++i)
        if (smooth[i] > kBad) candidates.push_back(i);
    std::ranges::sort(candidates, [&](Index i, Index j) {
        return std::pair(-smooth[i], i) < std::pair(-smooth[j], j);
    });

    const double area = sheet.spacing.squaredNorm();
    const double distance = kPlaceDistance * sheet.root_area;
    const bool mirrored = is_mirrored(map.figures);
    std::vector<Spot> spots;
    std::vector<std::pair<Index, double>> around;
    for (const Index i : candidates) {
        progress.throw_if_cancelled();
        const bool apart = std::ranges::none_of(spots, [&](const Spot& spot) {
            return (sheet.position(spot.row) - sheet.position(i)).norm() < distance;
        });
        if (!apart) continue;
        Spot spot{i, Flaw::kStretched, smooth[i], 0.0, 1.0, 0.0};
        std::array<double, 5> by_flaw{};
        std::vector<double> factors;
        sheet.tree.within(sheet.positions.row(i).data(), kPlaceRadius * sheet.root_area, around);
        for (const auto& [j, squared_distance] : around) {
            if (!(points.distortion[j] > kBad) && j != i) continue;
            const double share = area > 0.0 ? sheet.spacing[j] * sheet.spacing[j] / area : 0.0;
            spot.share += share;
            spot.badness += share * (points.distortion[j] - kBad);
            by_flaw[to_size(flaw_of(points, j, mirrored))] += share;
            factors.push_back(
                std::max(points.stretch(j, 0), 1.0 / std::max(points.stretch(j, 1), 1e-300)));
        }
        spot.flaw = static_cast<Flaw>(std::ranges::max_element(by_flaw) - by_flaw.begin());
        // A fold stretches what is around it, and only one of its layers comes back.
        if (by_flaw[to_size(Flaw::kFolded)] > kFoldShows * spot.share) spot.flaw = Flaw::kFolded;
        spot.factor = std::min(quantile(factors, 0.5), kStrongest);
        spots.push_back(spot);
    }
    std::erase_if(spots, [](const Spot& spot) { return spot.share < kSmallestShare; });
    return spots;
}

// --- Words
// ----------------------------------------------------------------------------------------

std::string quoted(const std::string& name) {
    return "\"" + name + "\"";
}

std::string percent(double share) {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), share < 0.1 ? "%.1f %%" : "%.0f %%", 100.0 * share);
    return text.data();
}

std::string times(double factor) {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), factor < 10.0 ? "%.1f times" : "%.0f times", factor);
    return text.data();
}

/// Where a point of the source lies in terms of the features, the mark that would help there, and
/// what to call the source after that.
struct Words {
    std::string where, remedy, source;
};

/// A marked point, by the name of its feature.
struct MarkedPoint {
    const std::string* name;
    Index row;
};

/// Words tell where a place is by points and curves; a region has no place of its own.
std::vector<MarkedPoint> marked_points(std::span<const Feature> features) {
    std::vector<MarkedPoint> points;
    for (const Feature& feature : features)
        if (feature.kind != FeatureKind::kRegion)
            for (const Index row : feature.source.rows) points.push_back({&feature.name, row});
    return points;
}

Words words_for(const Sheet& source, Index row, const std::string& name,
                std::span<const MarkedPoint> features) {
    const std::string mark = "mark a feature there on both models";
    const auto arm = [&](const MarkedPoint& feature) -> Vector3 {
        return source.position(feature.row) - source.position(row);
    };
    const auto by_distance = [&](const MarkedPoint& a, const MarkedPoint& b) {
        return arm(a).norm() < arm(b).norm();
    };
    const auto nearest = std::ranges::min_element(features, by_distance);
    if (nearest == features.end() || arm(*nearest).norm() > 0.5 * source.root_area)
        return {direction_in_words(source.positions, row) + " of " + name, mark, "it"};
    if (arm(*nearest).norm() < 0.05 * source.root_area)
        return {"at " + quoted(*nearest->name),
                "check that " + quoted(*nearest->name) +
                    " marks the same place on both models, or mark another feature beside it",
                name};
    std::vector<MarkedPoint> beyond;
    for (const MarkedPoint& feature : features)
        if (feature.name != nearest->name && arm(feature).dot(arm(*nearest)) < 0.0 &&
            arm(feature).norm() < source.root_area)
            beyond.push_back(feature);
    const auto second = std::ranges::min_element(beyond, by_distance);
    if (second == beyond.end()) return {"near " + quoted(*nearest->name), mark, name};
    return {"between " + quoted(*nearest->name) + " and " + quoted(*second->name), mark, name};
}

/// A spot of either side, as the user hears of it.
struct Seen : Spot {
    bool on_source;
    Index source, target;
};

/// What a map back squeezes, the morph stretches.
Flaw seen_from_the_other_side(Flaw flaw) {
    if (flaw == Flaw::kSqueezed) return Flaw::kStretched;
    return flaw == Flaw::kStretched ? Flaw::kSqueezed : flaw;
}

std::string advice_on(const Seen& seen, const Words& words, const std::string& source,
                      const std::string& target) {
    const std::string& here = seen.on_source ? source : target;
    const std::string& there = seen.on_source ? target : source;
    const auto what = [&]() -> std::string {
        switch (seen.flaw) {
            case Flaw::kFolded:
                return "the map folds over itself";
            case Flaw::kLost:
                return "a part of " + here + " has no counterpart on " + there;
            case Flaw::kSqueezed:
                return words.source + " is squeezed " + times(seen.factor);
            default:
                return words.source + " is stretched " + times(seen.factor);
        }
    };
    std::string text = words.where + " " + what() + " (" + percent(seen.share) + " of " + here +
                       "): " + words.remedy + ".";
    text.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
    return text;
}

}  // namespace

std::string name_of(Flaw flaw) {
    constexpr std::array names{"mirrored", "folded", "lost", "stretched", "squeezed"};
    return names[to_size(flaw)];
}

std::string direction_in_words(const Positions& positions, Index row) {
    const Vector3 extent = positions.cwiseAbs().colwise().maxCoeff();
    std::string words;
    for (int axis = 0; axis < 3; ++axis) {
        const double place = positions(row, axis);
        if (std::abs(place) <= std::max(0.4 * extent[axis], 0.1)) continue;
        words += words.empty() ? "towards " : ", ";
        words += place < 0.0 ? "-" : "+";
        words += "XYZ"[axis];
    }
    return words.empty() ? "in the middle" : words;
}

Quality measure_quality(const Cloud& source, const Cloud& target, const Positions& source_images,
                        const Positions& target_images, std::span<const IndexPair> pairs,
                        std::span<const Feature> features, Progress& progress) {
    const Sheet from(source, progress, 0.0, 0.3), to(target, progress, 0.3, 0.6);
    Map there, back;
    there.images = to.unit.apply(source_images);
    back.images = from.unit.apply(target_images);

    const auto source_of = [](const IndexPair& pair) { return pair.source; };
    const auto target_of = [](const IndexPair& pair) { return pair.target; };
    const auto on_target = nearest_partners(pairs, there.images, to, source_of, target_of);
    const auto on_source = nearest_partners(pairs, back.images, from, target_of, source_of);
    measure(from, to, on_target, there, progress, 0.6, 0.7);
    measure(to, from, on_source, back, progress, 0.7, 0.8);
    go_there_and_back(from, to, back, there, progress, 0.8, 0.82);
    go_there_and_back(to, from, there, back, progress, 0.82, 0.84);
    find_reached(from, to, back, there, progress, 0.84, 0.9);
    find_reached(to, from, there, back, progress, 0.9, 0.96);
    sum_up(back.points, there);
    sum_up(there.points, back);
    find_distortion(there, progress, 0.96, 0.97);
    find_distortion(back, progress, 0.97, 0.98);

    std::vector<Seen> seen;
    for (const Spot& spot : find_spots(from, there, progress, 0.98, 0.99))
        seen.push_back({spot, true, spot.row, there.foot[to_size(spot.row)]});
    for (const Spot& spot : find_spots(to, back, progress, 0.99, 1.0)) {
        seen.push_back({spot, false, back.foot[to_size(spot.row)], spot.row});
        seen.back().flaw = seen_from_the_other_side(spot.flaw);
    }
    std::ranges::stable_sort(seen, std::ranges::greater{}, &Seen::badness);

    Quality quality;
    if (is_mirrored(there.figures) || is_mirrored(back.figures)) {
        Index row = 0;
        there.points.distortion.minCoeff(&row);
        quality.worst.push_back(
            {row, there.foot[to_size(row)], Flaw::kMirrored, there.points.distortion[row],
             there.figures.flipped,
             "The map turns " + source.name +
                 " inside out or swaps left and right: recalculate the normals of both models to "
                 "point outwards, and check that no feature is on the other side of one."});
    }
    const std::vector<MarkedPoint> marked = marked_points(features);
    for (const Seen& spot : seen) {
        if (quality.worst.size() == kMostPlaces) break;
        const bool apart = std::ranges::none_of(quality.worst, [&](const Place& place) {
            return place.flaw != Flaw::kMirrored &&
                   (from.position(place.source) - from.position(spot.source)).norm() <
                       kPlaceDistance * from.root_area &&
                   (to.position(place.target) - to.position(spot.target)).norm() <
                       kPlaceDistance * to.root_area;
        });
        if (!apart) continue;
        const Words words = words_for(from, spot.source, source.name, marked);
        quality.worst.push_back({spot.source, spot.target, spot.flaw, spot.distortion, spot.share,
                                 advice_on(spot, words, source.name, target.name)});
    }
    quality.features = feature_residuals(features, from.tree, from.normals, to.tree, to.normals,
                                         there.images, back.images, progress);
    quality.source = std::move(there.points);
    quality.target = std::move(back.points);
    quality.source_to_target = there.figures;
    quality.target_to_source = back.figures;
    return quality;
}

}  // namespace pointmorph
