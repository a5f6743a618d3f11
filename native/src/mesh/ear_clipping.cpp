// Ears are compared in the order of the polygon. What is known of an ear holds until one of its
// corners, or the corner that blocks it, is gone, so that a polygon of n corners takes some n
// looks at what an ear may hold instead of n².
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "mesh/doubled_area.hpp"
#include "pointmorph/cloud/subset.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

namespace {

using Ear = std::array<Index, 3>;

constexpr double kSame = 1e-9;    // qualities that differ by less are the same, up to rounding
constexpr double kBlocked = 4.0;  // makes an ear worse than any that isn't blocked
constexpr Index kPoll = 256;

/// How good a triangle is as a piece of a polygon that faces along `normal`: its height over its
/// longest side, negative where it lies against the polygon. Always finite, so that it can be
/// compared, whatever the positions are.
double piece_quality(const Positions& p, const Ear& t, const Vector3& normal) {
    const Eigen::RowVector3d doubled = doubled_area(p, t[0], t[1], t[2]);
    const double longest = std::max({(p.row(t[1]) - p.row(t[0])).squaredNorm(),
                                     (p.row(t[2]) - p.row(t[1])).squaredNorm(),
                                     (p.row(t[0]) - p.row(t[2])).squaredNorm()});
    const double quality = longest > 0.0 ? doubled.dot(normal) / longest : 0.0;
    return std::isfinite(quality) ? quality : 0.0;
}

/// Whether a corner lies in a triangle of others, seen along `normal`.
bool lies_in(const Positions& p, const Ear& t, Index corner, const Vector3& normal) {
    if (std::ranges::find(t, corner) != t.end()) return false;
    for (std::size_t side = 0; side < 3; ++side)
        if (doubled_area(p, t[side], t[(side + 1) % 3], corner).dot(normal) <= 0.0) return false;
    return true;
}

/// Newell's, of length 1, or 0 if there is none, as where positions aren't finite.
Vector3 polygon_normal(const Positions& positions, std::span<const Index> corners) {
    Vector3 normal = Vector3::Zero();  // twice the area seen from each axis
    for (std::size_t k = 1; k + 1 < corners.size(); ++k)
        normal += doubled_area(positions, corners[0], corners[k], corners[k + 1]).transpose();
    normal.normalize();  // stays zero where it is
    return normal.allFinite() ? normal : Vector3::Zero();
}

/// The corners that are left, by how far they lie along a direction in the polygon's plane. It is
/// none of the axes', along which sides of many corners often lie, all of them equally far.
class SweptCorners {
public:
    SweptCorners(const Positions& p, std::span<const Index> corners, const Vector3& normal)
        : along_(corners.size()), is_gone_(corners.size(), 0), order_(corners.size()) {
        Eigen::Index least = 0;
        normal.cwiseAbs().minCoeff(&least);
        const Vector3 axis = normal.cross(Vector3::Unit(least));
        const Vector3 direction = axis + 0.618 * normal.cross(axis);
        for (std::size_t k = 0; k < corners.size(); ++k) {
            const double its = (p.row(corners[k]) - p.row(corners[0])).dot(direction.transpose());
            along_[k] = std::isfinite(its) ? its : 0.0;
            order_[k] = to_index(k);
        }
        std::ranges::sort(order_, {}, [&](Index k) { return std::pair(along_[to_size(k)], k); });
        constexpr double kRounding = 1e-9;
        if (!order_.empty())
            slack_ = kRounding * (along_[to_size(order_.back())] - along_[to_size(order_.front())]);
    }

    void remove(Index k) {
        is_gone_[to_size(k)] = 1;
        if (2 * ++gone_ <= order_.size()) return;
        std::erase_if(order_, [&](Index other) { return is_gone_[to_size(other)] != 0; });
        gone_ = 0;
    }

    /// The first corner beside three that `blocks`, or -1. Looks at those alone that lie no further
    /// to either side than the three.
    template <class Blocks>
    Index find(const Ear& three, const Blocks& blocks) const {
        const auto [least, most] = std::minmax(
            {along_[to_size(three[0])], along_[to_size(three[1])], along_[to_size(three[2])]});
        const auto first = std::ranges::lower_bound(order_, least - slack_, {},
                                                    [&](Index k) { return along_[to_size(k)]; });
        for (auto at = first; at != order_.end() && along_[to_size(*at)] <= most + slack_; ++at)
            if (is_gone_[to_size(*at)] == 0 && blocks(*at)) return *at;
        return -1;
    }

private:
    std::vector<double> along_;
    std::vector<char> is_gone_;
    std::vector<Index> order_;
    std::size_t gone_ = 0;  // of those in the order
    double slack_ = 0.0;
};

/// Numbers of which the first that is largest up to rounding is asked for again and again.
class RankedEars {
public:
    explicit RankedEars(std::size_t count)
        : values_(count, -kInfinity), most_((count + kBlock - 1) / kBlock, -kInfinity) {}

    void set(std::size_t k, double value) {
        values_[k] = value;
        const std::size_t block = k / kBlock, first = block * kBlock;
        const auto begin = values_.begin() + static_cast<std::ptrdiff_t>(first);
        const std::size_t size = std::min(kBlock, values_.size() - first);
        most_[block] = *std::max_element(begin, begin + static_cast<std::ptrdiff_t>(size));
    }
    void remove(std::size_t k) { set(k, -kInfinity); }

    /// Going through them in order, the last that is more than the best before by over `kSame`.
    std::size_t best() const {
        std::size_t best = 0;
        double most = -kInfinity;
        for (std::size_t block = 0; block < most_.size(); ++block) {
            if (!(most_[block] > most + kSame)) continue;
            const std::size_t end = std::min((block + 1) * kBlock, values_.size());
            for (std::size_t k = block * kBlock; k < end; ++k)
                if (values_[k] > most + kSame) {
                    most = values_[k];
                    best = k;
                }
        }
        return best;
    }

private:
    static constexpr double kInfinity = std::numeric_limits<double>::infinity();
    static constexpr std::size_t kBlock = 128;
    std::vector<double> values_;
    std::vector<double> most_;  // of each block
};

/// A polygon of which one corner after the other is cut off.
class ClippedPolygon {
public:
    ClippedPolygon(const Positions& positions, std::span<const Index> corners)
        : positions_(positions),
          corners_(corners),
          normal_(polygon_normal(positions, corners)),
          left_(positions, corners, normal_),
          ears_(corners.size()),
          before_(corners.size()),
          after_(corners.size()),
          blocked_by_(corners.size(), -1),
          blocks_(corners.size()) {
        const auto n = to_index(corners.size());
        for (Index k = 0; k < n; ++k) {
            before_[to_size(k)] = (k + n - 1) % n;
            after_[to_size(k)] = (k + 1) % n;
        }
    }

    void compare_all(Progress& progress) {
        for (Index k = 0; k < to_index(corners_.size()); ++k) {
            if (k % kPoll == 0) progress.report(0.0);
            compare(k);
        }
    }

    Index best() const { return to_index(ears_.best()); }
    Ear triangle(Index k) const { return vertices(ear(k)); }

    void clip(Index k) {
        const Index b = before_[to_size(k)], a = after_[to_size(k)];
        after_[to_size(b)] = a;
        before_[to_size(a)] = b;
        ears_.remove(to_size(k));
        left_.remove(k);
        blocked_by_[to_size(k)] = kGone;
        compare(b);
        compare(a);
        for (const Index other : std::exchange(blocks_[to_size(k)], {}))
            if (blocked_by_[to_size(other)] == k) compare(other);
    }

    /// The corners that are left, from the first on.
    std::vector<Index> left() const {
        std::vector<Index> left;
        for (std::size_t k = 0; k < corners_.size(); ++k)
            if (blocked_by_[k] != kGone) left.push_back(corners_[k]);
        return left;
    }

private:
    static constexpr Index kGone = -2;

    Ear ear(Index k) const { return {before_[to_size(k)], k, after_[to_size(k)]}; }
    Ear vertices(const Ear& three) const {
        return {corners_[to_size(three[0])], corners_[to_size(three[1])],
                corners_[to_size(three[2])]};
    }

    /// Another corner of the polygon that lies in an ear, or -1.
    Index held_by(const Ear& three) const {
        if (normal_.isZero(0.0)) return -1;
        const Ear t = vertices(three);
        return left_.find(three, [&](Index other) {
            return lies_in(positions_, t, corners_[to_size(other)], normal_);
        });
    }

    void compare(Index k) {
        const Ear three = ear(k);
        double quality = piece_quality(positions_, vertices(three), normal_);
        const Index held = held_by(three);
        blocked_by_[to_size(k)] = held;
        if (held >= 0) {
            blocks_[to_size(held)].push_back(k);
            quality -= kBlocked;
        }
        ears_.set(to_size(k), quality);
    }

    const Positions& positions_;
    std::span<const Index> corners_;
    Vector3 normal_;
    SweptCorners left_;
    RankedEars ears_;
    std::vector<Index> before_, after_;
    std::vector<Index> blocked_by_;           // a corner in the ear, -1, or kGone
    std::vector<std::vector<Index>> blocks_;  // ears that once were blocked by a corner
};

/// Which ear is cut off where four corners are left, so that what remains is good as well.
std::size_t last_ear(const Positions& p, std::span<const Index> four, const Vector3& normal) {
    std::array<double, 4> qualities{};
    for (std::size_t k = 0; k < 4; ++k) {
        const Index before = four[(k + 3) % 4], after = four[(k + 1) % 4],
                    opposite = four[(k + 2) % 4];
        const Ear ear{before, four[k], after};
        qualities[k] = std::min(piece_quality(p, ear, normal),
                                piece_quality(p, {before, after, opposite}, normal));
        if (lies_in(p, ear, opposite, normal)) qualities[k] -= kBlocked;
    }
    std::size_t best = 0;
    for (std::size_t k = 1; k < 4; ++k)
        if (qualities[k] > qualities[best] + kSame) best = k;
    return best;
}

}  // namespace

std::vector<Ear> triangulate(const Positions& positions, std::span<const Index> corners,
                             Progress& progress) {
    if (corners.size() < 3) return {};
    std::vector<Ear> triangles;
    triangles.reserve(corners.size() - 2);
    std::vector<Index> ring(corners.begin(), corners.end());
    if (ring.size() > 4) {
        ClippedPolygon polygon(positions, corners);
        polygon.compare_all(progress);
        for (std::size_t size = ring.size(); size > 4; --size) {
            if (size % kPoll == 0) progress.report(0.0);
            const Index ear = polygon.best();
            triangles.push_back(polygon.triangle(ear));
            polygon.clip(ear);
        }
        ring = polygon.left();
    }
    if (ring.size() == 4) {
        const std::size_t k = last_ear(positions, ring, polygon_normal(positions, corners));
        triangles.push_back({ring[(k + 3) % 4], ring[k], ring[(k + 1) % 4]});
        ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(k));
    }
    triangles.push_back({ring[0], ring[1], ring[2]});
    return triangles;
}

Triangles triangle_corners(const Positions& positions, const Polygons& faces, Progress& progress) {
    Eigen::Index count = 0;
    for (Index f = 0; f < faces.size(); ++f)
        count += std::max<Eigen::Index>(static_cast<Eigen::Index>(faces[f].size()) - 2, 0);
    Triangles rows(count, 3);
    Eigen::Index row = 0;
    std::vector<Index> its;
    for (Index f = 0; f < faces.size(); ++f) {
        if (f % kPoll == 0) progress.report(static_cast<double>(f) / faces.size());
        const std::span<const Index> corners = faces[f];
        const auto first = to_index(faces.offsets[to_size(f)]);
        its.resize(corners.size());
        std::iota(its.begin(), its.end(), 0);
        const Positions places = gather(positions, corners);
        for (const auto& [a, b, c] : triangulate(places, its, progress))
            rows.row(row++) << first + a, first + b, first + c;
    }
    return rows;
}

}  // namespace pointmorph
