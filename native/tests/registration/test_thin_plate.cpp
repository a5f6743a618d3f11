#include "pointmorph/registration/thin_plate.hpp"

#include <gtest/gtest.h>

#include <span>
#include <vector>

#include "processor_time.hpp"
#include "registration/eggs.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

TEST(ThinPlate, AnAffineMapOfThePlacesIsOneOfSpace) {
    Matrix3 linear;
    linear << 1.2, 0.3, -0.1, -0.2, 0.9, 0.4, 0.1, -0.3, 1.1;
    const Eigen::RowVector3d offset(0.5, -1.0, 2.0);
    const Positions from = shapes::cube_noise(9, 1), elsewhere = shapes::cube_noise(50, 2);
    const Positions to = (from * linear.transpose()).rowwise() + offset;
    const ThinPlate plate(from, to);
    for (Eigen::Index i = 0; i < elsewhere.rows(); ++i)
        EXPECT_LT((plate(elsewhere.row(i)) - elsewhere.row(i) * linear.transpose() - offset).norm(),
                  1e-9);
}

TEST(ThinPlate, PlacesInOnePlaneLeaveWhatIsOffItAsItIs) {
    Positions from = shapes::cube_noise(8, 3);
    from.col(2).setZero();
    const Positions to = from.rowwise() + Eigen::RowVector3d(0.1, 0.2, 0.3);
    const ThinPlate plate(from, to);
    const Eigen::RowVector3d above(0.2, -0.1, 0.7);
    EXPECT_LT((plate(above) - above - Eigen::RowVector3d(0.1, 0.2, 0.3)).norm(), 1e-9);
}

TEST(ThinPlate, TakesFeaturesAlmostToTheirPartners) {
    const Eggs eggs;
    const RegistrationStart start = thin_plate_start(eggs.pair());
    for (const IndexPair& f : eggs.features) {
        EXPECT_LT((start.source.row(f.source) - eggs.coarse_target.positions.row(f.target)).norm(),
                  0.02);
        EXPECT_LT((start.target.row(f.target) - eggs.coarse_source.positions.row(f.source)).norm(),
                  0.02);
    }
}

TEST(ThinPlate, FewFeaturesLeaveThePointsWhereTheyAre) {
    const Eggs eggs;
    const auto few = std::span(eggs.features).first(4);
    const RegistrationStart start = thin_plate_start({eggs.coarse_source, eggs.coarse_target, few});
    EXPECT_EQ(start.source, eggs.coarse_source.positions);
    EXPECT_EQ(start.target, eggs.coarse_target.positions);
}

TEST(ThinPlate, ManyGuidesAreThinnedEvenly) {
    Eggs eggs;
    for (CoarseShape* shape : {&eggs.coarse_source, &eggs.coarse_target}) {
        shape->guides.places = shapes::cube_noise(150, 4);
        shape->guides.coarse_rows.assign(150, 0);
        shape->guides.weights = Values::Ones(150);
    }
    const MarkedPlaces places = marked_places(eggs.pair());
    ASSERT_EQ(places.source.rows(), 6 + 50);
    EXPECT_EQ(places.source.row(0), eggs.coarse_source.positions.row(0));
    for (Index k = 0; k < 50; ++k)
        EXPECT_EQ(places.target.row(6 + k), eggs.coarse_target.guides.places.row(3 * k));
}

TEST(ThinPlate, OfVeryManyFeaturesSomeCount) {
    SKIP_WHERE_WATCHED();
    Eggs eggs;
    const std::vector<IndexPair> few = eggs.features;
    // Each is among those that count.
    std::vector<IndexPair> many;
    for (const IndexPair& f : few) many.insert(many.end(), 200, f);
    const auto start = [&](std::span<const IndexPair> features) {
        return thin_plate_start({eggs.coarse_source, eggs.coarse_target, features});
    };
    for (const IndexPair& f : few)
        EXPECT_LT(
            (start(many).source.row(f.source) - eggs.coarse_target.positions.row(f.target)).norm(),
            0.02);
    // Through all of them it would take more than ten times as long.
    const std::span<const IndexPair> first = std::span(many).first(500);
    EXPECT_LT(processor_time([&] { start(many); }), 5.0 * processor_time([&] { start(first); }));
}

TEST(Example, ThinPlate) {
    const Eggs eggs;
    const CoarseShape &source = eggs.coarse_source, &target = eggs.coarse_target;
    const std::vector<IndexPair>& features = eggs.features;
    const Positions places = shapes::cube_noise(9, 1);
    const Positions partners = places.rowwise() + Eigen::RowVector3d(0.5, 0.0, 0.0);
    // --- example
    const RegistrationStart start = thin_plate_start({source, target, features});
    const ThinPlate plate(places, partners);
    const Eigen::RowVector3d image = plate(Eigen::RowVector3d(0.1, 0.2, 0.3));
    // --- end of the example
    EXPECT_LT((image - Eigen::RowVector3d(0.6, 0.2, 0.3)).norm(), 1e-9);
    for (const IndexPair& f : features)
        EXPECT_LT((start.source.row(f.source) - target.positions.row(f.target)).norm(), 0.02);
}

}  // namespace
}  // namespace pointmorph
