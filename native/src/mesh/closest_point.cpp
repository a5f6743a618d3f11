#include "pointmorph/mesh/closest_point.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr Index kLeaf = 8;

SurfacePoint at(const Vector3& p, const Vector3& a, const Vector3& b, const Vector3& c,
                const Vector3& weights) {
    return {0, weights, (weights[0] * a + weights[1] * b + weights[2] * c - p).squaredNorm()};
}

/// Of a tree over so many triangles.
Index nodes_of(Index triangles) {
    return triangles <= kLeaf ? 1
                              : 1 + nodes_of(triangles / 2) + nodes_of(triangles - triangles / 2);
}

/// Of the edge from corner i to corner j, where its line passes the place.
SurfacePoint on_edge(const Vector3& p, const std::array<Vector3, 3>& corners, int i, int j,
                     double share) {
    Vector3 weights = Vector3::Zero();
    weights[i] = 1.0 - share;
    weights[j] = share;
    return at(p, corners[0], corners[1], corners[2], weights);
}

}  // namespace

SurfacePoint closest_on_triangle(const Vector3& p, const Vector3& a, const Vector3& b,
                                 const Vector3& c) {
    const Vector3 ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
    const double d1 = ab.dot(ap), d2 = ac.dot(ap);
    if (d1 <= 0.0 && d2 <= 0.0) return at(p, a, b, c, {1, 0, 0});
    const double d3 = ab.dot(bp), d4 = ac.dot(bp);
    if (d3 >= 0.0 && d4 <= d3) return at(p, a, b, c, {0, 1, 0});
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return on_edge(p, {a, b, c}, 0, 1, d1 / (d1 - d3));
    const double d5 = ab.dot(cp), d6 = ac.dot(cp);
    if (d6 >= 0.0 && d5 <= d6) return at(p, a, b, c, {0, 0, 1});
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return on_edge(p, {a, b, c}, 0, 2, d2 / (d2 - d6));
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0)
        return on_edge(p, {a, b, c}, 1, 2, (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    const double sum = va + vb + vc;
    if (!(sum > 0.0)) return at(p, a, b, c, {1, 0, 0});  // no area, up to rounding
    return at(p, a, b, c, {va / sum, vb / sum, vc / sum});
}

TriangleTree::TriangleTree(const Positions& positions, const Triangles& triangles,
                           Progress& progress)
    : triangles_(&triangles), positions_(&positions), order_(to_size(triangles.rows())) {
    const auto count = to_index(triangles.rows());
    if (count == 0) return;
    std::iota(order_.begin(), order_.end(), 0);
    Positions middles(count, 3);
    // What asks it has the time.
    const Progress::Part part(progress, 0.0, 0.0);
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f)
            middles.row(f) = (positions.row(triangles(f, 0)) + positions.row(triangles(f, 1)) +
                              positions.row(triangles(f, 2))) /
                             3.0;
    });
    nodes_.resize(to_size(nodes_of(count)));
    // The first few levels one after the other, each branch by itself; then what is left of each.
    constexpr std::size_t kBranches = 64;
    std::vector<Branch> branches{{0, 0, count}};
    const auto at_each = [&](auto&& body) {
        parallel_for(
            to_index(branches.size()), progress,
            [&](Index begin, Index end) {
                for (Index b = begin; b < end; ++b) body(to_size(b));
            },
            0.0, 0.0, 1);
    };
    const auto can_split = [](const Branch& b) { return b.end - b.begin > kLeaf; };
    while (branches.size() < kBranches && can_split(branches.front())) {
        std::vector<Branch> next(2 * branches.size());
        at_each([&](std::size_t b) {
            const auto both = halved(branches[b], middles);
            std::ranges::copy(both, next.begin() + static_cast<std::ptrdiff_t>(2 * b));
        });
        branches = std::move(next);
    }
    at_each([&](std::size_t b) { split(branches[b], middles); });
    move(positions, progress);
}

/// Makes the root of a branch, which has more than a leaf's triangles.
std::array<TriangleTree::Branch, 2> TriangleTree::halved(const Branch& branch,
                                                         const Positions& middles) {
    const auto [node, begin, end] = branch;
    Vector3 low = middles.row(order_[to_size(begin)]).transpose(), high = low;
    Index lowest = order_[to_size(begin)];
    for (Index k = begin; k < end; ++k) {
        low = low.cwiseMin(middles.row(order_[to_size(k)]).transpose());
        high = high.cwiseMax(middles.row(order_[to_size(k)]).transpose());
        lowest = std::min(lowest, order_[to_size(k)]);
    }
    Eigen::Index axis = 0;
    (high - low).maxCoeff(&axis);
    const Index middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](Index f, Index g) {
                         return std::pair(middles(f, axis), f) < std::pair(middles(g, axis), g);
                     });
    const Index right = node + 1 + nodes_of(middle - begin);
    nodes_[to_size(node)] = {Box{}, begin, end, right, lowest};
    return {Branch{node + 1, begin, middle}, Branch{right, middle, end}};
}

void TriangleTree::split(const Branch& branch, const Positions& middles) {
    const auto [node, begin, end] = branch;
    if (end - begin <= kLeaf) {
        const Index lowest = *std::min_element(order_.begin() + begin, order_.begin() + end);
        nodes_[to_size(node)] = {Box{}, begin, end, -1, lowest};
        return;
    }
    for (const Branch& half : halved(branch, middles)) split(half, middles);
}

TriangleTree::Box TriangleTree::box_of(Index begin, Index end) const {
    Box box{Vector3::Constant(kInfinity), Vector3::Constant(-kInfinity)};
    for (Index k = begin; k < end; ++k)
        for (Index c = 0; c < 3; ++c) {
            const Vector3 p = positions_->row((*triangles_)(order_[to_size(k)], c)).transpose();
            box.low = box.low.cwiseMin(p);
            box.high = box.high.cwiseMax(p);
        }
    return box;
}

void TriangleTree::move(const Positions& positions, Progress& progress) {
    positions_ = &positions;
    const auto count = to_index(nodes_.size());
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index n = begin; n < end; ++n) {
            Node& node = nodes_[to_size(n)];
            if (node.right < 0) node.box = box_of(node.begin, node.end);
        }
    });
    for (std::size_t n = nodes_.size(); n-- > 0;) {
        Node& node = nodes_[n];
        if (node.right < 0) continue;
        const Box &left = nodes_[n + 1].box, &right = nodes_[to_size(node.right)].box;
        node.box = {left.low.cwiseMin(right.low), left.high.cwiseMax(right.high)};
    }
}

SurfacePoint TriangleTree::on(Index triangle, const Vector3& place) const {
    const auto corner = [&](Index k) -> Vector3 {
        return positions_->row((*triangles_)(triangle, k)).transpose();
    };
    SurfacePoint point = closest_on_triangle(place, corner(0), corner(1), corner(2));
    point.triangle = triangle;
    return point;
}

SurfacePoint TriangleTree::closest(const Vector3& place, double within, Index guess) const {
    SurfacePoint best;
    best.squared_distance = within * within;
    const auto consider = [&](Index f) {
        const SurfacePoint point = on(f, place);
        const bool nearer = point.squared_distance < best.squared_distance;
        const bool lower = point.squared_distance == best.squared_distance && f < best.triangle;
        if (nearer || lower) best = point;
    };
    if (guess >= 0) consider(guess);
    if (nodes_.empty()) return best;
    std::array<Index, 64> stack;
    std::size_t depth = 0;
    stack[depth++] = 0;
    while (depth > 0) {
        const Index n = stack[--depth];
        const Node& node = nodes_[to_size(n)];
        const double least = node.box.squared_distance(place);
        if (least > best.squared_distance) continue;
        // All of its triangles are one point that is as near.
        if (least == best.squared_distance && best.triangle >= 0 && node.lowest >= best.triangle &&
            node.box.low == node.box.high)
            continue;
        if (node.right < 0) {
            for (Index k = node.begin; k < node.end; ++k) consider(order_[to_size(k)]);
            continue;
        }
        const Index left = n + 1, right = node.right;
        const auto key = [&](Index child) {
            const Node& side = nodes_[to_size(child)];
            return std::pair(side.box.squared_distance(place), side.lowest);
        };
        const bool left_first = key(left) < key(right);
        stack[depth++] = left_first ? right : left;
        stack[depth++] = left_first ? left : right;
    }
    return best;
}

}  // namespace pointmorph
