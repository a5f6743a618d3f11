#include "sphere/sphere_embedding.hpp"

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

constexpr double kImpossible = std::numeric_limits<double>::infinity();
/// Half the cotangent of 60°.
constexpr double kHalfCotangent = 0.5 * std::numbers::inv_sqrt3;

double determinant(const Vector3& a, const Vector3& b, const Vector3& c) {
    return a.dot(b.cross(c));
}

/// The triangles around a vertex, as columns: what doesn't depend on its own place is computed once
/// for all places that are tried.
class TrianglesAround {
public:
    void look(std::span<const Index> ring, std::span<const Vector3> places) {
        count_ = ring.size();
        if (x_.size() <= count_)
            for (auto* column : {&x_, &y_, &z_, &across_x_, &across_y_, &across_z_, &side_, &far_,
                                 &dirichlet_, &energy_})
                column->resize(2 * count_ + 1);
        for (std::size_t k = 0; k < count_; ++k) {
            const Vector3 &b = places[to_size(ring[k])],
                          &c = places[to_size(ring[k + 1 < count_ ? k + 1 : 0])];
            const Vector3 across = b.cross(c);
            x_[k] = b.x(), y_[k] = b.y(), z_[k] = b.z();
            across_x_[k] = across.x(), across_y_[k] = across.y(), across_z_[k] = across.z();
            side_[k] = (c - b).squaredNorm();
        }
    }

    /// The sum of that of Roundness, whose weight is 1.
    double energy(const Vector3& place, double area) {
        const double x = place.x(), y = place.y(), z = place.z(), twice = 2.0 * area;
        for (std::size_t k = 0; k < count_; ++k) {
            const double dx = x_[k] - x, dy = y_[k] - y, dz = z_[k] - z;
            far_[k] = dx * dx + dy * dy + dz * dz;
        }
        far_[count_] = far_[0];
        for (std::size_t k = 0; k < count_; ++k) {
            const double d = (x * across_x_[k] + y * across_y_[k] + z * across_z_[k]) / twice;
            dirichlet_[k] = kHalfCotangent * (far_[k] + side_[k] + far_[k + 1]);
            const double energy = dirichlet_[k] * (1.0 + 1.0 / (d * d));
            energy_[k] = d > 0.0 ? energy : kImpossible;
        }
        double sum = 0.0;
        for (std::size_t k = 0; k < count_; ++k) sum += energy_[k];
        return sum;
    }

    /// What the energy does as the place moves. At the place of the last energy().
    void slopes(const Vector3& p, double area, Vector3& gradient, Matrix3& hessian) const {
        for (std::size_t k = 0; k < count_; ++k) {
            const double dirichlet = dirichlet_[k];
            const std::size_t next = k + 1 < count_ ? k + 1 : 0;
            const Vector3 b(x_[k], y_[k], z_[k]), c(x_[next], y_[next], z_[next]);
            const Vector3 dirichlet_slope = 2.0 * kHalfCotangent * (2.0 * p - b - c);
            const Vector3 d_slope =
                Vector3(across_x_[k], across_y_[k], across_z_[k]) / (2.0 * area);
            const double d = p.dot(d_slope);
            const double g = 1.0 + 1.0 / (d * d), g1 = -2.0 / (d * d * d),
                         g2 = 6.0 / (d * d * d * d);
            gradient += g * dirichlet_slope + dirichlet * g1 * d_slope;
            hessian += 4.0 * kHalfCotangent * g * Matrix3::Identity() +
                       dirichlet * g2 * d_slope * d_slope.transpose() +
                       g1 * (dirichlet_slope * d_slope.transpose() +
                             d_slope * dirichlet_slope.transpose());
        }
    }

private:
    using Column = std::vector<double>;
    std::size_t count_ = 0;
    Column x_, y_, z_;                       ///< of the ring
    Column across_x_, across_y_, across_z_;  ///< cross product of each and the next
    Column side_, far_;                      ///< squared, to the next one and to the vertex
    Column dirichlet_, energy_;
};

/// Vertices on the sphere that come and go.
class Embedding {
public:
    Embedding(RingMesh& mesh, Index count)
        : mesh_(mesh), places_(to_size(count), Vector3::Zero()) {}

    Vector3& operator[](Index v) { return places_[to_size(v)]; }
    void set_area(double area) { area_ = area; }

    /// Newton's method for one vertex, in its tangent plane. A step goes beyond where it leads, so
    /// that sweeps over all vertices get along in fewer rounds (successive overrelaxation).
    void improve(Index v, int steps) {
        constexpr double kBeyond = 1.8;
        Vector3& place = places_[to_size(v)];
        around_.look(mesh_.ring(v), places_);
        double present = around_.energy(place, area_);
        for (int step = 0; step < steps; ++step) {
            Vector3 gradient = Vector3::Zero();
            Matrix3 hessian = Matrix3::Zero();
            around_.slopes(place, area_, gradient, hessian);
            const Vector3 u = place.unitOrthogonal();
            Eigen::Matrix<double, 3, 2> tangent;
            tangent << u, place.cross(u);
            const Eigen::Vector2d slope = tangent.transpose() * gradient;
            Eigen::Matrix2d bend = tangent.transpose() * hessian * tangent;
            bend.diagonal().array() -= gradient.dot(place);
            // The sum of a matrix and a multiple of 1 that has no eigenvalue below a small one.
            const double middle = 0.5 * bend.trace();
            const double spread =
                Eigen::Vector2d(0.5 * (bend(0, 0) - bend(1, 1)), bend(0, 1)).norm();
            const double least = 1e-3 * (std::abs(middle) + spread);
            if (middle - spread < least) bend.diagonal().array() += least - (middle - spread);
            const Eigen::Vector2d way = -bend.inverse() * slope;
            if (!way.allFinite()) return;
            double length = kBeyond;
            bool gained = false;
            for (int half = 0; half < 12 && !gained; ++half, length *= 0.5) {
                const Vector3 there = (place + length * (tangent * way)).normalized();
                const double energy_there = around_.energy(there, area_);
                if (!(energy_there < present)) continue;
                gained = true;
                const double gain = present - energy_there;
                place = there;
                present = energy_there;
                if (gain < 1e-6 * present) return;
            }
            if (!gained) return;
        }
    }

    /// A place in the part of the ring that sees all of it. The ring's first vertex sees all, and
    /// so does what is near enough to it between the next one and the last.
    void put_into_ring(Index v) {
        const auto ring = mesh_.ring(v);
        Vector3 middle = Vector3::Zero();
        for (const Index r : ring) middle += places_[to_size(r)];
        const Vector3 corner = places_[to_size(ring.front())];
        const auto direction = [&](Index r) {
            const Vector3 way = places_[to_size(r)] - corner;
            return (way - way.dot(corner) * corner).normalized();
        };
        const Vector3 next = direction(ring[1]), last = direction(ring.back());
        const Vector3 half = next + last;
        Vector3 inside = corner.cross(next);
        if (half.norm() > 1e-3) inside = determinant(corner, next, last) > 0.0 ? half : -half;
        double size = 0.0;
        for (const Index r : ring) size = std::max(size, (places_[to_size(r)] - corner).norm());
        around_.look(ring, places_);
        double best = kImpossible;
        for (const Vector3& toward :
             {Vector3(middle.normalized() - corner), Vector3(size * inside.normalized())})
            for (double share = 1.0; share > 1e-9; share *= 0.6) {
                const Vector3 place = (corner + share * toward).normalized();
                const double there = around_.energy(place, area_);
                if (!(there < best)) continue;
                best = there;
                places_[to_size(v)] = place;
            }
    }

private:
    RingMesh& mesh_;
    std::vector<Vector3> places_;
    double area_ = 1.0;
    TrianglesAround around_;
};

/// Takes vertices away until four are left.
std::vector<RingMesh::Removal> taken_apart(RingMesh& mesh, const Positions& positions,
                                           std::vector<char>& present) {
    const auto count = to_index(positions.rows());
    std::vector<RingMesh::Removal> removals;
    // The cheapest way to remove each vertex; found anew where something has changed.
    Values costs = Values::Constant(count, kImpossible);
    std::vector<Index> cheapest(to_size(count), -1);
    const auto look = [&](Index v) {
        const auto ring = mesh.ring(v);
        double& least = costs[v];
        least = kImpossible;
        constexpr double kValence = 6.0;
        for (const Index into : ring) {
            const double size = static_cast<double>(std::max(ring.size(), mesh.ring(into).size()));
            const double cost = (positions.row(v) - positions.row(into)).norm() *
                                (1.0 + 0.3 * std::max(0.0, size - kValence));
            if (cost < least && mesh.can_remove(v, into)) {
                least = cost;
                cheapest[to_size(v)] = into;
            }
        }
    };
    for (Index v = 0; v < count; ++v) look(v);
    std::vector<Index> changed;
    for (Index left = count; left > 4; --left) {
        const double least = costs.minCoeff();  // in wide registers
        const auto v = to_index(std::ranges::find(costs, least) - costs.begin());
        removals.push_back(mesh.remove(v, cheapest[to_size(v)]));
        present[to_size(v)] = 0;
        costs[v] = kImpossible;
        // Rings of those around, and what is joined to them, are others now.
        changed.assign(removals.back().ring.begin(), removals.back().ring.end());
        for (const Index r : removals.back().ring)
            changed.insert(changed.end(), mesh.ring(r).begin(), mesh.ring(r).end());
        std::ranges::sort(changed);
        const auto [end, rest] = std::ranges::unique(changed);
        std::for_each(changed.begin(), end, look);
    }
    return removals;
}

}  // namespace

struct Roundness::Block {
    static constexpr std::size_t kSize = 32;
    using Column = std::array<double, kSize>;
    std::array<std::array<Column, 3>, 3> at;  ///< by corner and axis
    Column d, dirichlet, growth;
};

Roundness::Roundness(std::span<const Triangle> triangles, double weight)
    : triangles_(triangles),
      weight_(weight),
      area_(4.0 * std::numbers::pi / static_cast<double>(triangles.size())) {}

double Roundness::at(const Positions& places) const {
    double sum = 0.0;
    Block block;
    for (std::size_t first = 0; first < triangles_.size(); first += Block::kSize) {
        const std::size_t count = fill(block, places, first);
        for (std::size_t k = 0; k < count; ++k) {
            if (!(block.d[k] > 0.0)) return kImpossible;
            sum += weight_ * (block.dirichlet[k] * block.growth[k]);
        }
    }
    return sum;
}

void Roundness::add_gradient(const Positions& places, Positions& gradient) const {
    Block block;
    std::array<std::array<Block::Column, 3>, 3> slopes;  // by corner and axis
    for (std::size_t first = 0; first < triangles_.size(); first += Block::kSize) {
        const std::size_t count = fill(block, places, first);
        for (std::size_t corner = 0; corner < 3; ++corner) {
            const auto &a = block.at[corner], &b = block.at[(corner + 1) % 3],
                       &c = block.at[(corner + 2) % 3];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const std::size_t y = (axis + 1) % 3, z = (axis + 2) % 3;
                for (std::size_t k = 0; k < Block::kSize; ++k) {
                    const double d = block.d[k];
                    const double by_d = -block.dirichlet[k] / (d * d * d * area_);
                    slopes[corner][axis][k] = 2.0 * kHalfCotangent * block.growth[k] *
                                                  (2.0 * a[axis][k] - b[axis][k] - c[axis][k]) +
                                              by_d * (b[y][k] * c[z][k] - b[z][k] * c[y][k]);
                }
            }
        }
        for (std::size_t k = 0; k < count; ++k)
            for (std::size_t corner = 0; corner < 3; ++corner)
                for (std::size_t axis = 0; axis < 3; ++axis)
                    gradient(triangles_[first + k][corner], static_cast<Eigen::Index>(axis)) +=
                        weight_ * slopes[corner][axis][k];
    }
}

/// The last triangle again where there are fewer. Returns how many there are.
std::size_t Roundness::fill(Block& block, const Positions& places, std::size_t first) const {
    const std::size_t count = std::min(Block::kSize, triangles_.size() - first);
    for (std::size_t k = 0; k < Block::kSize; ++k) {
        const Triangle& triangle = triangles_[first + std::min(k, count - 1)];
        for (std::size_t corner = 0; corner < 3; ++corner)
            for (std::size_t axis = 0; axis < 3; ++axis)
                block.at[corner][axis][k] =
                    places(triangle[corner], static_cast<Eigen::Index>(axis));
    }
    const auto& [a, b, c] = block.at;
    const double twice = 2.0 * area_;
    for (std::size_t k = 0; k < Block::kSize; ++k) {
        const auto squared = [k](const auto& from, const auto& to) {
            const double x = to[0][k] - from[0][k], y = to[1][k] - from[1][k],
                         z = to[2][k] - from[2][k];
            return x * x + y * y + z * z;
        };
        const double x = b[1][k] * c[2][k] - b[2][k] * c[1][k],
                     y = b[2][k] * c[0][k] - b[0][k] * c[2][k],
                     z = b[0][k] * c[1][k] - b[1][k] * c[0][k];
        const double d = (a[0][k] * x + a[1][k] * y + a[2][k] * z) / twice;
        block.d[k] = d;
        block.dirichlet[k] = kHalfCotangent * (squared(a, b) + squared(b, c) + squared(c, a));
        block.growth[k] = 1.0 + 1.0 / (d * d);
    }
    return count;
}

Positions embed_on_sphere(RingMesh mesh, const Positions& positions, Progress& progress) {
    constexpr double kGrowth = 1.15;
    constexpr int kSweeps = 8, kLastSweeps = 24;
    const auto count = to_index(positions.rows());
    std::vector<char> present(to_size(count), 1);
    const std::vector<RingMesh::Removal> removals = taken_apart(mesh, positions, present);

    Embedding places(mesh, count);
    const auto area_of = [](Index vertices) { return 4.0 * std::numbers::pi / (2 * vertices - 4); };
    Index first = 0;
    while (!present[to_size(first)]) ++first;
    const auto ring = mesh.ring(first);
    const double s = std::numbers::inv_sqrt3;
    places[first] = {s, s, s};
    places[ring[0]] = {-s, s, -s};
    places[ring[1]] = {-s, -s, s};
    places[ring[2]] = {s, -s, -s};

    const auto sweep = [&](int steps) {
        for (Index v = 0; v < count; ++v)
            if (present[to_size(v)]) places.improve(v, steps);
        progress.throw_if_cancelled();
    };
    Index now = 4;
    double next = 8.0;
    for (auto k = removals.size(); k-- > 0;) {
        const Index v = removals[k].vertex;
        mesh.restore(removals[k]);
        present[to_size(v)] = 1;
        places.set_area(area_of(++now));
        places.put_into_ring(v);
        places.improve(v, 3);
        for (const Index r : mesh.ring(v)) places.improve(r, 1);
        places.improve(v, 1);
        if (now >= next) {
            for (int i = 0; i < kSweeps; ++i) sweep(1);
            next = kGrowth * now;
            progress.report(0.3 + 0.6 * now / count);
        }
    }
    for (int i = 0; i < kLastSweeps; ++i) sweep(1);
    Positions result(count, 3);
    for (Index v = 0; v < count; ++v) result.row(v) = places[v].transpose();
    return result;
}

}  // namespace pointmorph
