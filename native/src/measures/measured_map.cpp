#include "measures/measured_map.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/subset.hpp"

namespace pointmorph {

namespace {

constexpr double kSameSide = 0.5;  // cosine between normals
constexpr Index kFewest = 6;       // neighbors that a Jacobian is fitted to
constexpr double kOnALine = 1e-4;  // determinant over squared trace
constexpr double kCollapsed = 0.05;
constexpr Index kFeet = 4;      // nearest points among which the foot of an image is sought
constexpr double kReach = 2.0;  // spacings
constexpr std::size_t kAreaNeighbors = 12;
constexpr Index kMostCenters = 60000;  // points whose edges are kept for the percentile
constexpr double kFoldDistortion = 2.0;

/// Singular values of J restricted to the plane of two orthonormal vectors, larger first.
std::array<double, 2> singular_values(const Vector3& along_a, const Vector3& along_b) {
    const double aa = along_a.squaredNorm(), bb = along_b.squaredNorm(), ab = along_a.dot(along_b);
    const double larger = (aa + bb + Eigen::Vector2d(aa - bb, 2.0 * ab).norm()) / 2.0;
    const double area = along_a.cross(along_b).norm();
    const double first = std::sqrt(larger);
    return {first, first > 0.0 ? area / first : 0.0};
}

/// Where each point's partner that lies nearest to its image is; −1 where it has none.
std::vector<Index> nearest_partners(std::span<const IndexPair> pairs, const MeasuredCloud& cloud,
                                    const Positions& images, const MeasuredCloud& other,
                                    Index IndexPair::*row, Index IndexPair::*partner) {
    std::vector<Index> nearest(to_size(cloud.size()), -1);
    const auto distance = [&](Index i, Index to) {
        return (images.row(i) - other.positions.row(to)).squaredNorm();
    };
    for (const IndexPair& pair : pairs) {
        const Index i = cloud.sorted[to_size(pair.*row)];
        const Index to = other.sorted[to_size(pair.*partner)];
        Index& best = nearest[to_size(i)];
        if (best < 0 || distance(i, to) < distance(i, best)) best = to;
    }
    return nearest;
}

/// The point nearest to an image, by the neighbors of one that lies near it; −1 where these may
/// lack it. Anything nearer than that one is less than twice as far from it as the image.
Index nearest_around(const MeasuredCloud& other, const Eigen::RowVector3d& image, Index near) {
    constexpr double kRounding = 1.0 + 1e-9, kLeast = 1e-12;  // in the unit ball
    const auto squared = [](const auto& here, const auto& there) {
        double sum = 0.0;  // axis by axis, as the tree does it
        for (int d = 0; d < 3; ++d) sum += (here[d] - there[d]) * (here[d] - there[d]);
        return sum;
    };
    const Eigen::RowVector3d middle = other.positions.row(near);
    Index best = near;
    double least = squared(image, middle);
    const double reach = std::sqrt(least);
    double farthest = kRounding * 2.0 * reach + kLeast;
    for (const Index j : other.near(near)) {
        const Eigen::RowVector3d place = other.positions.row(j);
        if (squared(place, middle) > farthest * farthest) return best;
        const double distance = squared(image, place);
        if (distance > least || (distance == least && j > best)) continue;
        best = j;
        least = distance;
        farthest = kRounding * (reach + std::sqrt(least)) + kLeast;
    }
    return -1;
}

/// The point of `other` nearest to an image on the partner's side of the surface, −1 for any side;
/// the nearest of all where none of the first few lies on that side.
Index foot_of(const MeasuredCloud& other, const Eigen::RowVector3d& image, Index partner) {
    constexpr double kBarelyMore = 1.0 + 1e-12, kLeast = 1e-150;  // a square that isn't 0
    std::array<Index, kFeet> feet{};
    std::array<double, kFeet> squared_distances{};
    const auto nearest = [&](std::size_t wanted, double radius) {
        const std::span<Index> found(feet.data(), wanted);
        const Index count = other.tree.nearest_within(image.data(), radius, found,
                                                      {squared_distances.data(), wanted});
        return found.first(to_size(count));
    };
    if (partner < 0) return nearest(1, std::numeric_limits<double>::infinity()).front();
    const auto same_side = [&](Index j) {
        return other.normals.row(j).dot(other.normals.row(partner)) > 0;
    };
    Index first = nearest_around(other, image, partner);
    if (first < 0) {
        // Nothing farther than the partner can be the nearest.
        const double distance = (other.positions.row(partner) - image).norm();
        first = nearest(1, std::max(kBarelyMore * distance, kLeast)).front();
    }
    if (same_side(first)) return first;
    const auto several = nearest(kFeet, std::numeric_limits<double>::infinity());
    const auto foot = std::ranges::find_if(several, same_side);
    return foot == several.end() ? first : *foot;
}

/// Every how many points the stretch of edges is kept.
Index edge_step(Index count) {
    return std::max<Index>(1, count / kMostCenters);
}

/// Two orthonormal vectors in the tangent plane at a point.
std::array<Vector3, 2> tangents(const MeasuredCloud& cloud, Index i) {
    const Vector3 normal = cloud.normal(i), a = normal.unitOrthogonal();
    return {a, normal.cross(a)};
}

/// Takes displacements in the tangent plane at a point to the image's.
Matrix3 jacobian(const MeasuredCloud& cloud, const MeasuredMap& map, Index i) {
    const auto [a, b] = tangents(cloud, i);
    const auto& [to_a, to_b] = map.slopes[to_size(i)];
    return to_a * a.transpose() + to_b * b.transpose();
}

/// Fits the Jacobian at one point to the images of its neighbors.
void fit_jacobian(const MeasuredCloud& cloud, const MeasuredCloud& other, Index i,
                  MeasuredMap& map) {
    constexpr double kRounded = 1e-5;  // of √area: the same place, as both sides of a seam are
    const double scale = cloud.root_area / other.root_area;
    const Index step = edge_step(cloud.size());
    const auto [a, b] = tangents(cloud, i);
    double aa = 0.0, ab = 0.0, bb = 0.0, energy = 0.0;
    Vector3 along_a = Vector3::Zero(), along_b = Vector3::Zero();
    Index used = 0;
    MeasuredMap::Slopes& slopes = map.slopes[to_size(i)];
    slopes = {Vector3::Zero(), Vector3::Zero()};
    for (const Index j : cloud.near(i)) {
        if (!cloud.same_side(i, j)) continue;
        const Vector3 step_here = cloud.positions.row(j) - cloud.positions.row(i);
        const Vector3 step_there = map.images.row(j) - map.images.row(i);
        const double length = step_here.norm();
        if (!(length > kRounded * cloud.root_area)) continue;
        const double stretch = scale * step_there.norm() / length;
        energy += stretch * stretch;
        if (i % step == 0) map.edges[to_size(i / step * kMeasuredNeighbors + used)] = stretch;
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
    slopes = {to_a, to_b};
    const auto [larger, smaller] = singular_values(to_a, to_b);
    map.points.stretch.row(i) << scale * larger, scale * smaller;
    map.points.measured[to_size(i)] = 1;
    map.points.flipped[to_size(i)] = to_a.cross(to_b).dot(other.normal(map.foot[to_size(i)])) < 0.0;
}

/// What measure() and find_reached() fill.
void make_room(Index count, MeasuredMap& map) {
    const Index step = edge_step(count);
    map.slopes.resize(to_size(count));
    map.foot.resize(to_size(count));
    map.edges.assign(to_size((count + step - 1) / step * kMeasuredNeighbors), -1.0);
    map.energy.setConstant(count, -1.0);
    map.points.stretch.setOnes(count, 2);
    map.points.measured.assign(to_size(count), 0);
    map.points.flipped.assign(to_size(count), 0);
    map.points.reached.assign(to_size(count), 0);
}

/// Fits the Jacobians and finds where the images lie.
void measure(const MeasuredCloud& cloud, const MeasuredCloud& other,
             std::span<const Index> partners, MeasuredMap& map, Progress& progress) {
    parallel_for(cloud.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            map.foot[to_size(i)] = foot_of(other, map.images.row(i), partners[to_size(i)]);
            fit_jacobian(cloud, other, i, map);
        }
    });
}

/// The round trip: there by `map`, back by `reverse`, between samples along the nearest one's
/// Jacobian.
void go_there_and_back(const MeasuredCloud& cloud, const MeasuredCloud& other,
                       const MeasuredMap& reverse, MeasuredMap& map, Progress& progress) {
    map.points.round_trip.resize(cloud.size());
    parallel_for(cloud.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const Index foot = map.foot[to_size(i)];
            const Vector3 off = (map.images.row(i) - other.positions.row(foot)).transpose();
            const Vector3 back =
                reverse.images.row(foot).transpose() + jacobian(other, reverse, foot) * off;
            map.points.round_trip[i] = (back - cloud.position(i)).norm() / cloud.root_area;
        }
    });
}

/// Which points of `cloud` the images of the other's points come near, as far as it takes no
/// search: the image of the partner, or of the point that their own image is next to, is near to
/// most, and the nearest image can't be farther. `partners`: one of the other's points for each, or
/// −1.
void find_reached(const MeasuredCloud& cloud, std::span<const Index> partners,
                  const MeasuredMap& reverse, MeasuredMap& map, Progress& progress) {
    std::vector<std::uint8_t>& reached = map.points.reached;
    parallel_for(cloud.size(), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const double limit = kReach * cloud.spacing[i];
            const auto is_near = [&](Index j) {
                return j >= 0 && (reverse.images.row(j) - cloud.positions.row(i)).squaredNorm() <=
                                     limit * limit;
            };
            reached[to_size(i)] = is_near(partners[to_size(i)]) || is_near(map.foot[to_size(i)]);
        }
    });
}

/// Points that find_reached() has left open, and the images that may be near.
struct OpenPoints {
    std::vector<Index> rows;
    std::optional<KdTree<3>> images;  ///< where there are rows
};

OpenPoints open_points(const MeasuredMap& map, const MeasuredMap& reverse) {
    OpenPoints open;
    for (std::size_t i = 0; i < map.points.reached.size(); ++i)
        if (!map.points.reached[i]) open.rows.push_back(to_index(i));
    if (!open.rows.empty()) open.images.emplace(reverse.images);
    return open;
}

/// Searches for the image nearest to each of the open points.
void find_reached(const MeasuredCloud& cloud, const MeasuredCloud& other, const OpenPoints& open,
                  MeasuredMap& map, Progress& progress) {
    std::vector<std::uint8_t>& reached = map.points.reached;
    const double scale = cloud.root_area / other.root_area;
    parallel_for(to_index(open.rows.size()), progress, [&](Index begin, Index end) {
        for (Index k = begin; k < end; ++k) {
            const Index i = open.rows[to_size(k)];
            Index nearest = 0;
            double squared_distance = 0.0;
            open.images->nearest(cloud.positions.row(i).data(), {&nearest, 1},
                                 {&squared_distance, 1});
            const double limit =
                kReach * std::max(cloud.spacing[i], scale * other.spacing[nearest]);
            reached[to_size(i)] = squared_distance <= limit * limit;
        }
    });
}

bool is_beyond(const MeasuredMap& map, Eigen::Index i) {
    return !map.beyond.empty() && map.beyond[to_size(i)] != 0;
}

/// The figures of a map; `other` is the reverse one.
void sum_up(const MeasuredMap& other, MeasuredMap& map) {
    const PointQuality& points = map.points;
    const auto count = points.stretch.rows();
    MapFigures& figures = map.figures;
    std::vector<double> values;
    values.reserve(to_size(count));
    double energy = 0.0;
    Index with_edges = 0, flipped = 0, collapsed = 0;
    for (Eigen::Index i = 0; i < count; ++i) {
        if (is_beyond(map, i)) continue;
        if (map.energy[i] >= 0.0) {
            energy += map.energy[i];
            ++with_edges;
        }
        if (!points.measured[to_size(i)]) continue;
        const double larger = std::max(points.stretch(i, 0), 1e-6);
        const double smaller = std::max(points.stretch(i, 1), 1e-6);
        values.push_back((larger / smaller + smaller / larger) / 2.0);  // conformal distortion
        flipped += points.flipped[to_size(i)];
        collapsed += points.stretch(i, 1) < kCollapsed * points.stretch(i, 0);
    }
    const auto share = [](Index part, std::size_t all) {
        return all > 0 ? part / static_cast<double>(all) : 0.0;
    };
    figures.dirichlet = with_edges > 0 ? energy / with_edges : 0.0;
    std::erase_if(map.edges, [](double stretch) { return stretch < 0.0; });
    figures.stretch_p99 = quantile(map.edges, 0.99);
    figures.flipped = share(flipped, values.size());
    figures.collapsed = share(collapsed, values.size());
    figures.conformal_median = quantile(values, 0.5);
    values.clear();
    for (Eigen::Index i = 0; i < count; ++i)
        if (!is_beyond(map, i)) values.push_back(points.round_trip[i]);
    const auto trips = static_cast<Eigen::Index>(values.size());
    figures.round_trip_mean = Eigen::Map<const Values>(values.data(), trips).sum() /
                              static_cast<double>(std::max<Eigen::Index>(trips, 1));
    figures.round_trip_p99 = quantile(values, 0.99);
    Index reached = 0, reachable = 0;
    for (Eigen::Index i = 0; i < other.points.round_trip.size(); ++i) {
        if (is_beyond(other, i)) continue;
        reached += other.points.reached[to_size(i)];
        ++reachable;
    }
    figures.coverage = share(reached, to_size(reachable));
}

void find_distortion(MeasuredMap& map, Progress& progress) {
    PointQuality& points = map.points;
    const bool mirrored = is_mirrored(map.figures);
    points.distortion.resize(points.round_trip.size());
    parallel_for(to_index(points.distortion.size()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            double value = std::max(strain(points.stretch(i, 0), points.stretch(i, 1)),
                                    points.round_trip[i] / kBadRoundTrip);
            if (!points.reached[to_size(i)]) value = std::max(value, kBad);
            if (points.measured[to_size(i)] && (points.flipped[to_size(i)] != 0) != mirrored)
                value = std::max(value, kFoldDistortion);
            points.distortion[i] = value;
        }
    });
}

/// As estimated_area(), but from all points, so that it doesn't depend on their order.
double whole_area(const Positions& positions, const Neighborhoods& nearest) {
    double area = 0.0;
    for (Index i = 0; i < nearest.size(); ++i) {
        const auto near =
            nearest[i].first(std::min<std::size_t>(kAreaNeighbors, nearest[i].size()));
        if (near.empty()) continue;
        area += std::numbers::pi * (positions.row(near.back()) - positions.row(i)).squaredNorm() /
                static_cast<double>(near.size());
    }
    if (area > 0.0) return area;
    return (positions.colwise().maxCoeff() - positions.colwise().minCoeff()).squaredNorm();
}

}  // namespace

MeasuredCloud::MeasuredCloud(const Cloud& cloud, const OrderedNeighbors& known)
    : neighbors(known),
      sorted(inverse_order(known.order)),
      unit(normalization(cloud.positions)),
      positions(unit.apply(gather(cloud.positions, known.order))),
      normals(gather(cloud.normals, known.order).rowwise().normalized()),
      root_area(std::sqrt(whole_area(positions, known.nearest))),
      spacing(local_spacing(positions, known.nearest)),
      tree(positions) {
    if (!(root_area > 0.0)) root_area = 1.0;
}

bool MeasuredCloud::same_side(Index i, Index j) const {
    return normals.row(i).dot(normals.row(j)) > kSameSide;
}

Positions MeasuredCloud::places_of(std::span<const Index> rows) const {
    return gather(positions, gather(sorted, rows));
}

std::vector<char> lie_at_ends(const Positions& images, const Positions& ends, double near,
                              Progress& progress) {
    if (ends.rows() == 0) return {};
    const KdTree<3> tree(ends);
    std::vector<char> result(to_size(images.rows()));
    parallel_for(to_index(result.size()), progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i)
            result[to_size(i)] = tree.any_within(images.row(i).data(), near);
    });
    return result;
}

BeyondPart beyond_part(const Positions& images, const Positions& ends, double near,
                       const Values& spacing, Progress& progress) {
    constexpr double kPart = 0.7;
    BeyondPart beyond{lie_at_ends(images, ends, near, progress)};
    double left = 0.0;
    for (std::size_t i = 0; i < beyond.rows.size(); ++i)
        if (beyond.rows[i] == 0) left += spacing[to_index(i)] * spacing[to_index(i)];
    const double all = spacing.squaredNorm();
    if (beyond.rows.empty() || !(left > 0.0) || !(left < kPart * all)) return {};
    beyond.left = left / all;
    return beyond;
}

namespace {

BeyondPart beyond_part(const MeasuredCloud& here, const MeasuredCloud& other,
                       const Positions& images, std::span<const Index> ends, Progress& progress) {
    if (ends.empty()) return {};
    return beyond_part(images, other.places_of(ends), kEndNear * other.root_area, here.spacing,
                       progress);
}

}  // namespace

MeasuredMaps measure_maps(MeasuredCloud& source, MeasuredCloud& target, const TwoWayMap& map,
                          Progress& progress) {
    MeasuredMaps maps;
    auto& [there, back] = maps;
    std::vector<Index> on_target, on_source;
    on_both(progress, [&](bool is_source, Progress&) {
        const MeasuredCloud &here = is_source ? source : target,
                            &other = is_source ? target : source;
        MeasuredMap& ours = is_source ? there : back;
        make_room(here.size(), ours);
        Positions& images = ours.images;
        images = other.unit.apply(
            gather(is_source ? map.source_images : map.target_images, here.neighbors.order));
        const auto row = is_source ? &IndexPair::source : &IndexPair::target;
        const auto partner = is_source ? &IndexPair::target : &IndexPair::source;
        (is_source ? on_target : on_source) =
            nearest_partners(map.pairs, here, images, other, row, partner);
    });
    BeyondPart on_either[] = {beyond_part(source, target, there.images, map.target_ends, progress),
                              beyond_part(target, source, back.images, map.source_ends, progress)};
    source.root_area *= std::sqrt(on_either[0].left);
    target.root_area *= std::sqrt(on_either[1].left);
    there.beyond = std::move(on_either[0].rows);
    back.beyond = std::move(on_either[1].rows);
    // Every pass fills something that the next ones need of both maps.
    const auto both = [&](double first, double last, auto&& pass) {
        const Progress::Part part(progress, first, last);
        {
            const Progress::Part half(progress, 0.0, 0.5);
            pass(source, target, there, back);
        }
        const Progress::Part half(progress, 0.5, 1.0);
        pass(target, source, back, there);
    };
    using Here = const MeasuredCloud&;
    using Map = MeasuredMap&;
    both(0.0, 0.5, [&](Here here, Here other, Map ours, Map) {
        measure(here, other, &here == &source ? on_target : on_source, ours, progress);
    });
    both(0.5, 0.6, [&](Here here, Here other, Map ours, Map theirs) {
        go_there_and_back(here, other, theirs, ours, progress);
    });
    for (MeasuredMap* one : {&there, &back})  // the largest of what is found, and needed no more
        one->slopes = std::vector<MeasuredMap::Slopes>();  // {} would keep the memory
    both(0.6, 0.7, [&](Here here, Here, Map ours, Map theirs) {
        find_reached(here, &here == &source ? on_target : on_source, theirs, ours, progress);
    });
    {
        OpenPoints of_source, of_target;
        on_both(progress, [&](bool is_source, Progress&) {
            (is_source ? of_source : of_target) =
                open_points(is_source ? there : back, is_source ? back : there);
        });
        both(0.7, 0.9, [&](Here here, Here other, Map ours, Map) {
            find_reached(here, other, &here == &source ? of_source : of_target, ours, progress);
        });
    }
    on_both(progress, [&](bool is_source, Progress&) {
        sum_up(is_source ? back : there, is_source ? there : back);
    });
    both(0.9, 1.0, [&](Here, Here, Map ours, Map) { find_distortion(ours, progress); });
    return maps;
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

double quantile(std::span<const double> values, double share) {
    if (values.empty()) return 0.0;
    const auto place = [share](std::size_t count) {
        return share * static_cast<double>(count - 1);
    };
    const auto nth = static_cast<std::size_t>(place(values.size()));
    const auto find = [](std::vector<double>& among, std::size_t number) {
        const auto at = among.begin() + static_cast<std::ptrdiff_t>(number);
        std::ranges::nth_element(among, at);
        return *at;
    };
    constexpr double kFarthest = std::numeric_limits<double>::infinity();
    constexpr std::size_t kEvery = 32, kWorthIt = 100 * kEvery;
    // Of many, a few say between which bounds it almost surely lies.
    if (values.size() > kWorthIt) {
        std::vector<double> some;
        for (std::size_t i = 0; i < values.size(); i += kEvery) some.push_back(values[i]);
        constexpr double kDeviations = 4.0;
        const double margin = kDeviations * std::sqrt(static_cast<double>(some.size())) / 2.0;
        const double low = place(some.size()) - margin, high = place(some.size()) + margin;
        const double least = low < 0.0 ? -kFarthest : find(some, static_cast<std::size_t>(low));
        const double most = high > static_cast<double>(some.size() - 1)
                                ? kFarthest
                                : find(some, static_cast<std::size_t>(high));
        std::size_t below = 0;
        std::vector<double> between;
        for (const double value : values) {
            below += value < least ? 1 : 0;
            if (value >= least && value <= most) between.push_back(value);
        }
        if (nth >= below && nth - below < between.size()) return find(between, nth - below);
    }
    std::vector<double> all(values.begin(), values.end());
    return find(all, nth);
}

}  // namespace pointmorph
