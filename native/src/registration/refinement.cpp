#include "pointmorph/registration/refinement.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <map>
#include <optional>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/registration/prolongation.hpp"
#include "pointmorph/surface/projection.hpp"

namespace pointmorph {

namespace {

constexpr double kHardRegion = 10.0;  // weight that a hard region has at least
constexpr double kSoftLabel = 1.0;    // spacings between points inside and outside when paired

/// A similarity after which the cloud has area 1 and its mean at the origin.
Similarity to_unit_area(const Positions& positions, const Neighborhoods* nearest) {
    Similarity result;
    const double area =
        nearest ? estimated_area(positions, *nearest) : estimated_area(KdTree<3>(positions));
    if (area > 0.0) result.scale = 1.0 / std::sqrt(area);
    result.translation = -result.scale * positions.colwise().mean().transpose();
    return result;
}

/// A curve on both shapes, as many places on either, at the same shares of the length.
struct CurvePlaces {
    Positions source, target;
    Normals source_normals, target_normals;
};

/// What the features mark on both shapes.
struct Marks {
    struct Curve {
        TracedCurve source, target;
        bool hard;
        double weight;
    };
    struct Region {
        const Feature* feature;
        IndexPair seats;  ///< a row in the middle of either side
    };
    std::vector<IndexPair> pinned;
    std::vector<const Feature*> soft_points;
    std::vector<Curve> curves;
    std::vector<Region> regions;
    /// Rows that belong together, roughly, which show the pose: points, some of each curve, and the
    /// middles of regions.
    std::vector<IndexPair> rough;
    Index points = 0;  ///< of `rough`
};

/// The row of a region that is nearest to its weighted mean, among those of half the largest
/// weight.
Index seat_of(const Marked& marked, const Positions& positions) {
    Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
    double sum = 0.0, largest = 0.0;
    for (std::size_t i = 0; i < marked.rows.size(); ++i) {
        mean += marked.weight(i) * positions.row(marked.rows[i]);
        sum += marked.weight(i);
        largest = std::max(largest, marked.weight(i));
    }
    mean /= sum;
    Index seat = -1;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < marked.rows.size(); ++i) {
        const double squared = (positions.row(marked.rows[i]) - mean).squaredNorm();
        if (marked.weight(i) < 0.5 * largest || squared >= nearest) continue;
        nearest = squared;
        seat = marked.rows[i];
    }
    return seat;
}

/// Features in canonical order; the trees hold the positions.
Marks marks_of(std::span<const Feature> features, const KdTree<3>* source,
               const Normals& source_normals, const KdTree<3>* target,
               const Normals& target_normals, Progress& progress) {
    constexpr Index kRoughPlaces = 9;  // of a curve
    Marks marks;
    marks.pinned = pinned_pairs(features);
    for (const Feature& f : features) {
        const IndexPair first{f.source.rows.front(), f.target.rows.front()};
        if (f.kind == FeatureKind::kPoint) {
            if (!f.hard) marks.soft_points.push_back(&f);
            marks.rough.push_back(first);
            ++marks.points;
        } else if (f.kind == FeatureKind::kCurve) {
            const auto& curve = marks.curves.emplace_back(Marks::Curve{
                trace_curve(*source, source_normals, f.source.rows, f.closed, progress),
                trace_curve(*target, target_normals, f.target.rows, f.closed, progress), f.hard,
                f.weight});
            for (Index k = 0; k < kRoughPlaces; ++k) {
                const double share = static_cast<double>(k) / (kRoughPlaces - (f.closed ? 0 : 1));
                const auto row = [&](const TracedCurve& traced, const KdTree<3>& tree,
                                     const Normals& normals) {
                    return nearest_on_sheet(tree, normals, traced.at(share).transpose(),
                                            traced.normals.row(traced.before(share)));
                };
                marks.rough.push_back({row(curve.source, *source, source_normals),
                                       row(curve.target, *target, target_normals)});
            }
        } else {
            const IndexPair seats{seat_of(f.source, source->points()),
                                  seat_of(f.target, target->points())};
            marks.regions.push_back({&f, seats});
            marks.rough.push_back(seats);
        }
    }
    return marks;
}

/// Positions of the rows that belong together.
std::pair<Positions, Positions> places_of(const Positions& source, const Positions& target,
                                          std::span<const IndexPair> features) {
    Positions s(static_cast<Eigen::Index>(features.size()), 3), t = s;
    for (std::size_t k = 0; k < features.size(); ++k) {
        s.row(static_cast<Eigen::Index>(k)) = source.row(features[k].source);
        t.row(static_cast<Eigen::Index>(k)) = target.row(features[k].target);
    }
    return {std::move(s), std::move(t)};
}

/// The target onto the source by the features.
Similarity feature_alignment(const Positions& source, const Positions& target,
                             std::span<const IndexPair> features) {
    const auto [s, t] = places_of(source, target, features);
    if (features.size() >= 3) return fit_similarity(t, s);
    Similarity shift;
    if (!features.empty())
        shift.translation = (s.colwise().mean() - t.colwise().mean()).transpose();
    return shift;
}

/// Whether places lie on no line, by a margin.
bool spread_out(const Positions& places) {
    constexpr double kSpread = 0.05;  // root mean square off the line, in √area
    const Positions centered = places.rowwise() - places.colwise().mean();
    const Matrix3 covariance = centered.transpose() * centered / static_cast<double>(places.rows());
    const Eigen::SelfAdjointEigenSolver<Matrix3> solver(covariance, Eigen::EigenvaluesOnly);
    return solver.eigenvalues()[1] > kSpread * kSpread;
}

TracedCurve moved(TracedCurve curve, const Similarity& move) {
    curve.places = move.apply(curve.places);
    curve.normals = move.rotated(curve.normals);
    for (double& length : curve.lengths) length *= move.scale;
    return curve;
}

/// Evenly spaced, no further apart than `spacing` on the longer side.
CurvePlaces places_along(const Marks::Curve& curve, double spacing) {
    const double length = std::max(curve.source.length(), curve.target.length());
    const bool closed = curve.source.closed;
    const auto steps = std::max<Eigen::Index>(closed ? 3 : 1, std::lround(length / spacing));
    const Eigen::Index count = steps + (closed ? 0 : 1);
    CurvePlaces places{Positions(count, 3), Positions(count, 3), Normals(count, 3),
                       Normals(count, 3)};
    for (Eigen::Index k = 0; k < count; ++k) {
        const double share = static_cast<double>(k) / static_cast<double>(steps);
        places.source.row(k) = curve.source.at(share).transpose();
        places.target.row(k) = curve.target.at(share).transpose();
        places.source_normals.row(k) = curve.source.normals.row(curve.source.before(share));
        places.target_normals.row(k) = curve.target.normals.row(curve.target.before(share));
    }
    return places;
}

/// Guides of both shapes: soft points, curves, and regions' middles, which only show the pose.
void add_guides(CoarseShape& source, CoarseShape& target, const Marks& marks,
                const RefinementOptions& options) {
    // Nodes are about this far apart where the deformation is finest.
    const double node_spacing = 1.0 / std::sqrt(static_cast<double>(options.coarse.nodes.back()));
    std::vector<CurvePlaces> places;
    std::vector<double> weights;
    const auto add_rows = [&](Index s, Index t, double weight) {
        const auto place = [](const CoarseShape& shape, Index row) {
            return std::ranges::find(shape.rows, row) - shape.rows.begin();
        };
        const auto i = place(source, s), j = place(target, t);
        places.push_back({source.positions.row(i), target.positions.row(j), source.normals.row(i),
                          target.normals.row(j)});
        weights.push_back(weight);
    };
    for (const Feature* f : marks.soft_points)
        add_rows(f->source.rows.front(), f->target.rows.front(),
                 options.registration.soft_weight * f->weight);
    for (const auto& region : marks.regions)
        add_rows(region.seats.source, region.seats.target, 0.0);
    for (const auto& curve : marks.curves) {
        CurvePlaces along = places_along(curve, 0.5 * node_spacing);
        const double length = std::max(curve.source.length(), curve.target.length());
        const double strength = curve.hard ? options.registration.feature_weight
                                           : options.registration.soft_weight * curve.weight;
        const double part = length / node_spacing / static_cast<double>(along.source.rows());
        weights.insert(weights.end(), to_size(along.source.rows()), strength * std::min(1.0, part));
        places.push_back(std::move(along));
    }
    if (places.empty()) return;
    const auto fill = [&](CoarseShape& shape, Positions CurvePlaces::*positions,
                          Normals CurvePlaces::*normals) {
        const KdTree<3> tree(shape.positions);
        Guides& guides = shape.guides;
        guides.weights =
            Eigen::Map<const Values>(weights.data(), static_cast<Eigen::Index>(weights.size()));
        guides.places.resize(guides.weights.size(), 3);
        for (const CurvePlaces& part : places)
            for (Eigen::Index k = 0; k < (part.*positions).rows(); ++k) {
                guides.places.row(guides.size()) = (part.*positions).row(k);
                guides.rows.push_back(nearest_on_sheet(
                    tree, shape.normals, (part.*positions).row(k), (part.*normals).row(k)));
            }
    };
    fill(source, &CurvePlaces::source, &CurvePlaces::source_normals);
    fill(target, &CurvePlaces::target, &CurvePlaces::target_normals);
}

/// A column for each region: how far every one of `count` points belongs to it.
Labels memberships(std::span<const Marks::Region> regions, Index count, Marked Feature::*side) {
    Labels labels = Labels::Zero(count, Labels::ColsAtCompileTime);
    for (std::size_t r = 0; r < regions.size(); ++r) {
        const Marked& marked = regions[r].feature->*side;
        for (std::size_t i = 0; i < marked.rows.size(); ++i)
            labels(marked.rows[i], static_cast<Eigen::Index>(r)) = marked.weight(i);
    }
    return labels;
}

/// Labels of the coarse points, and how much their matches pull.
void add_labels(CoarseShape& shape, const Labels& members, std::span<const Marks::Region> regions,
                const RegistrationOptions& options) {
    if (regions.empty()) return;
    shape.labels = gather(members, shape.rows);
    shape.pulls = Values::Zero(shape.size());
    for (std::size_t r = 0; r < regions.size(); ++r) {
        const Feature& f = *regions[r].feature;
        auto label = shape.labels.col(static_cast<Eigen::Index>(r));
        const double weight = f.hard ? std::max(kHardRegion, f.weight) : f.weight;
        shape.pulls += options.region_weight * weight * label;
        label *= options.label_distance * std::min(1.0, weight);
    }
}

/// Farthest that a feature's image lies from its partner.
double largest_offset(const Positions& images, const Positions& other,
                      std::span<const IndexPair> features, Index IndexPair::*from,
                      Index IndexPair::*to) {
    double largest = 0.0;
    for (const IndexPair& f : features)
        largest = std::max(largest, (images.row(f.*from) - other.row(f.*to)).norm());
    return largest;
}

/// Moves images so that features and guides come to lie near their partners, with everything
/// around: offsets averaged with Gaussian weights that fall with the distance (Shepard's method,
/// fading out).
void pull_to_features(Positions& images, const CoarseShape& shape, const CoarseShape& other,
                      std::span<const IndexPair> features, Index IndexPair::*from,
                      Index IndexPair::*to) {
    constexpr double kReach = 0.15;  // of √area
    std::vector<Eigen::RowVector3d> centers, offsets;
    for (const IndexPair& f : features) {
        centers.emplace_back(shape.positions.row(f.*from));
        offsets.emplace_back(other.positions.row(f.*to) - images.row(f.*from));
    }
    for (Index k = 0; k < shape.guides.size(); ++k) {
        if (!(shape.guides.weights[k] > 0.0)) continue;
        centers.emplace_back(shape.guides.places.row(k));
        offsets.emplace_back(other.guides.places.row(k) -
                             images.row(shape.guides.rows[to_size(k)]));
    }
    for (Eigen::Index i = 0; i < images.rows(); ++i) {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        double weights = 0.0;
        for (std::size_t k = 0; k < centers.size(); ++k) {
            const double squared = (shape.positions.row(i) - centers[k]).squaredNorm();
            const double weight = std::exp(-0.5 * squared / (kReach * kReach));
            sum += weight * offsets[k];
            weights += weight;
        }
        images.row(i) += sum / std::max(weights, 1.0);
    }
}

/// Volume that the oriented points enclose, if they do.
double signed_volume(const CoarseShape& shape) {
    const Eigen::RowVector3d center = shape.positions.colwise().mean();
    return ((shape.positions.rowwise() - center).cwiseProduct(shape.normals).rowwise().sum())
               .dot(shape.areas) /
           3.0;
}

/// Mean agreement of the normals of source points, where they start, with the nearest target
/// points': about 1 for the same shape, below 0 where one is inside out.
double normal_agreement(const CoarseShape& source, const CoarseShape& target,
                        const Positions& start) {
    const KdTree<3> tree(target.positions);
    double sum = 0.0;
    for (Index i = 0; i < source.size(); ++i) {
        Index nearest;
        double squared;
        tree.nearest(start.row(i).data(), {&nearest, 1}, {&squared, 1});
        sum += source.normals.row(i).dot(target.normals.row(nearest));
    }
    return sum / source.size();
}

/// Whether the normals of one cloud face outwards and those of the other inwards: told from the
/// volumes where both clouds enclose one, else from how the normals agree.
bool inside_out(const CoarseShape& source, const CoarseShape& target, const Positions& start) {
    constexpr double kSomeVolume = 0.005;  // of a unit area; a ball has 0.09
    const double s = signed_volume(source), t = signed_volume(target);
    if (std::min(std::abs(s), std::abs(t)) > kSomeVolume) return s * t < 0.0;
    return normal_agreement(source, target, start) < 0.0;
}

/// Moves the images of features onto their partners, and those around smoothly with them: by
/// (1 − (d/r)²)² of the offset within r, some spacings.
void pin_features(Positions& images, const Positions& positions, const Positions& other,
                  std::span<const IndexPair> features, Index IndexPair::*from, Index IndexPair::*to,
                  double spacing) {
    constexpr double kReach = 6.0;
    const double squared_reach = kReach * kReach * spacing * spacing;
    for (const IndexPair& f : features) {
        const Eigen::RowVector3d offset = other.row(f.*to) - images.row(f.*from);
        const Eigen::RowVector3d center = positions.row(f.*from);
        for (Eigen::Index i = 0; i < images.rows(); ++i) {
            const double ratio = (positions.row(i) - center).squaredNorm() / squared_reach;
            if (ratio < 1.0) images.row(i) += (1.0 - ratio) * (1.0 - ratio) * offset;
        }
    }
    // Features close to each other have pulled at one another.
    for (const IndexPair& f : features) images.row(f.*from) = other.row(f.*to);
}

/// Moves the images of a curve's places onto the other's, and those around smoothly with them, in
/// ever smaller surroundings: what lies beside it a little later, itself to the last. `linear` says
/// how the surroundings of a row have turned and grown.
template <std::invocable<Index> Linear>
void pin_curve(Positions& images, const KdTree<3>& tree, const Normals& normals, Linear&& linear,
               const Positions& own, const Normals& own_normals, const Positions& other,
               double spacing) {
    constexpr std::size_t kAround = 4;
    constexpr double kFloor = 1e-3;  // of a squared spacing
    const Positions& positions = tree.points();
    std::array<Index, kAround> near;
    std::array<double, kAround> squared;
    std::vector<std::pair<Index, double>> ball;
    for (const double reach : {6.0, 3.0, 1.5, 1.5}) {
        struct Pulled {
            Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
            double weights = 0.0, fade = 0.0;
        };
        std::map<Index, Pulled> pulled;
        const double radius = reach * spacing;
        for (Eigen::Index k = 0; k < own.rows(); ++k) {
            const Index found = tree.nearest(own.row(k).data(), near, squared);
            Vector3 image = Vector3::Zero();
            double weights = 0.0;
            for (std::size_t n = 0; n < to_size(found); ++n) {
                const Index i = near[n];
                if (normals.row(i).dot(own_normals.row(k)) <= 0.0) continue;
                const double weight = 1.0 / (squared[n] + kFloor * spacing * spacing);
                image += weight * (images.row(i).transpose() +
                                   linear(i) * (own.row(k) - positions.row(i)).transpose());
                weights += weight;
            }
            if (!(weights > 0.0)) continue;
            const Eigen::RowVector3d offset = other.row(k) - image.transpose() / weights;
            tree.within(own.row(k).data(), radius, ball);
            for (const auto& [i, squared_distance] : ball) {
                if (normals.row(i).dot(own_normals.row(k)) <= 0.0) continue;
                const double fade = std::pow(1.0 - squared_distance / (radius * radius), 2);
                Pulled& p = pulled[i];
                p.sum += fade * fade * offset;
                p.weights += fade * fade;
                p.fade = std::max(p.fade, fade);
            }
        }
        for (const auto& [i, p] : pulled)
            if (p.weights > 0.0) images.row(i) += p.fade * p.sum / p.weights;
    }
}

/// Puts images of a region's points that lie outside of the partner onto its nearest point.
/// `members` and `other_members` say how much points belong to the region.
void clamp_to_region(Positions& images, const Values& members, const KdTree<3>& other,
                     const Values& other_members) {
    constexpr double kMember = 0.5;
    std::vector<Index> inside;
    const double least = kMember * members.maxCoeff();
    const double other_least = kMember * other_members.maxCoeff();
    for (Index j = 0; j < other.size(); ++j)
        if (other_members[j] >= other_least) inside.push_back(j);
    const Positions places = gather(other.points(), inside);
    const KdTree<3> tree(places);
    for (Eigen::Index i = 0; i < images.rows(); ++i) {
        if (members[i] < least) continue;
        Index nearest;
        double squared;
        other.nearest(images.row(i).data(), {&nearest, 1}, {&squared, 1});
        if (other_members[nearest] >= other_least) continue;
        tree.nearest(images.row(i).data(), {&nearest, 1}, {&squared, 1});
        images.row(i) = places.row(nearest);
    }
}

/// The nearest of each row's partners.
std::vector<Index> nearest_partners(const Positions& images, const Pairing& pairs,
                                    Index IndexPair::*from, Index IndexPair::*to,
                                    const Positions& other) {
    const auto count = to_size(static_cast<Index>(images.rows()));
    std::vector<Index> partners(count, -1);
    std::vector<double> best(count, std::numeric_limits<double>::infinity());
    for (const IndexPair& pair : pairs) {
        const Index i = pair.*from, j = pair.*to;
        const double squared = (images.row(i) - other.row(j)).squaredNorm();
        if (squared >= best[to_size(i)]) continue;
        best[to_size(i)] = squared;
        partners[to_size(i)] = j;
    }
    return partners;
}

}  // namespace

Refinement refine(const Positions& source, const Normals& source_normals, const Positions& target,
                  const Normals& target_normals, std::span<const Feature> features,
                  const RefinementOptions& options, Progress& progress,
                  const RefinementStart* given, const KnownNeighborhoods& known) {
    Refinement result;
    progress.enter("coarse shapes");
    Similarity source_unit, target_move;
    on_both(progress, [&](bool is_source, Progress&) {
        (is_source ? source_unit : target_move) =
            to_unit_area(is_source ? source : target, is_source ? known.source : known.target);
    });
    const Positions s = source_unit.apply(source);
    Positions t = target_move.apply(target);
    std::optional<KdTree<3>> source_tree, target_tree;
    if (std::ranges::any_of(features,
                            [](const Feature& f) { return f.kind != FeatureKind::kPoint; }))
        on_both(progress, [&](bool is_source, Progress&) {
            (is_source ? source_tree : target_tree).emplace(is_source ? s : t);
        });
    Marks marks = marks_of(features, source_tree ? &*source_tree : nullptr, source_normals,
                           target_tree ? &*target_tree : nullptr, target_normals, progress);
    const auto& pinned = marks.pinned;
    if (given) {
        const double largest =
            std::max(source_unit.scale * largest_offset(given->target_images, source, marks.rough,
                                                        &IndexPair::target, &IndexPair::source),
                     target_move.scale * largest_offset(given->source_images, target, marks.rough,
                                                        &IndexPair::source, &IndexPair::target));
        if (largest > options.trusted_distance) given = nullptr;
    }
    const Index enough = std::max<Index>(options.features_that_fix_the_pose, 3);
    const auto fixed_by_all = [&] {
        const auto [on_source, on_target] = places_of(s, t, marks.rough);
        return spread_out(on_source) && spread_out(on_target);
    };
    const bool pose_is_known = given || marks.points >= enough ||
                               (static_cast<Index>(marks.rough.size()) >= enough && fixed_by_all());
    Similarity turn;
    if (given)
        turn = fit_similarity(t, source_unit.apply(given->target_images));
    else if (pose_is_known)
        turn = feature_alignment(s, t, marks.rough);
    target_move = composed(turn, target_move);
    t = target_move.apply(target);
    Normals tn = target_move.rotated(target_normals);
    for (auto& curve : marks.curves) curve.target = moved(std::move(curve.target), turn);

    std::vector<Index> source_required, target_required;
    std::vector<IndexPair> coarse_features;
    const auto require = [](std::vector<Index>& rows, Index row) {
        const auto found = std::ranges::find(rows, row);
        const auto place = static_cast<Index>(found - rows.begin());
        if (found == rows.end()) rows.push_back(row);
        return place;
    };
    for (const IndexPair& f : pinned)
        coarse_features.push_back(
            {require(source_required, f.source), require(target_required, f.target)});
    for (const Feature* f : marks.soft_points) {
        require(source_required, f->source.rows.front());
        require(target_required, f->target.rows.front());
    }
    for (const auto& region : marks.regions) {
        require(source_required, region.seats.source);
        require(target_required, region.seats.target);
    }
    CoarseShape coarse_source, coarse_target;
    on_both(progress, [&](bool is_source, Progress& p) {
        if (is_source)
            coarse_source =
                coarse_shape(source_tree ? *source_tree : source_tree.emplace(s), source_normals,
                             source_required, options.coarse, p, known.source);
        else
            coarse_target = coarse_shape(target_tree.emplace(t), tn, target_required,
                                         options.coarse, p, known.target);
    });
    add_guides(coarse_source, coarse_target, marks, options);
    Labels source_members, target_members;
    if (!marks.regions.empty()) {
        source_members = memberships(marks.regions, static_cast<Index>(s.rows()), &Feature::source);
        target_members = memberships(marks.regions, static_cast<Index>(t.rows()), &Feature::target);
    }
    add_labels(coarse_source, source_members, marks.regions, options.registration);
    add_labels(coarse_target, target_members, marks.regions, options.registration);

    RegistrationStart start = thin_plate_start(coarse_source, coarse_target, coarse_features);
    if (given) {
        start = {target_move.apply(gather(given->source_images, coarse_source.rows)),
                 source_unit.apply(gather(given->target_images, coarse_target.rows))};
        pull_to_features(start.source, coarse_source, coarse_target, coarse_features,
                         &IndexPair::source, &IndexPair::target);
        pull_to_features(start.target, coarse_target, coarse_source, coarse_features,
                         &IndexPair::target, &IndexPair::source);
    }
    if (inside_out(coarse_source, coarse_target, start.source)) {
        result.inside_out = true;
        tn = -tn;
        coarse_target.normals = -coarse_target.normals;
    }
    std::optional<Pose> pose;
    CoarseShape target_at_rest;
    if (!pose_is_known) {
        progress.enter("pose");
        pose = find_pose(coarse_source, coarse_target, coarse_features, options.pose,
                         options.registration, progress);
        const Similarity& move = pose->best.alignment;
        target_at_rest = std::exchange(coarse_target, moved(coarse_target, move));
        t = move.apply(t);
        for (auto& curve : marks.curves) curve.target = moved(std::move(curve.target), move);
        target_tree.emplace(t);
        tn = move.rotated(tn);
        target_move = composed(move, target_move);
    }
    result.alignment = composed(source_unit.inverse(), target_move);

    progress.enter("registration");
    RegistrationOptions first_registration = options.registration;
    // As stiff as from the features alone, few of them would move legs that lie well.
    if (given) first_registration.levels.front() = options.pose.relaxation;
    const Registration registration = [&] {
        // The search has compared other maps already, and more of them.
        if (pose) {
            const Candidate& best = pose->best;
            result.diagnostics.starts = {{"pose", best.torn, best.misfit.energy()}};
            return best.registration;
        }
        Attempts attempts = register_best(
            coarse_source, coarse_target, coarse_features, given ? "earlier map" : "features",
            register_shapes(coarse_source, coarse_target, coarse_features, start,
                            first_registration, progress),
            options.attempts, options.registration, progress);
        result.diagnostics.starts = std::move(attempts.tried);
        result.diagnostics.start_taken = attempts.taken;
        return std::move(attempts.registration);
    }();

    if (pose) {
        result.diagnostics.margin = pose->margin;
        result.diagnostics.confidence = pose->confidence;
        result.diagnostics.rivals = describe_rivals(coarse_source, target_at_rest, *pose);
    }
    if (options.propose || pose) {
        const auto tips = [&](const CoarseShape& shape) {
            return extremities(shape, node_distances(shape), options.pose.extremities);
        };
        std::vector<IndexPair> marked = coarse_features;
        for (std::size_t k = 0; k < coarse_source.guides.rows.size(); ++k)
            marked.push_back({coarse_source.guides.rows[k], coarse_target.guides.rows[k]});
        result.diagnostics.proposals =
            propose_features(coarse_source, coarse_target, registration,
                             pose ? pose->source_tips : tips(coarse_source),
                             pose ? pose->target_tips : tips(coarse_target), marked,
                             result.diagnostics.confidence, options.other_proposals, progress);
        result.diagnostics = result.diagnostics.with_rows(coarse_source.rows, coarse_target.rows);
    }

    progress.enter("lift");
    const Prolongation source_lift(coarse_source, s, source_normals, progress);
    const Prolongation target_lift(coarse_target, t, tn, progress);
    OrientedPoints x =
        source_lift(coarse_source, registration.source_points, s, source_normals, progress);
    OrientedPoints y = target_lift(coarse_target, registration.target_points, t, tn, progress);
    const double source_spacing = 1.0 / std::sqrt(static_cast<double>(s.rows()));
    const double target_spacing = 1.0 / std::sqrt(static_cast<double>(t.rows()));
    for (const auto& curve : marks.curves) {
        if (!curve.hard) continue;
        const CurvePlaces along =
            places_along(curve, 0.5 * std::min(source_spacing, target_spacing));
        pin_curve(
            x.positions, *source_tree, source_normals,
            [&](Index i) { return source_lift.linear(i, registration.source_points); },
            along.source, along.source_normals, along.target, source_spacing);
        pin_curve(
            y.positions, *target_tree, tn,
            [&](Index i) { return target_lift.linear(i, registration.target_points); },
            along.target, along.target_normals, along.source, target_spacing);
    }
    pin_features(x.positions, s, t, pinned, &IndexPair::source, &IndexPair::target, source_spacing);
    pin_features(y.positions, t, s, pinned, &IndexPair::target, &IndexPair::source, target_spacing);

    progress.enter("product space");
    constexpr double kReferencePoints = 1e4;
    const double weight =
        options.normal_weight * std::min(1.0, std::sqrt(kReferencePoints) * source_spacing);
    result.source_product = product_points(x.positions, s, x.normals, source_normals, weight);
    result.target_product = product_points(t, y.positions, tn, y.normals, weight);
    if (marks.regions.empty()) {
        result.pairs =
            mutual_pairs<12>(result.source_product, result.target_product, pinned, progress);
    } else {
        Values scales(static_cast<Eigen::Index>(Labels::ColsAtCompileTime));
        scales.setZero();
        for (std::size_t r = 0; r < marks.regions.size(); ++r)
            scales[static_cast<Eigen::Index>(r)] =
                marks.regions[r].feature->hard ? 1.0 : kSoftLabel * source_spacing;
        result.pairs = mutual_pairs<32>(
            labelled_points(result.source_product, source_members * scales.asDiagonal()),
            labelled_points(result.target_product, target_members * scales.asDiagonal()), pinned,
            progress);
    }

    progress.enter("landing");
    x.positions = project_onto_surface(
        x.positions,
        nearest_partners(x.positions, result.pairs, &IndexPair::source, &IndexPair::target, t),
        *target_tree, tn, progress, known.target);
    y.positions = project_onto_surface(
        y.positions,
        nearest_partners(y.positions, result.pairs, &IndexPair::target, &IndexPair::source, s),
        *source_tree, source_normals, progress, known.source);
    for (std::size_t r = 0; r < marks.regions.size(); ++r) {
        if (!marks.regions[r].feature->hard) continue;
        const auto column = static_cast<Eigen::Index>(r);
        clamp_to_region(x.positions, source_members.col(column), *target_tree,
                        target_members.col(column));
        clamp_to_region(y.positions, target_members.col(column), *source_tree,
                        source_members.col(column));
    }
    result.source_images = target_move.inverse().apply(x.positions);
    result.target_images = source_unit.inverse().apply(y.positions);
    for (const IndexPair& f : pinned) {
        result.source_images.row(f.source) = target.row(f.target);
        result.target_images.row(f.target) = source.row(f.source);
    }
    progress.finish();
    return result;
}

}  // namespace pointmorph
