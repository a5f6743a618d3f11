#include "pointmorph/disk/network.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "checks.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/covariance.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/morph/network_preview.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

using Places = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

/// A torus, bumpy for `bump` > 0, and the two angles of each point.
struct Torus {
    Positions positions;
    Places angles;

    Torus(Index count, double tube, double bump, unsigned seed)
        : positions(count, 3), angles(count, 2) {
        std::mt19937_64 random(seed);
        std::uniform_real_distribution<double> uniform(0.0, 1.0);
        for (Index i = 0; i < count;) {
            const double a = 2 * std::numbers::pi * uniform(random),
                         b = 2 * std::numbers::pi * uniform(random);
            if (uniform(random) * (1 + tube) > 1 + tube * std::cos(b)) continue;
            const double thick = tube * (1 + bump * std::cos(3 * a));
            const double r = 1 + thick * std::cos(b);
            angles.row(i) << a, b;
            positions.row(i++) << r * std::cos(a), r * std::sin(a), thick * std::sin(b);
        }
    }

    Index at(double a, double b) const {
        Index row;
        (angles.rowwise() - Eigen::RowVector2d(a, b))
            .unaryExpr([](double d) { return std::remainder(d, 2 * std::numbers::pi); })
            .rowwise()
            .squaredNorm()
            .minCoeff(&row);
        return row;
    }
};

Cloud cloud_of(const char* name, Positions positions) {
    Cloud cloud;
    cloud.name = name;
    cloud.positions = std::move(positions);
    return cloud;
}

/// Two tori with `along` times `across` features: "2.1" is the third one round the hole and the
/// second one round the tube.
struct TwoTori {
    Torus source, target;
    MorphInput input;

    TwoTori(Index along, Index across) : source(3000, 0.4, 0.0, 1), target(2500, 0.35, 0.3, 2) {
        input.source = cloud_of("ring", source.positions);
        input.target = cloud_of("bumpy ring", target.positions);
        for (Index i = 0; i < along; ++i)
            for (Index j = 0; j < across; ++j) {
                const double a = 2 * std::numbers::pi * i / along + 0.2 * j,
                             b = 2 * std::numbers::pi * j / across;
                input.features.push_back(point_feature(std::to_string(i) + "." + std::to_string(j),
                                                       source.at(a, b), target.at(a, b)));
            }
    }
};

MorphOptions paper() {
    MorphOptions options;
    options.method = Method::kPaper;
    options.decomposition.points = 1500;
    return options;
}

/// What holds of every network: Euler's number, every side of every curve next to one patch, none
/// on both of its sides, and ends of curves at the features.
void expect_disks(const NamedNetwork& named, const MorphInput& input, Index genus) {
    const Network& network = named.network;
    EXPECT_EQ(network.genus, genus);
    EXPECT_EQ(to_index(named.corners.size()) - to_index(network.curves.size()) +
                  to_index(network.patches.size()),
              2 - 2 * genus);
    std::set<Dart> darts;
    for (const auto& patch : network.patches)
        for (std::size_t k = 0; k < patch.size(); ++k) {
            EXPECT_TRUE(darts.insert(patch[k]).second);
            EXPECT_EQ(std::ranges::count(patch, patch[k] ^ 1), 0);
            const auto ends = [&](Dart dart) {
                const NetworkCurve& c = network.curves[to_size(dart / 2)];
                return dart % 2 == 0 ? std::pair{c.from, c.to} : std::pair{c.to, c.from};
            };
            EXPECT_EQ(ends(patch[k]).second, ends(patch[(k + 1) % patch.size()]).first);
        }
    EXPECT_EQ(darts.size(), 2 * network.curves.size());
    for (const std::size_t m : {0u, 1u}) {
        const Positions& points = (m == 0 ? input.source : input.target).positions;
        const auto row = [&](Index corner) -> Index {
            const auto f =
                std::ranges::find(input.features, named.corners[to_size(corner)], &Feature::name);
            return f == input.features.end() ? -1 : (m == 0 ? f->source : f->target).rows.front();
        };
        for (const NetworkCurve& curve : network.curves) {
            if (const Index from = row(curve.from); from >= 0) {
                EXPECT_LT((curve.on[m].points.row(0) - points.row(from)).norm(), 1e-9);
            }
            if (const Index to = row(curve.to); to >= 0) {
                EXPECT_LT((curve.on[m].points.bottomRows(1) - points.row(to)).norm(), 1e-9);
            }
        }
        std::vector<Index> sizes(network.patches.size(), 0);
        Index on_curve = 0;
        for (const Index label : network.labels[m])
            ++(label < 0 ? on_curve : sizes[to_size(label)]);
        EXPECT_EQ(on_curve, to_index(named.corners.size()));
        EXPECT_GT(std::ranges::min(sizes), 0);
        // Patches meet at the curves and nowhere else.
        Positions drawn(0, 3);
        for (const NetworkCurve& curve : network.curves) {
            Positions more(drawn.rows() + curve.on[m].size(), 3);
            more << drawn, curve.on[m].points;
            drawn = std::move(more);
        }
        const KdTree<3> tree(points), curves(drawn);
        Progress progress;
        const Neighborhoods nearest = nearest_neighbors(tree, 6, progress);
        const Values spacing = local_spacing(points, nearest);
        Index stray = 0;
        for (Index i = 0; i < points.rows(); ++i)
            for (const Index j : nearest[i]) {
                const Index a = network.labels[m][to_size(i)];
                const Index b = network.labels[m][to_size(j)];
                if (a >= 0 && b >= 0 && a != b &&
                    !curves.any_within(points.row(i).data(), 4.0 * spacing[i]))
                    ++stray;
            }
        EXPECT_LT(stray, points.rows() / 500);
    }
}

/// Every point in a pair, features in theirs, and few neighbors torn apart, none of them
/// because they lie on either side of a curve.
void expect_whole(const Morph& morph, const std::vector<Feature>& features) {
    EXPECT_TRUE(checks::is_total(morph.pairs(), morph.source().size(), morph.target().size()));
    EXPECT_TRUE(checks::are_paired(features, morph.pairs()));
    Progress progress;
    const std::vector<double> times{0.25, 0.5, 0.75};
    for (const Cracks& cracks : morph.cracks(times, progress)) EXPECT_LT(cracks.share, 0.002);
    EXPECT_TRUE(morph.source_to_target(progress).allFinite());
    EXPECT_TRUE(morph.target_to_source(progress).allFinite());
}

TEST(Network, CutsTwoToriIntoTheSameDisks) {
    const TwoTori tori(4, 2);
    Progress progress;
    const NamedNetwork named = preview_network(tori.input, paper(), progress);
    expect_disks(named, tori.input, 1);
}

/// Both angles stay about what they were.
void expect_alike(const Morph& morph, const TwoTori& tori) {
    Eigen::Vector2d apart = Eigen::Vector2d::Zero();
    for (const IndexPair& pair : morph.pairs())
        for (const int k : {0, 1})
            apart[k] += std::abs(std::remainder(
                tori.source.angles(pair.source, k) - tori.target.angles(pair.target, k),
                2 * std::numbers::pi));
    apart /= static_cast<double>(morph.pairs().size());
    EXPECT_LT(apart[0], 0.12);
    EXPECT_LT(apart[1], 0.3);
}

TEST(Network, MorphsATorusIntoABumpyOneByDefault) {
    const TwoTori tori(3, 3);
    Progress progress;
    const Morph morph(tori.input, paper(), progress);
    EXPECT_EQ(morph.report().domain, "network");
    EXPECT_EQ(morph.report().choice, "network: closed surfaces with 1 hole through each");
    EXPECT_EQ(to_index(morph.report().curves.size()), morph.report().patches + 9);
    EXPECT_TRUE(morph.report().warnings.empty());
    expect_whole(morph, tori.input.features);
    expect_alike(morph, tori);
}

TEST(Network, ImagesAgreeOnBothSidesOfEveryCurve) {
    SKIP_WHERE_WATCHED();
    const TwoTori tori(4, 2);
    Progress progress;
    const NamedNetwork named = preview_network(tori.input, paper(), progress);
    const Morph morph(tori.input, paper(), progress);
    const Positions images = morph.source_to_target(progress);
    const Positions& points = tori.input.source.positions;
    const KdTree<3> tree(points);
    const Neighborhoods nearest = nearest_neighbors(tree, 6, progress);
    // Stretch of edges that cross from patch to patch against those that don't.
    std::array<std::vector<double>, 2> stretch;
    for (Index i = 0; i < points.rows(); ++i)
        for (const Index j : nearest[i]) {
            const Index a = named.network.labels[0][to_size(i)];
            const Index b = named.network.labels[0][to_size(j)];
            if (a < 0 || b < 0) continue;
            stretch[a == b ? 0 : 1].push_back((images.row(i) - images.row(j)).norm());
        }
    for (auto& values : stretch) std::ranges::sort(values);
    const auto quantile = [](const std::vector<double>& values, double share) {
        return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
    };
    ASSERT_GT(stretch[1].size(), 200u);
    EXPECT_LT(quantile(stretch[1], 0.5), 2.2 * quantile(stretch[0], 0.5));
    EXPECT_LT(quantile(stretch[1], 0.99), 2.0 * quantile(stretch[0], 0.99));
}

TEST(Network, StaysTheSameWhenAShapeIsTurnedOrScaledAndForAnyThreads) {
    SKIP_WHERE_WATCHED();
    TwoTori tori(3, 3);
    Progress progress;
    MorphOptions options = paper();
    options.threads = 1;
    const Morph before(tori.input, options, progress);
    options.threads = 3;
    const Morph again(tori.input, options, progress);
    EXPECT_EQ(before.pairs(), again.pairs());
    Positions& target = tori.input.target.positions;
    target = ((target * 64.0).rowwise() + Eigen::RowVector3d(256.0, -32.0, 8.0)).eval();
    const Morph scaled(tori.input, options, progress);
    EXPECT_EQ(before.report().curves, scaled.report().curves);
    Pairing common;
    std::ranges::set_intersection(before.pairs(), scaled.pairs(), std::back_inserter(common));
    EXPECT_GT(static_cast<double>(common.size()), 0.9 * static_cast<double>(before.pairs().size()));
    // Other coarse points are drawn then, and the curves may come in another order.
    target = (target * shapes::rotation(5).transpose()).eval();
    const Morph turned(tori.input, options, progress);
    expect_whole(turned, tori.input.features);
    expect_alike(turned, tori);
}

TEST(Network, OpensTwoHandles) {
    SKIP_WHERE_WATCHED();
    const Positions source = shapes::double_torus(3000);
    Positions target = shapes::double_torus(2700, 7);
    MorphInput input;
    const auto near = [](const Positions& points, const Eigen::RowVector3d& place) {
        Index row;
        (points.rowwise() - place).rowwise().squaredNorm().minCoeff(&row);
        return row;
    };
    for (const int side : {-1, 1})
        for (int k = 0; k < 3; ++k)
            for (const double r : {1.3, 0.7}) {
                const double angle =
                    2 * std::numbers::pi * k / 3 + (side < 0 ? std::numbers::pi / 3 : 0.0);
                const Eigen::RowVector3d place(1.1 * side + r * std::cos(angle),
                                               r * std::sin(angle), 0.0);
                input.features.push_back(point_feature("f" + std::to_string(input.features.size()),
                                                       near(source, place), near(target, place)));
            }
    for (Eigen::Index i = 0; i < target.rows(); ++i)
        target(i, 2) += 0.12 * target(i, 0) * target(i, 0);
    input.source = cloud_of("flat", source);
    input.target = cloud_of("bent", target);
    Progress progress;
    MorphOptions options = paper();
    options.decomposition.points = 3000;
    const Morph morph(input, options, progress);
    // Euler's number, with the tips that were taken in as features.
    EXPECT_EQ(to_index(input.features.size() + morph.report().extremities.size()) -
                  to_index(morph.report().curves.size()) + morph.report().patches,
              -2);
    expect_whole(morph, input.features);
}

/// Two urchins with a loop of three features round each of two spikes.
MorphInput two_urchins() {
    const std::vector<Vector3> from{{0, 0, 1.0}, {1.0, 0, 0}, {0, -0.6, 0}};
    const std::vector<Vector3> to{{0, 0, 0.7}, {1.2, 0.2, 0}, {0, -0.7, 0.1}};
    const shapes::Urchin source(4000, from, 1), target(3500, to, 2);
    MorphInput input;
    input.source = cloud_of("urchin", source.positions);
    input.target = cloud_of("other urchin", target.positions);
    const auto row = [](const shapes::Urchin& urchin, const Vector3& direction) {
        Index found;
        (urchin.positions.rowwise().normalized() * direction.normalized()).maxCoeff(&found);
        return found;
    };
    for (const std::size_t spike : {0u, 1u})
        for (int k = 0; k < 3; ++k) {
            const auto around = [&](const Vector3& axis) -> Vector3 {
                const Vector3 x = Vector3(0, 1, 0).cross(axis).normalized();
                const Vector3 y = axis.normalized().cross(x);
                const double angle = 2 * std::numbers::pi * k / 3;
                return axis.normalized() + 0.4 * (std::cos(angle) * x + std::sin(angle) * y);
            };
            input.features.push_back(
                point_feature((spike == 0 ? "up " : "side ") + std::to_string(k),
                              row(source, around(from[spike])), row(target, around(to[spike]))));
        }
    input.loop = {"up 0", "up 1", "up 2"};
    input.more_loops = {{"side 0", "side 1", "side 2"}};
    return input;
}

TEST(Network, TakesLoopsRoundLimbs) {
    SKIP_WHERE_WATCHED();
    const MorphInput input = two_urchins();
    Progress progress;
    const NamedNetwork named = preview_network(input, paper(), progress);
    expect_disks(named, input, 0);
    // The limbs are patches of their own: nothing is led through them.
    for (std::size_t k = 0; k < 6; ++k) {
        const auto name = [&](Index corner) { return named.corners[to_size(corner)]; };
        EXPECT_EQ(name(named.network.curves[k].from).substr(0, 2), k < 3 ? "up" : "si");
        EXPECT_EQ(name(named.network.curves[k].to).substr(0, 2), k < 3 ? "up" : "si");
    }
    const Morph morph(input, paper(), progress);
    EXPECT_EQ(morph.report().domain, "network");
    expect_whole(morph, input.features);
}

TEST(Network, CutsGenusZeroWhenAsked) {
    SKIP_WHERE_WATCHED();
    MorphInput input = two_urchins();
    input.loop.clear();
    input.more_loops.clear();
    MorphOptions options = paper();
    options.domain = Domain::kNetwork;
    Progress progress;
    expect_disks(preview_network(input, options, progress), input, 0);
    expect_whole(Morph(input, options, progress), input.features);
}

template <class Expected>
std::string refusal(const MorphInput& input, const MorphOptions& options) {
    Progress progress;
    try {
        const Morph morph(input, options, progress);
    } catch (const Expected& error) {
        return error.what();
    }
    return "none";
}

TEST(Network, RefusesALoopThatRunsTheOtherWayRound) {
    SKIP_WHERE_WATCHED();
    MorphInput input = two_urchins();
    std::swap(input.features[4].target, input.features[5].target);
    const std::string said = refusal<FeatureError>(input, paper());
    EXPECT_NE(said.find("reversed"), std::string::npos) << said;
}

TEST(Network, RefusesLoopsThatCross) {
    SKIP_WHERE_WATCHED();
    MorphInput input;
    const Positions ball = shapes::sphere(3000);
    input.source = cloud_of("ball", ball);
    input.target = cloud_of("other ball", shapes::sphere(2500));
    const auto mark = [&](const char* name, const Vector3& place) {
        Index s, t;
        (input.source.positions * place).maxCoeff(&s);
        (input.target.positions * place).maxCoeff(&t);
        input.features.push_back(point_feature(name, s, t));
    };
    mark("front", {1, 0, 0});
    mark("left", {0, 1, 0});
    mark("back", {-1, 0.1, 0});
    mark("right", {0, -1, 0});
    mark("top", {0.1, 0, 1});
    mark("bottom", {0, 0.1, -1});
    mark("high", {0.7, 0.7, 0.5});
    input.loop = {"front", "left", "back", "right"};
    input.more_loops = {{"top", "bottom", "high"}};
    const std::string said = refusal<FeatureError>(input, paper());
    EXPECT_NE(said.find("loop 2"), std::string::npos) << said;
    EXPECT_NE(said.find("\"top\""), std::string::npos) << said;
    EXPECT_NE(said.find("crosses"), std::string::npos) << said;
    // One way to do it: a feature in common.
    input.more_loops = {{"top", "front", "bottom", "left"}};
    EXPECT_EQ(refusal<Error>(input, paper()), "none");
}

TEST(Network, RefusesWhatItCantCut) {
    SKIP_WHERE_WATCHED();
    MorphOptions options = paper();
    options.domain = Domain::kNetwork;
    TwoTori tori(4, 2);
    tori.input.target = cloud_of("ball", shapes::sphere(3000));
    std::string said = refusal<TopologyError>(tori.input, options);
    EXPECT_NE(said.find("genus 1 and 0"), std::string::npos) << said;

    MorphInput few;
    few.source = few.target = cloud_of("ball", shapes::sphere(2000));
    few.features = {point_feature("a", 0, 0), point_feature("b", 1000, 1000)};
    options.decomposition.extremities = 0;
    said = refusal<FeatureError>(few, options);
    EXPECT_NE(said.find("at least 3"), std::string::npos) << said;

    MorphInput open;
    open.source = open.target = cloud_of("sheet", shapes::grid(30));
    said = refusal<TopologyError>(open, options);
    EXPECT_NE(said.find("closed"), std::string::npos) << said;

    // Several loops are for no other domain.
    options.domain = Domain::kCut;
    said = refusal<OptionError>(two_urchins(), options);
    EXPECT_NE(said.find("network"), std::string::npos) << said;
}

TEST(Network, StartsTheRefinementWhereAsked) {
    SKIP_WHERE_WATCHED();
    const TwoTori tori(3, 3);
    MorphOptions options;
    options.domain = Domain::kNetwork;
    Progress progress;
    const Morph morph(tori.input, options, progress);
    EXPECT_EQ(morph.report().domain, "product");
    expect_whole(morph, tori.input.features);
}

TEST(Network, CanBeCancelled) {
    const TwoTori tori(3, 3);
    Progress progress([](std::string_view stage, double) { return stage != "network"; });
    EXPECT_THROW(Morph(tori.input, paper(), progress), Cancelled);
}

/// What a network needs to know of a cloud.
struct Sampled {
    const Positions& positions;
    KdTree<3> tree;
    Neighborhoods nearest;
    Normals normals;

    explicit Sampled(const Positions& given) : positions(given), tree(given) {
        Progress progress;
        nearest = nearest_neighbors(tree, 16, progress);
        normals = covariance_analysis(positions, nearest, progress).normals;
        orient_normals(positions, nearest, normals, progress);
    }
};

TEST(Example, Network) {
    SKIP_WHERE_WATCHED();
    const TwoTori tori(4, 2);
    const Sampled one(tori.source.positions), other(tori.target.positions);
    const SampledSurface source_surface{one.positions, one.normals, one.nearest, "ring"};
    const SampledSurface target_surface{other.positions, other.normals, other.nearest, "bumpy"};
    const KdTree<3>&source_tree = one.tree, &target_tree = other.tree;
    std::vector<std::string> names;
    std::vector<Index> source_features, target_features;
    for (const Feature& feature : tori.input.features) {
        names.push_back(feature.name);
        source_features.push_back(feature.source.rows.front());
        target_features.push_back(feature.target.rows.front());
    }
    Progress progress;
    // --- example
    const NetworkShape source{source_surface, source_tree, source_features, 1};
    const NetworkShape target{target_surface, target_tree, target_features, 1};
    const Network network = trace_network({source, target}, names, {}, {.points = 1500}, progress);
    const std::vector<Dart>& around = network.patches[0];
    const Index patch = network.labels[0][7];
    // --- end of the example
    EXPECT_EQ(network.genus, 1);
    EXPECT_GE(around.size(), 3u);
    EXPECT_GE(patch, -1);
    EXPECT_LT(patch, to_index(network.patches.size()));
}

}  // namespace
}  // namespace pointmorph
