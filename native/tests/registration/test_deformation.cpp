#include "pointmorph/registration/deformation.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <chrono>
#include <numeric>
#include <string_view>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "shapes.hpp"
#include "watched.hpp"

namespace pointmorph {
namespace {

struct Ball {
    explicit Ball(Index points = 1500, Index nodes = 150, const Positions& p = {})
        : positions(p.rows() ? p : shapes::sphere(points)), normals(positions) {
        Progress progress;
        const KdTree<3> tree(positions);
        surface = surface_graph(tree, normals, {}, progress);
        graph = deformation_graph(surface, poisson_disk_subset(tree, normals, {}, nodes, progress),
                                  progress);
    }
    Deformation at_rest() const {
        Deformation d;
        d.positions.resize(graph.size(), 3);
        for (Index k = 0; k < graph.size(); ++k)
            d.positions.row(k) = positions.row(graph.node_rows[to_size(k)]);
        fit_similarities(positions, graph, 2, 3.0, d);
        return d;
    }

    Positions positions;
    Normals normals;
    SurfaceGraph surface;
    DeformationGraph graph;
};

TEST(Deformation, EveryPointHangsOnNearNodes) {
    const Ball ball;
    for (Index i = 0; i < ball.graph.points(); ++i) {
        double sum = 0.0;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {
            EXPECT_GE(ball.graph.point_weights[to_size(i)][k], 0.0);
            sum += ball.graph.point_weights[to_size(i)][k];
            const Index row = ball.graph.node_rows[to_size(ball.graph.point_nodes[to_size(i)][k])];
            EXPECT_LT((ball.positions.row(row) - ball.positions.row(i)).norm(),
                      2.4 * ball.graph.spacing);
        }
        EXPECT_NEAR(sum, 1.0, 1e-12);
    }
}

TEST(Deformation, ASimilarityOfTheNodesIsOneOfAllPoints) {
    const Ball ball;
    const Similarity move{1.4, shapes::rotation(2), Vector3(1, 2, 3)};
    Deformation d = ball.at_rest();
    d.positions = move.apply(d.positions);
    fit_similarities(ball.positions, ball.graph, 3, 3.0, d);
    const DeformedCloud result = deformed(ball.positions, ball.normals, ball.graph, d);
    EXPECT_LT((result.positions - move.apply(ball.positions)).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((result.normals - move.rotated(ball.normals)).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((result.linear[7] - move.scale * move.rotation).norm(), 1e-9);
}

TEST(Deformation, SomePointsMoveAsAmongAll) {
    const Ball ball;
    Deformation d = ball.at_rest();
    d.positions += 0.1 * shapes::cube_noise(ball.graph.size(), 3);
    fit_similarities(ball.positions, ball.graph, 2, 3.0, d);
    const DeformedCloud all = deformed(ball.positions, ball.normals, ball.graph, d);
    const std::vector<Index> rows{1400, 3, 77};
    const DeformedCloud some = deformed(ball.positions, ball.normals, ball.graph, d, rows);
    ASSERT_EQ(some.positions.rows(), 3);
    for (Index k = 0; k < 3; ++k) {
        EXPECT_EQ(some.positions.row(k), all.positions.row(rows[to_size(k)]));
        EXPECT_EQ(some.normals.row(k), all.normals.row(rows[to_size(k)]));
        EXPECT_EQ(some.linear[to_size(k)], all.linear[to_size(rows[to_size(k)])]);
    }
}

TEST(Deformation, ScalesStayWithinTheirLimits) {
    const Ball ball;
    Deformation d = ball.at_rest();
    d.positions *= 10.0;
    fit_similarities(ball.positions, ball.graph, 1, 3.0, d);
    EXPECT_DOUBLE_EQ(d.scales.maxCoeff(), 3.0);
    d.positions.setZero();
    fit_similarities(ball.positions, ball.graph, 1, 3.0, d);
    EXPECT_DOUBLE_EQ(d.scales.minCoeff(), 1.0 / 3.0);
    for (const Matrix3& r : d.rotations) EXPECT_NEAR(r.determinant(), 1.0, 1e-9);
}

/// Where the energy is least, from rows of the least-squares problem, one by one, by Eigen's dense
/// solver.
Positions minimizer(const Ball& ball, const Deformation& d, const std::vector<Attraction>& pulls,
                    double stiffness) {
    const Index count = ball.graph.size();
    const auto linear = [&](Index k) { return d.scales[k] * d.rotations[to_size(k)]; };
    const auto rest = [&](Index k) -> Vector3 {
        return ball.positions.row(ball.graph.node_rows[to_size(k)]).transpose();
    };
    Eigen::MatrixXd normal = 1e-9 * Eigen::MatrixXd::Identity(count, count);
    Eigen::MatrixXd right = Eigen::MatrixXd::Zero(count, 3);
    const auto add = [&](const Eigen::VectorXd& row, const Vector3& value, double weight) {
        normal += weight * row * row.transpose();
        right += weight * row * value.transpose();
    };
    for (Index i = 0; i < count; ++i)
        for (auto e = to_size(Index(ball.graph.edge_offsets[to_size(i)]));
             e < to_size(Index(ball.graph.edge_offsets[to_size(i) + 1])); ++e) {
            const Index j = ball.graph.edge_ends[e];
            if (j < i) continue;
            Eigen::VectorXd row = Eigen::VectorXd::Zero(count);
            row[j] = 1.0;
            row[i] = -1.0;
            add(row, 0.5 * (linear(i) + linear(j)) * (rest(j) - rest(i)),
                stiffness * ball.graph.edge_weights[e]);
        }
    for (const Attraction& a : pulls) {
        Eigen::VectorXd row = Eigen::VectorXd::Zero(count);
        Vector3 value = a.target;
        for (std::size_t k = 0; k < kNodesPerPoint; ++k) {
            const double w = ball.graph.point_weights[to_size(a.point)][k];
            const Index node = ball.graph.point_nodes[to_size(a.point)][k];
            row[node] += w;
            value -= w * linear(node) * (ball.positions.row(a.point).transpose() - rest(node));
        }
        add(row, value, a.weight);
    }
    return normal.ldlt().solve(right);
}

TEST(Deformation, TheSolverMinimizesItsEnergy) {
    for (const Index nodes : {1, 2, 3, 5, 40, 202}) {  // four at a time, if there are
        const Ball ball(400, nodes);
        Deformation d = ball.at_rest();
        d.positions += 0.1 * shapes::cube_noise(ball.graph.size());
        fit_similarities(ball.positions, ball.graph, 1, 3.0, d);
        std::vector<Attraction> pulls;
        const Positions targets = shapes::cube_noise(60, 5);
        for (Index i = 0; i < 60; ++i)
            pulls.push_back({i * 6, 0.1 + i % 7, targets.row(i).transpose()});
        DeformationSolver solver(ball.positions, ball.graph);
        for (const double stiffness : {0.7, 12.0}) {  // nothing is left of the factor before
            solver.factorize(stiffness, pulls);
            Deformation solved = d;
            solver.solve(pulls, solved);
            EXPECT_LT(
                (solved.positions - minimizer(ball, d, pulls, stiffness)).cwiseAbs().maxCoeff(),
                1e-8);
            pulls.pop_back();
        }
    }
}

TEST(Deformation, FarPartsHangTogether) {
    Positions p(700, 3);
    p << shapes::sphere(600), 0.05 * shapes::sphere(100);
    p.bottomRows(100).col(0).array() += 4.0;
    const Ball ball(0, 100, p);
    // Reach every node from the first along the edges.
    std::vector<char> seen(to_size(ball.graph.size()), 0);
    std::vector<Index> open{0};
    seen[0] = 1;
    Index reached = 0;
    while (!open.empty()) {
        const Index i = open.back();
        open.pop_back();
        ++reached;
        for (auto e = to_size(Index(ball.graph.edge_offsets[to_size(i)]));
             e < to_size(Index(ball.graph.edge_offsets[to_size(i) + 1])); ++e)
            if (!seen[to_size(ball.graph.edge_ends[e])]) {
                seen[to_size(ball.graph.edge_ends[e])] = 1;
                open.push_back(ball.graph.edge_ends[e]);
            }
    }
    EXPECT_EQ(reached, ball.graph.size());
}

/// Nodes in a row, `step` after one and `gap` after every `piece` of them; all rows are nodes.
struct Row {
    SurfaceGraph surface;
    Subset subset;

    Row(Index count, Index piece, double gap) {
        subset.radius = 1.0;
        const auto length = [&](Index i) {  // to the next
            return (i + 1) % piece == 0 ? gap + 0.001 * ((7 * i) % 1000) : 1.5;
        };
        for (Index i = 0; i < count; ++i) {
            if (i > 0) add(i - 1, length(i - 1));
            if (i + 1 < count) add(i + 1, length(i));
            surface.offsets.push_back(static_cast<std::int64_t>(surface.neighbors.size()));
            subset.rows.push_back(i);
        }
    }
    void add(Index to, double length) {
        surface.neighbors.push_back(to);
        surface.lengths.push_back(length);
    }
};

TEST(Deformation, ThousandsOfPartsHangTogetherByTheirShortestWays) {
    // Each told from all others anew, these would take half a minute.
    const Index count = is_watched() ? 6000 : 60000;
    const Row row(count, 2, 5.0);
    Progress progress;
    const DeformationGraph graph = deformation_graph(row.surface, row.subset, progress);
    ASSERT_EQ(graph.edge_ends.size(), to_size(2 * (count - 1)));
    for (Index i = 0; i + 1 < count; ++i)
        ASSERT_EQ(graph.edge_ends[to_size(graph.edge_offsets[to_size(i) + 1]) - 1], i + 1);
}

TEST(Deformation, CanBeCancelledWhilePartsAreJoined) {
    const Row row(400, 2, 5.0);
    const ThreadCount one(1);
    const auto calls_of = [&](Index piece) {
        const Row its(400, piece, 5.0);
        int calls = 0;
        Progress counting([&](std::string_view, double) { return ++calls > 0; },
                          std::chrono::milliseconds(0));
        deformation_graph(its.surface, its.subset, counting);
        return calls;
    };
    const int last = calls_of(2);
    EXPECT_GE(last, calls_of(400) + 199);
    int calls = 0;
    Progress cancel([&](std::string_view, double) { return ++calls < last; },
                    std::chrono::milliseconds(0));
    EXPECT_THROW(deformation_graph(row.surface, row.subset, cancel), Cancelled);
}

TEST(Example, Deformation) {
    const Ball ball;
    const Positions& positions = ball.positions;
    const Normals& normals = ball.normals;
    const DeformationGraph& graph = ball.graph;
    std::vector<Attraction> attractions;
    for (Index i = 0; i < graph.points(); ++i)
        attractions.push_back({i, 1.0, positions.row(i).transpose() + Vector3(0, 0, 1)});
    Deformation deformation = ball.at_rest();
    // --- example
    DeformationSolver solver(positions, graph);
    solver.factorize(1.0, attractions);
    solver.solve(attractions, deformation);
    fit_similarities(positions, graph, 2, 3.0, deformation);
    const DeformedCloud now = deformed(positions, normals, graph, deformation);
    // --- end of the example
    EXPECT_LT((now.positions - positions).cwiseAbs().leftCols<2>().maxCoeff(), 1e-6);
    EXPECT_LT(((now.positions - positions).col(2).array() - 1.0).abs().maxCoeff(), 1e-6);
    EXPECT_LT((now.normals - normals).cwiseAbs().maxCoeff(), 1e-6);
}

}  // namespace
}  // namespace pointmorph
