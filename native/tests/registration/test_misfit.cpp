#include "pointmorph/registration/misfit.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "registration/cut_egg.hpp"
#include "registration/eggs.hpp"

namespace pointmorph {
namespace {

/// Nothing moves.
Registration identity_of(const CoarseShape& shape) {
    const DeformationGraph& graph = shape.levels.back();
    Registration identity;
    identity.source.positions.resize(graph.size(), 3);
    for (Index k = 0; k < graph.size(); ++k)
        identity.source.positions.row(k) = shape.positions.row(graph.node_rows[to_size(k)]);
    identity.source.rotations.assign(to_size(graph.size()), Matrix3::Identity());
    identity.source.scales = Values::Ones(graph.size());
    identity.source_points = {shape.positions, shape.normals, {}};
    identity.target = identity.source;
    identity.target_points = identity.source_points;
    return identity;
}

Misfit misfit_of(const CoarsePair& shapes, const Registration& registration) {
    Progress progress;
    return registration_misfit(shapes, to_index(shapes.source.levels.size()) - 1, registration,
                               node_distances(shapes.source, shapes.target), {}, progress);
}

TEST(Misfit, IsNoneForAShapeThatStaysItself) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    const Misfit none = misfit_of({egg, egg}, identity_of(egg));
    for (const double figure : {none.gap, none.round_trip, none.opposed, none.rotation_change,
                                none.scale_change, none.geodesics, none.torn})
        EXPECT_EQ(figure, 0.0);
    EXPECT_NEAR(none.normals, 0.0, 1e-12);
    EXPECT_NEAR(none.residual, 0.0, 1e-12);
}

TEST(Misfit, CountsTheFacesThatImagesShowTheirBacksTo) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    Registration turned = identity_of(egg);
    turned.source_points.normals *= -1.0;
    turned.target_points.normals *= -1.0;
    // Without a weight of the normals every point still finds itself.
    RegistrationOptions options;
    options.normal_weight = 0.0;
    Progress progress;
    const Misfit misfit =
        registration_misfit({egg, egg}, 1, turned, node_distances(egg, egg), options, progress);
    EXPECT_NEAR(misfit.opposed, 1.0, 1e-9);
    EXPECT_NEAR(misfit.normals, 2.0, 1e-9);
    EXPECT_EQ(misfit.gap, 0.0);
}

TEST(Misfit, GrownEdgesAreTornAndLeaveAResidual) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    Registration grown = identity_of(egg);
    grown.source.positions *= 3.0;  // but neither rotations nor scales
    const Misfit misfit = misfit_of({egg, egg}, grown);
    EXPECT_NEAR(misfit.torn, 0.5, 1e-9);      // every edge of one of the two
    EXPECT_NEAR(misfit.residual, 2.0, 1e-9);  // (3 − 1)² of one of the two
    grown.source.scales *= 3.0;
    EXPECT_NEAR(misfit_of({egg, egg}, grown).residual, 0.0, 1e-9);
}

TEST(Misfit, EnergyGrowsWithEveryFigureButTears) {
    const Misfit none;
    using Figure = double Misfit::*;
    for (const Figure figure :
         {&Misfit::gap, &Misfit::round_trip, &Misfit::normals, &Misfit::opposed, &Misfit::residual,
          &Misfit::rotation_change, &Misfit::scale_change, &Misfit::geodesics}) {
        Misfit some;
        some.*figure = 0.1;
        EXPECT_GT(some.energy(), none.energy());
    }
    Misfit torn;
    torn.torn = 0.5;
    EXPECT_EQ(torn.energy(), none.energy());
}

TEST(Misfit, TornIsTheShareOfEdgesWhoseEndsPart) {
    const Eggs eggs;
    const CoarseShape& egg = eggs.coarse_source;
    Progress progress;
    const Registration identity = identity_of(egg);
    EXPECT_EQ(torn_share({egg, egg}, identity, {}, progress), 0.0);
    // Halved by a plane, one half carried to the opposite end.
    Registration cut = identity;
    std::vector<char> moved(to_size(egg.size()), 0);
    for (Index i = 0; i < egg.size(); ++i)
        if (egg.positions(i, 2) > 0.0) {
            moved[to_size(i)] = 1;
            cut.source_points.positions.row(i) *= -1.0;
            cut.source_points.normals.row(i) *= -1.0;
        }
    std::size_t across = 0;
    const SurfaceGraph& graph = egg.graph;
    for (Index i = 0; i < graph.size(); ++i)
        for (auto e = graph.offsets[to_size(i)]; e < graph.offsets[to_size(i) + 1]; ++e)
            across += moved[to_size(i)] != moved[to_size(graph.neighbors[to_size(e)])];
    const double torn = torn_share({egg, egg}, cut, {}, progress);
    const double expected = static_cast<double>(across) / static_cast<double>(graph.lengths.size());
    EXPECT_GT(torn, 0.3 * expected);
    EXPECT_LT(torn, 3.0 * expected);
}

/// Both as they are: the part lies where it belongs on the whole.
Registration identity_of(const CutEgg& cut) {
    Registration identity = identity_of(cut.part);
    const Registration of_whole = identity_of(cut.whole);
    identity.target = of_whole.source;
    identity.target_points = of_whole.source_points;
    return identity;
}

TEST(Misfit, WhatLiesBeyondAnEndDoesntCount) {
    const CutEgg cut;
    const Registration identity = identity_of(cut);
    const Misfit left = misfit_of({cut.part, cut.whole}, identity);
    const Misfit stretched = misfit_of({cut.endless, cut.whole}, identity);
    EXPECT_LT(left.gap, 0.7 * stretched.gap);
    EXPECT_LT(left.normals, 0.7 * stretched.normals);
    EXPECT_LT(left.energy(), 0.7 * stretched.energy());
    // What is left over counts nowhere: its images may be anywhere.
    Registration elsewhere = identity;
    for (Index i = 0; i < cut.whole.size(); ++i)
        if (cut.whole.positions(i, 0) > CutEgg::kCut + 0.1)
            elsewhere.target_points.positions(i, 0) += 3.0;
    EXPECT_NEAR(misfit_of({cut.part, cut.whole}, elsewhere).gap, left.gap, 0.2 * left.gap);
    EXPECT_GT(misfit_of({cut.endless, cut.whole}, elsewhere).gap, 2.0 * stretched.gap);
}

TEST(Misfit, EndsThatNothingLiesBeyondDontCount) {
    const CutEgg cut;
    const Registration identity = identity_of(cut.part);
    const Misfit with_ends = misfit_of({cut.part, cut.endless}, identity);
    const Misfit without = misfit_of({cut.endless, cut.endless}, identity);
    EXPECT_EQ(with_ends.gap, without.gap);
    EXPECT_EQ(with_ends.round_trip, without.round_trip);
    EXPECT_EQ(with_ends.opposed, without.opposed);
    EXPECT_NEAR(with_ends.energy(), without.energy(), 1e-12);
}

TEST(Misfit, ATearBeyondAnEndDoesntCount) {
    const CutEgg cut;
    Registration torn = identity_of(cut);
    for (Index i = 0; i < cut.whole.size(); ++i)
        if (cut.whole.positions(i, 0) > CutEgg::kCut + 0.1)
            torn.target_points.positions(i, 0) = -0.42;  // onto the other tip
    Progress progress;
    EXPECT_GT(torn_share({cut.endless, cut.whole}, torn, {}, progress), 0.002);
    EXPECT_EQ(torn_share({cut.part, cut.whole}, torn, {}, progress), 0.0);
}

TEST(Example, Misfit) {
    const Eggs eggs;
    const CoarseShape &source = eggs.coarse_source, &target = eggs.coarse_source;
    const Registration map = identity_of(source);
    Registration other_map = map;
    other_map.source_points.positions *= 1.1;
    Progress progress;
    // --- example
    const NodeDistances distances = node_distances(source, target);
    const Misfit misfit = registration_misfit({source, target}, 1, map, distances, {}, progress);
    const Misfit other =
        registration_misfit({source, target}, 1, other_map, distances, {}, progress);
    const bool is_better = misfit.energy() < other.energy();
    // --- end of the example
    EXPECT_TRUE(is_better);
    EXPECT_GT(other.gap, misfit.gap);
}

}  // namespace
}  // namespace pointmorph
