#include "mesh/wrap_samples.hpp"

#include <gtest/gtest.h>

#include <initializer_list>
#include <vector>

#include "mesh_shapes.hpp"
#include "processor_time.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

/// Samples of three parts of a target, far apart.
const std::vector<Index> kParts{0, 1, 2};

Positions places_of_parts() {
    Positions places(3, 3);
    places << 0, 0, 0, 10, 0, 0, 20, 0, 0;
    return places;
}

/// Starts of a mesh of two balls: so many percent of each at the places of each of the target's
/// parts.
Positions starts(const Mesh& mesh, const std::vector<std::vector<Index>>& percent) {
    Positions result(mesh.positions.rows(), 3);
    std::vector<Index> seen(percent.size(), 0), all(percent.size(), 0);
    for (const Index part : mesh.parts) ++all[to_size(part)];
    for (Index p = 0; p < to_index(result.rows()); ++p) {
        const std::size_t part = to_size(mesh.parts[to_size(p)]);
        const Index share = 100 * seen[part]++ / all[part];
        Index target = 0;
        for (Index end = percent[part][0]; share >= end;) end += percent[part][to_size(++target)];
        result.row(p) = places_of_parts().row(target);
    }
    return result;
}

std::vector<Index> kept(const std::vector<std::vector<Index>>& percent) {
    const Mesh mesh = make_mesh(mesh_shapes::together(
        mesh_shapes::icosphere(3),
        mesh_shapes::moved(mesh_shapes::icosphere(3), Matrix3::Identity(), Vector3(5, 0, 0))));
    return parts_kept_to(mesh, starts(mesh, percent), places_of_parts(), kParts);
}

TEST(WrapSamples, KeepAPartToWhatMostOfItBecomes) {
    // Eyes stay eyes, and heads have none on them.
    EXPECT_EQ(kept({{95, 5, 0}, {0, 100, 0}}), (std::vector<Index>{0, 1}));
    EXPECT_EQ(kept({{65, 35, 0}, {0, 100, 0}}), (std::vector<Index>{0, 1}));
    EXPECT_EQ(kept({{50, 50, 0}, {30, 0, 70}}), (std::vector<Index>{-1, 2}));
}

TEST(WrapSamples, LetAPartBeSeveralThatNothingElseBecomes) {
    // A bottle that becomes a lamp is its foot and its shade as well.
    EXPECT_EQ(kept({{70, 15, 15}, {100, 0, 0}}), (std::vector<Index>{-1, 0}));
    EXPECT_EQ(kept({{70, 0, 30}, {0, 100, 0}}), (std::vector<Index>{-1, 1}));
    EXPECT_EQ(kept({{92, 0, 8}, {0, 100, 0}}), (std::vector<Index>{0, 1}));
}

TEST(WrapSamples, AreAllOfThemWhereOnlyTheCoarseOnesHaveParts) {
    WrapTarget target;
    target.coarse.positions = Positions::Random(40, 3);
    target.coarse.normals = Normals::Constant(40, 3, 1.0).rowwise().normalized();
    target.fine = target.coarse;
    target.coarse_parts.assign(40, 0);
    target.coarse_parts.back() = 1;
    WrapTrees trees(target, 1.0);
    Progress progress;
    const auto of_all = &trees.of_part(WrapTrees::kFine, 1, progress);
    EXPECT_EQ(of_all, &trees.made(WrapTrees::kFine, 1));
}

TEST(WrapSamples, KeepVeryManyPartsInNoTimeToAsMany) {
    SKIP_WHERE_WATCHED();
    constexpr Index kMany = 3000;
    Cloud cloud;
    cloud.positions.resize(3 * kMany, 3);
    for (Index f = 0; f < kMany; ++f) {
        cloud.positions.middleRows(3 * f, 3) << f, 0, 0, f + 0.5, 0, 0, f, 0.5, 0;
        mesh_shapes::add_face(cloud.faces, {3 * f, 3 * f + 1, 3 * f + 2});
    }
    const Mesh mesh = make_mesh(cloud);
    std::vector<Index> own, shared;
    for (const Index part : mesh.parts) {
        own.push_back(part);
        shared.push_back(part % 2);
    }
    const auto time = [&](const std::vector<Index>& parts) {
        return processor_time([&] {
            const std::vector<Index> kept =
                parts_kept_to(mesh, mesh.positions, mesh.positions, parts);
            for (std::size_t part = 0; part < kept.size(); ++part)
                EXPECT_EQ(kept[part], parts == own ? to_index(part) : to_index(part) % 2);
        });
    };
    // With each part compared with all, it is some thousand times as long.
    EXPECT_LT(time(own), 20.0 * time(shared));
}

}  // namespace
}  // namespace pointmorph
