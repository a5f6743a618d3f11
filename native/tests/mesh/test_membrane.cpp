#include "mesh/membrane.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <vector>

#include "mesh/elastic_sheet.hpp"
#include "mesh_shapes.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {
namespace {

/// A flat grid and its vertices that aren't on its border, ascending.
struct Film {
    Mesh mesh = make_mesh(mesh_shapes::grid(8));
    Progress progress;
    ElasticSheet sheet{mesh.positions, mesh.triangles, progress};
    std::vector<Index> inner;

    Film() {
        std::vector<char> is_border(to_size(mesh.positions.rows()), 0);
        for (const Index place : mesh.borders.at(0)) is_border[to_size(place)] = 1;
        for (Index p = 0; p < to_index(mesh.positions.rows()); ++p)
            if (!is_border[to_size(p)]) inner.push_back(p);
    }
};

TEST(Membrane, LiesInThePlaneOfItsFrameWhereverItWas) {
    Film film;
    Positions frame = film.mesh.positions;
    frame.col(2) = 0.5 * frame.col(0) - 0.2 * frame.col(1);
    Positions x = frame;
    for (const Index v : film.inner) x.row(v) << 7.0, -3.0, 0.1 * v;
    span_membrane(film.sheet.laplacian(), film.inner, x, film.progress);
    // What is linear is harmonic.
    EXPECT_LT((x - frame).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Membrane, IsWithinTheHullOfItsFrame) {
    Film film;
    Positions x = film.mesh.positions;
    x.col(2) = x.col(0).array() * x.col(1).array();
    const double low = x.col(2).minCoeff(), high = x.col(2).maxCoeff();
    for (const Index v : film.inner) x(v, 2) = 5.0;
    span_membrane(film.sheet.laplacian(), film.inner, x, film.progress);
    EXPECT_GE(x.col(2).minCoeff(), low - 1e-12);
    EXPECT_LE(x.col(2).maxCoeff(), high + 1e-12);
}

TEST(Membrane, StaysWhereNothingHoldsIt) {
    // A grid of which all is free, beside one that its border holds.
    const Mesh mesh = make_mesh(mesh_shapes::together(
        mesh_shapes::grid(8),
        mesh_shapes::moved(mesh_shapes::grid(8), Matrix3::Identity(), Vector3(5, 0, 0))));
    Progress progress;
    const ElasticSheet sheet(mesh.positions, mesh.triangles, progress);
    std::vector<char> is_border(to_size(mesh.positions.rows()), 0);
    for (const std::vector<Index>& border : mesh.borders)
        for (const Index place : border) is_border[to_size(place)] = 1;
    std::vector<Index> free;
    Positions x = mesh.positions;
    for (Index p = 0; p < to_index(x.rows()); ++p)
        if (mesh.parts[to_size(p)] == 0 || !is_border[to_size(p)]) {
            free.push_back(p);
            x(p, 2) = 1.0 + 0.01 * p;
        }
    const Positions before = x;
    span_membrane(sheet.laplacian(), free, x, progress);
    for (Index p = 0; p < to_index(x.rows()); ++p) {
        if (mesh.parts[to_size(p)] == 0)
            EXPECT_EQ(x.row(p), before.row(p));
        else
            EXPECT_NEAR(x(p, 2), mesh.positions(p, 2), 1e-12);
    }
}

}  // namespace
}  // namespace pointmorph
