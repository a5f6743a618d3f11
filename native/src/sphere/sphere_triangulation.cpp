#include "sphere/sphere_triangulation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace pointmorph {

namespace {

double rows_determinant(const Eigen::RowVector3d& a, const Eigen::RowVector3d& b,
                        const Eigen::RowVector3d& c) {
    return a.dot(b.cross(c));
}

/// The triangle in whose cone a point lies, walking there from vertex `a`.
Triangle triangle_around(const RingMesh& mesh, const Positions& sphere, Index a,
                         const Eigen::RowVector3d& point) {
    Index b = mesh.ring(a).front(), c = mesh.left_of(a, b);
    const auto most = to_index(sphere.rows());
    for (Index steps = 0; steps < most; ++steps) {
        const std::array<Index, 3> corners{a, b, c};
        int across = -1;
        double least = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double side = rows_determinant(sphere.row(corners[to_size(k)]),
                                                 sphere.row(corners[to_size((k + 1) % 3)]), point);
            if (side < least) {
                least = side;
                across = k;
            }
        }
        if (across < 0) break;
        const Index p = corners[to_size(across)], q = corners[to_size((across + 1) % 3)];
        a = q;
        b = p;
        c = mesh.left_of(q, p);
    }
    return {a, b, c};
}

/// How bad a triangle is: 1 where it is equilateral and faces as its corners do.
double badness(const Positions& positions, const Normals& normals, double spacing, Index a, Index b,
               Index c) {
    constexpr double kLeast = 0.02;  // of the area that the edges' lengths could have
    const Eigen::RowVector3d ab = positions.row(b) - positions.row(a),
                             ac = positions.row(c) - positions.row(a);
    const double edges = ab.squaredNorm() + ac.squaredNorm() + (ac - ab).squaredNorm();
    const Eigen::RowVector3d facing = (normals.row(a) + normals.row(b) + normals.row(c)) / 3.0;
    const double area = 0.5 * ab.cross(ac).dot(facing) * 4.0 * std::numbers::sqrt3 / edges;
    const double longest = std::sqrt(edges / 3.0) / spacing;
    // Below the least area the tangent goes on, so that triangles that face the other way can
    // get better as well.
    return (area > kLeast ? 1.0 / area : (2.0 - area / kLeast) / kLeast) *
           (1.0 + longest * longest);
}

}  // namespace

RingMesh hull_on_sphere(const Positions& points) {
    const auto count = to_index(points.rows());
    Positions sphere(count + 6, 3);
    sphere << points, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1;
    const std::array<Index, 6> helpers{count,     count + 1, count + 2,
                                       count + 3, count + 4, count + 5};
    RingMesh mesh(count + 6, helpers);

    std::vector<IndexPair> edges;
    const auto make_delaunay = [&] {
        constexpr double kRounding = 1e-14;
        auto left =
            100 * static_cast<std::int64_t>(count);  // against rounding that goes in circles
        while (!edges.empty() && --left > 0) {
            const auto [a, b] = edges.back();
            edges.pop_back();
            if (!mesh.joined(a, b)) continue;
            const Index c = mesh.left_of(a, b), d = mesh.right_of(a, b);
            const Eigen::RowVector3d corner = sphere.row(a);
            if (rows_determinant(sphere.row(b) - corner, sphere.row(c) - corner,
                                 sphere.row(d) - corner) <= kRounding ||
                !mesh.can_flip(a, b))
                continue;
            mesh.flip(a, b);
            for (const IndexPair e : {IndexPair{a, c}, {c, b}, {b, d}, {d, a}}) edges.push_back(e);
        }
        edges.clear();
    };
    Index last = helpers[0];
    for (Index v = 0; v < count; ++v) {
        const auto [a, b, c] = triangle_around(mesh, sphere, last, sphere.row(v));
        mesh.insert(v, a, b, c);
        for (const IndexPair e : {IndexPair{a, b}, {b, c}, {c, a}}) edges.push_back(e);
        make_delaunay();
        last = v;
    }
    for (const Index helper : helpers) {
        double nearest = std::numeric_limits<double>::infinity();
        Index into = -1;
        for (const Index to : mesh.ring(helper)) {
            const double distance = (sphere.row(to) - sphere.row(helper)).squaredNorm();
            if (distance >= nearest || !mesh.can_remove(helper, to)) continue;
            nearest = distance;
            into = to;
        }
        const RingMesh::Removal removal = mesh.remove(helper, into);
        for (const Index r : removal.ring)
            if (r != into) edges.push_back({into, r});
        make_delaunay();
    }
    return mesh;
}

void flip_to_shape(RingMesh& mesh, const Positions& positions, const Normals& normals,
                   Progress& progress) {
    constexpr int kRounds = 40;
    constexpr double kGain = 1e-6;
    std::vector<double> lengths;
    for (const auto& [a, b, c] : mesh.triangles())
        lengths.push_back((positions.row(a) - positions.row(b)).norm());
    const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
    std::ranges::nth_element(lengths, middle);
    const double spacing = *middle;
    for (int round = 0; round < kRounds; ++round) {
        Index flips = 0;
        for (Index a = 0; a < to_index(positions.rows()); ++a) {
            const std::vector<Index> around(mesh.ring(a).begin(), mesh.ring(a).end());
            for (const Index b : around) {
                if (b < a || !mesh.joined(a, b) || !mesh.can_flip(a, b)) continue;
                const Index c = mesh.left_of(a, b), d = mesh.right_of(a, b);
                const auto bad = [&](Index p, Index q, Index r) {
                    return badness(positions, normals, spacing, p, q, r);
                };
                if (bad(d, c, a) + bad(c, d, b) >= (1.0 - kGain) * (bad(a, b, c) + bad(b, a, d)))
                    continue;
                mesh.flip(a, b);
                ++flips;
            }
        }
        if (flips == 0) break;
        progress.throw_if_cancelled();
    }
}

}  // namespace pointmorph
