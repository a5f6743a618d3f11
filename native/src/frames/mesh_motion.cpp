#include "pointmorph/frames/mesh_motion.hpp"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <queue>
#include <utility>

#include "base/angle.hpp"
#include "mesh/elastic_sheet.hpp"
#include "mesh/mesh_edges.hpp"
#include "mesh/untangling.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

/// By t of a vector as long as its angle.
Matrix3 rotation_by(const Vector3& turn, double t) {
    const double angle = turn.norm();
    const Vector3 axis = angle > 0.0 ? Vector3(turn / angle) : Vector3(Vector3::UnitX());
    return Eigen::AngleAxisd(t * angle, axis).toRotationMatrix();
}

Vector3 turn_of(const Matrix3& rotation) {
    const Eigen::AngleAxisd turn = angle_axis(rotation);
    return turn.angle() * turn.axis();
}

/// A rotation in two parts, vectors as long as their angles: a turn, which may be more than half a
/// turn, and what is left after it.
struct Turn {
    Vector3 whole = Vector3::Zero(), rest = Vector3::Zero();

    Matrix3 at(double t) const {
        const Matrix3 rotation = rotation_by(whole, t);
        return rest.isZero(0.0) ? rotation : Matrix3(rotation_by(rest, t) * rotation);
    }
    double apart(const Turn& other) const {
        return (whole - other.whole).norm() + (rest - other.rest).norm();
    }
};

/// Sides of a triangle from its first corner.
using Sides = Eigen::Matrix<double, 3, 2>;

Sides sides_of(const ElasticSheet::Corners& corners) {
    Sides sides;
    sides << corners.col(1) - corners.col(0), corners.col(2) - corners.col(0);
    return sides;
}

/// Twice the area of a triangle, toward where it faces.
Vector3 facing_of(const Sides& sides) {
    return sides.col(0).cross(Vector3(sides.col(1)));
}

/// What a triangle does on the whole way: a turn, after its sides have changed straight into those
/// that it has in the end before the turn.
struct Move {
    Turn turn;
    Sides unturned = Sides::Zero();
    bool is_sure = true;  ///< its sides say how it turns

    Sides unturned_at(double t, const Sides& rest) const { return (1.0 - t) * rest + t * unturned; }
};

/// The vector of the same turn, with whole turns more or less, that is nearest to another.
Vector3 lifted(const Vector3& turn, const Vector3& other) {
    constexpr double kNone = 1e-9;
    const double angle = turn.norm();
    if (angle < kNone) {
        const double length = other.norm();
        return length > kNone ? Vector3(other / length * (kTurn * std::round(length / kTurn)))
                              : turn;
    }
    const Vector3 axis = turn / angle;
    return turn + axis * (kTurn * std::round((axis.dot(other) - angle) / kTurn));
}

/// A rotation of at most half a turn as the turn that is nearest to another one. Near whole turns
/// its own axis may be any: what of it is about the other's axis comes first there, and then the
/// rest.
Turn turn_near(const Vector3& rotation, const Turn& other) {
    const Turn single{lifted(rotation, other.whole), Vector3::Zero()};
    const double length = other.whole.norm();
    if (!(length > 0.5 * kTurn)) return single;
    const Vector3 axis = other.whole / length;
    const Matrix3 matrix = rotation_by(rotation, 1.0);
    const Eigen::Quaterniond all(matrix);
    const double about = 2.0 * angle_of(all.vec().dot(axis), all.w());
    const double whole = about + kTurn * std::round((length - about) / kTurn);
    const Turn split{whole * axis, turn_of(matrix * rotation_by(axis, -about))};
    return split.apart(other) < single.apart(other) ? split : single;
}

/// Which way the plane that a triangle lies in faces, `around` what is around it. A triangle that
/// lies against that doesn't turn over on the way, but collapses and comes out on the other side;
/// the normal of one without a width is chance.
Vector3 plane_normal(const Sides& sides, const Vector3& around) {
    constexpr double kThin = 0.02;
    const Vector3 own = facing_of(sides);
    const double area = own.norm();
    const double longest = std::max({sides.col(0).squaredNorm(), sides.col(1).squaredNorm(),
                                     (sides.col(1) - sides.col(0)).squaredNorm()});
    if (!(area > 0.0)) return around;
    if (!(around.norm() > 0.0)) return own / area;
    const double share = std::min(1.0, area / (kThin * longest));
    const double toward = own.dot(around) < 0.0 ? -1.0 : 1.0;
    return (share * toward / area * own + (1.0 - share) * around).normalized();
}

/// Axes of a plane as columns, the first one along `along`, and its normal.
Matrix3 axes_of(const Vector3& normal, const Vector3& along) {
    const Vector3 within = along - along.dot(normal) * normal;
    const double length = within.norm();
    const Vector3 first =
        length > 1e-9 * along.norm() ? Vector3(within / length) : Vector3(normal.unitOrthogonal());
    Matrix3 axes;
    axes << first, normal.cross(first), normal;
    return axes;
}

/// The move of a triangle between planes across `normals`: within these it turns as its sides do on
/// the average, by their weights, so that slivers turn as their long sides.
Move move_between(const Sides& rest, const Sides& end, const std::array<Vector3, 2>& normals,
                  const Vector3& weights) {
    const Matrix3 turn =
        Eigen::Quaterniond::FromTwoVectors(normals[0], normals[1]).toRotationMatrix();
    const Matrix3 from = axes_of(normals[0], rest.col(0)), to = turn * from;
    const Sides first = from.transpose() * rest, last = to.transpose() * end;
    const auto side = [](const Sides& sides, int k) -> Eigen::Vector2d {
        if (k == 0) return sides.col(0).head<2>();
        return k == 1 ? Eigen::Vector2d((sides.col(1) - sides.col(0)).head<2>())
                      : Eigen::Vector2d(-sides.col(1).head<2>());
    };
    double along = 0.0, across = 0.0, all = 0.0;
    for (int k = 0; k < 3; ++k) {
        const Eigen::Vector2d is = side(first, k), becomes = side(last, k);
        along += weights[k] * is.dot(becomes);
        across += weights[k] * (is[0] * becomes[1] - is[1] * becomes[0]);
        all += weights[k] * is.squaredNorm();
    }
    constexpr double kCollapsed = 0.02;
    const Matrix3 within =
        Eigen::AngleAxisd(angle_of(across, along), normals[1]).toRotationMatrix();
    Move move;
    move.turn.whole = turn_of(within * turn);
    move.is_sure = Eigen::Vector2d(along, across).norm() > kCollapsed * all;
    return move;
}

/// The turn by whole turns more or less that goes on from a neighbor's. What is far from that
/// either way, as beyond a fold of about half a turn that comes to lie on its other side, turns
/// least.
Turn lifted_beside(const Vector3& rotation, const Turn& neighbor) {
    constexpr double kGoesOn = kTurn / 3.0;
    const Turn turn = turn_near(rotation, neighbor);
    return turn.apart(neighbor) < kGoesOn ? turn : Turn{rotation, Vector3::Zero()};
}

/// Triangles that share an edge turn the same way round: from the one that turns least in each
/// part, over the edges where turns differ least. Those that collapse turn as their neighbors.
void make_turns_agree(const Triangles& triangles, std::vector<Move>& moves) {
    const MeshEdges edges(triangles);
    const auto count = to_index(moves.size());
    std::vector<Index> order(to_size(count));
    for (Index f = 0; f < count; ++f) order[to_size(f)] = f;
    std::ranges::stable_sort(order, {}, [&](Index f) {
        const Move& move = moves[to_size(f)];
        return std::pair(!move.is_sure, move.turn.whole.norm());
    });
    using Step = std::pair<double, std::pair<Index, Index>>;  // difference; to, from
    std::priority_queue<Step, std::vector<Step>, std::greater<>> steps;
    std::vector<char> is_done(to_size(count), 0);
    const auto finish = [&](Index f) {
        is_done[to_size(f)] = 1;
        for (Index k = 0; k < 3; ++k)
            for (const MeshEdges::Side& side : edges[edges.edge_of(f, k)]) {
                const Index other = side.triangle;
                if (is_done[to_size(other)]) continue;
                const Turn& here = moves[to_size(f)].turn;
                const Move& there = moves[to_size(other)];
                const double apart =
                    there.is_sure ? turn_near(there.turn.whole, here).apart(here) : 0.0;
                steps.push({apart, {other, f}});
            }
    };
    for (const Index seed : order) {
        if (is_done[to_size(seed)]) continue;
        finish(seed);
        while (!steps.empty()) {
            const auto [f, from] = steps.top().second;
            steps.pop();
            if (is_done[to_size(f)]) continue;
            Move& move = moves[to_size(f)];
            const Turn& other = moves[to_size(from)].turn;
            move.turn = move.is_sure ? lifted_beside(move.turn.whole, other) : other;
            finish(f);
        }
    }
}

/// Which way the planes of triangles face at some places.
class PlaneNormals {
public:
    PlaneNormals(const ElasticSheet& sheet, const Mesh& mesh, const Positions& x,
                 Progress& progress)
        : mesh_(mesh),
          of_places_(sheet.normals(x, progress)),
          of_parts_(Normals::Zero(mesh.part_areas.size(), 3)) {
        const Eigen::Index parts = mesh.part_areas.size();
        Positions centers = Positions::Zero(parts, 3);
        Values counts = Values::Zero(parts), heights = Values::Zero(parts),
               sizes = Values::Zero(parts);
        Values facing_apart = Values::Zero(parts);
        for (Index f = 0; f < to_index(mesh.triangles.rows()); ++f) {
            const Vector3 facing = facing_of(sides_of(sheet.places(x, f)));
            of_parts_.row(part_of(f)) += facing.transpose();
            facing_apart[part_of(f)] += facing.norm();
        }
        // The sides of a thin plate cancel each other.
        constexpr double kOneSided = 0.1;
        for (Eigen::Index p = 0; p < parts; ++p) {
            const double length = of_parts_.row(p).norm();
            if (length > kOneSided * facing_apart[p])
                of_parts_.row(p) /= length;
            else
                of_parts_.row(p).setZero();
        }
        const auto each = [&](auto&& take) {
            for (Index v = 0; v < x.rows(); ++v)
                if (const Index part = mesh.parts[to_size(v)]; part >= 0) take(v, part);
        };
        each([&](Index v, Index part) {
            centers.row(part) += x.row(v);
            counts[part] += 1.0;
        });
        each([&](Index v, Index part) {
            const Eigen::RowVector3d off = x.row(v) - centers.row(part) / counts[part];
            heights[part] = std::max(heights[part], std::abs(off.dot(of_parts_.row(part))));
            sizes[part] = std::max(sizes[part], off.norm());
        });
        constexpr double kFlat = 0.01;
        for (Eigen::Index p = 0; p < parts; ++p)
            is_flat_.push_back(heights[p] <= kFlat * sizes[p] && !of_parts_.row(p).isZero(0.0));
    }

    /// Whether the triangle's part lies in a plane, within a hundredth of its size.
    bool is_flat(Index f) const { return is_flat_[to_size(part_of(f))]; }

    Vector3 of(Index f, const Sides& sides, bool in_flat) const {
        if (in_flat) return of_parts_.row(part_of(f)).transpose();
        Vector3 around = Vector3::Zero();
        for (Index k = 0; k < 3; ++k) around += of_places_.row(mesh_.triangles(f, k)).transpose();
        if (const double length = around.norm(); length > 0.0) around /= length;
        return plane_normal(sides, around);
    }

private:
    Index part_of(Index f) const { return mesh_.parts[to_size(mesh_.triangles(f, 0))]; }

    const Mesh& mesh_;
    Normals of_places_, of_parts_;
    std::vector<char> is_flat_;
};

}  // namespace

/// In the lengths of the mesh, without the similarity.
struct MeshMotion::Bend {
    /// Triangles that agree less with their surroundings than by this cosine begin to be turned
    /// back.
    static constexpr double kSteep = 0.1;

    const Mesh& mesh;
    ElasticSheet sheet;
    std::vector<Move> moves;  ///< of the triangles
    /// Of the triangles: those that agree less with their surroundings on the way are turned back.
    /// Never at an end.
    std::vector<double> least;
    using Matrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;
    /// Of the Laplacian with a place of each part held; none where it would take long.
    std::unique_ptr<Eigen::SimplicialLDLT<Matrix>> solver;

    Bend(const Mesh& rest, const Positions& ends, Progress& progress)
        : mesh(rest),
          sheet(rest.positions, rest.triangles, progress),
          moves(to_size(rest.triangles.rows())) {
        find_moves(ends, progress);
        find_least(ends, progress);
        // What a surface of a million places takes would be a gigabyte.
        constexpr Index kMost = 400000;
        if (mesh.positions.rows() <= kMost) factorize(progress);
    }

    void find_moves(const Positions& ends, Progress& progress) {
        const PlaneNormals before(sheet, mesh, mesh.positions, progress),
            after(sheet, mesh, ends, progress);
        parallel_for(to_index(moves.size()), progress, [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f) {
                const Sides from = sides_of(sheet.places(mesh.positions, f)),
                            to = sides_of(sheet.places(ends, f));
                const bool is_flat = before.is_flat(f) && after.is_flat(f);
                moves[to_size(f)] =
                    move_between(from, to, {before.of(f, from, is_flat), after.of(f, to, is_flat)},
                                 sheet.weights(f));
            }
        });
        make_turns_agree(mesh.triangles, moves);
        parallel_for(to_index(moves.size()), progress, [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f) {
                Move& move = moves[to_size(f)];
                move.unturned = move.turn.at(1.0).transpose() * sides_of(sheet.places(ends, f));
            }
        });
    }

    void factorize(Progress& progress) {
        const Laplacian& laplacian = sheet.laplacian();
        std::vector<char> is_held(to_size(mesh.part_areas.size()), 0);
        std::vector<Eigen::Triplet<double, Index>> entries;
        for (Index i = 0; i < laplacian.size(); ++i) {
            const Index part = mesh.parts[to_size(i)];
            const bool is_first = part < 0 || !std::exchange(is_held[to_size(part)], 1);
            entries.emplace_back(i, i, laplacian.sums[to_size(i)] + (is_first ? 1.0 : 0.0));
            for (Index k = laplacian.offsets[to_size(i)]; k < laplacian.offsets[to_size(i) + 1];
                 ++k)
                entries.emplace_back(i, laplacian.neighbors[to_size(k)],
                                     -laplacian.weights[to_size(k)]);
        }
        Matrix matrix(laplacian.size(), laplacian.size());
        matrix.setFromTriplets(entries.begin(), entries.end());
        solver = std::make_unique<Eigen::SimplicialLDLT<Matrix>>();
        solver->analyzePattern(matrix);
        progress.report(1.0);
        solver->factorize(matrix);
        progress.report(1.0);
    }

    /// A triangle at t as its own stretch has it: sides from the first corner, in its plane.
    Matrix2 sides_at(Index f, double t) const {
        const Sides now =
            moves[to_size(f)].unturned_at(t, sides_of(sheet.places(mesh.positions, f)));
        const Vector3 u = now.col(0), v = now.col(1);
        // One that has no area now can't say how those around are to be stretched.
        constexpr double kThin = 1e-3;
        const double length = std::max(u.norm(), kThin * v.norm());
        if (!(length > 0.0)) return Matrix2::Identity();
        Matrix2 sides;
        sides << length, u.dot(v) / length, 0.0,
            std::max(u.cross(v).norm() / length, kThin * length);
        return sides;
    }

    /// Of vertices: where the triangles around would have them face.
    Normals planes(const std::vector<Vector3>& facing, Progress& progress) const {
        const Index count = sheet.laplacian().size();
        Normals result = Normals::Zero(count, 3);
        parallel_for(count, progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                for (const Index c : sheet.around(v))
                    result.row(v) += facing[to_size(c / 3)].transpose();
                if (const double length = result.row(v).norm(); length > 0.0)
                    result.row(v) /= length;
            }
        });
        return result;
    }

    /// Of the triangles: the cosine between each and the planes at its corners, times its area over
    /// what that would be, where it is less; 1 without an area. It passes through zero as a
    /// triangle turns over within its plane.
    std::vector<double> agreements(const Normals& planes, const std::vector<Vector3>& facing,
                                   const Positions& x, Progress& progress) const {
        std::vector<double> result(moves.size(), 1.0);
        parallel_for(to_index(moves.size()), progress, [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f) {
                const Vector3 normal = facing_of(sides_of(sheet.places(x, f)));
                Vector3 plane = Vector3::Zero();
                for (Index k = 0; k < 3; ++k) plane += planes.row(mesh.triangles(f, k)).transpose();
                const double area = std::max(normal.norm(), facing[to_size(f)].norm());
                if (const double length = area * plane.norm(); length > 0.0)
                    result[to_size(f)] = normal.dot(plane) / length;
            }
        });
        return result;
    }

    /// What lies against its surroundings at an end may do so on the way.
    void find_least(const Positions& ends, Progress& progress) {
        constexpr double kNever = -2.0, kRounding = 1e-6;
        least.assign(moves.size(), kSteep);
        for (const Positions* x : {&mesh.positions, &ends}) {
            const std::vector<Vector3> facings = facings_at(*x);
            const std::vector<double> now =
                agreements(planes(facings, progress), facings, *x, progress);
            for (std::size_t f = 0; f < now.size(); ++f)
                least[f] = std::min(least[f], now[f] < kRounding ? kNever : now[f] - kRounding);
        }
    }

    /// Where triangles face at `x`.
    std::vector<Vector3> facings_at(const Positions& x) const {
        std::vector<Vector3> result(moves.size());
        for (Index f = 0; f < to_index(result.size()); ++f)
            result[to_size(f)] = facing_of(sides_of(sheet.places(x, f)));
        return result;
    }

    /// Which triangles and vertices a walk over the mesh has passed; made when one begins.
    struct Passed {
        std::vector<Index> triangles, vertices;  ///< the walk that passed each last
        Index walk = 0;

        void begin(const Mesh& mesh) {
            triangles.resize(to_size(mesh.triangles.rows()), 0);
            vertices.resize(to_size(mesh.positions.rows()), 0);
            ++walk;
        }
        bool pass_triangle(Index f) { return std::exchange(triangles[to_size(f)], walk) != walk; }
        bool pass_vertex(Index v) { return std::exchange(vertices[to_size(v)], walk) != walk; }
    };

    /// 1 where what gives way around a triangle is a small piece of its part, which the rest holds;
    /// down to 0 where it would be much of the part, as on coarse meshes: nothing would say where
    /// that goes.
    double locality(Index f, int rings, Passed& passed) const {
        constexpr double kSmall = 0.05, kMuch = 0.1;
        const double whole = mesh.part_areas[mesh.parts[to_size(mesh.triangles(f, 0))]];
        passed.begin(mesh);
        passed.pass_triangle(f);
        std::vector<Index> front{f}, next;
        double area = mesh.areas[f];
        for (int ring = 0; ring < rings && area < kMuch * whole; ++ring) {
            next.clear();
            for (const Index face : front)
                for (const Index v : mesh.triangles.row(face)) {
                    if (!passed.pass_vertex(v)) continue;  // all around it are inside
                    for (const Index c : sheet.around(v))
                        if (passed.pass_triangle(c / 3)) next.push_back(c / 3);
                }
            for (const Index face : next) area += mesh.areas[face];
            front.swap(next);
        }
        return std::clamp((kMuch - area / whole) / (kMuch - kSmall), 0.0, 1.0);
    }

    /// Of triangles: how far each is turned back at `x`. Nothing jumps when one begins to be: in
    /// full once it lies against.
    std::vector<double> shares(const std::vector<Vector3>& facing, const WrapPartners& onto,
                               int rings, const Positions& x, Progress& progress) const {
        std::vector<double> result = agreements(onto.normals, facing, x, progress);
        const Index count = to_index(result.size());
        // A few at least, since what has been passed is as long as the mesh.
        const Index chunk = std::max<Index>(512, count / 64);
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                Passed passed;
                for (Index f = begin; f < end; ++f) {
                    double& share = result[to_size(f)];
                    share = std::clamp((least[to_size(f)] - share) / kSteep, 0.0, 1.0);
                    if (share > 0.0) share *= locality(f, rings, passed);
                }
            },
            0.0, 1.0, chunk);
        return result;
    }

    /// Turns triangles back that lie against where those around would face, and then those that lie
    /// against where they do; but for what does so at one of the ends.
    void turn_back(double t, std::vector<Vector3> facing, Positions& x, Progress& progress) const {
        WrapPartners onto{x, planes(facing, progress)};
        std::vector<double> share;
        UntangleOptions options;
        const double size = std::sqrt(mesh.area());
        options.plane_length *= size;
        options.reach = 0.1 * size;
        options.least_agreement = 2.0;  // those of which there is a share
        options.concerns = [&](Index f) { return share[to_size(f)] > 0.0; };
        options.sides = [&](Index f) { return sides_at(f, t); };
        options.is_exact = true;
        options.share = [&](Index f) { return share[to_size(f)]; };
        const std::vector<char> none(to_size(x.rows()), 0);
        const auto is_done = [&] {
            share = shares(facing, onto, options.rings, x, progress);
            return std::ranges::all_of(share, [](double s) { return s == 0.0; });
        };
        constexpr int kRounds = 3;
        for (int round = 0; round < kRounds && !is_done(); ++round)
            untangle(mesh, sheet, onto, none, options, x, progress);
        for (int round = 0; round < kRounds; ++round) {
            facing = facings_at(x);
            onto = {x, planes(facing, progress)};
            if (is_done()) return;
            untangle(mesh, sheet, onto, none, options, x, progress);
        }
    }

    /// Places at t; each part about where `around` has it.
    Positions at(double t, const Positions& around, Progress& progress) const {
        std::vector<Vector3> facing(moves.size());  // where each triangle's own move has it face
        const Positions right = sheet.forces_toward(
            [&](Index f) {
                const Move& move = moves[to_size(f)];
                ElasticSheet::Corners corners = ElasticSheet::Corners::Zero();
                corners.rightCols<2>() =
                    move.turn.at(t) *
                    move.unturned_at(t, sides_of(sheet.places(mesh.positions, f)));
                facing[to_size(f)] = facing_of(corners.rightCols<2>());
                return corners;
            },
            progress);
        Positions x = around;
        if (solver) {
            const Eigen::MatrixX3d solution = solver->solve(Eigen::MatrixX3d(right));
            x = solution;
        } else {
            const std::vector<SymmetricBlock> none(to_size(x.rows()));
            solve(sheet.laplacian(), none, right, {.most_iterations = 300, .tolerance = 1e-5}, x,
                  progress);
        }
        turn_back(t, std::move(facing), x, progress);
        Positions shifts = Positions::Zero(mesh.part_areas.size(), 3);
        Values counts = Values::Zero(mesh.part_areas.size());
        for (Index p = 0; p < x.rows(); ++p) {
            const Index part = mesh.parts[to_size(p)];
            if (part < 0) continue;
            shifts.row(part) += around.row(p) - x.row(p);
            counts[part] += 1.0;
        }
        for (Index p = 0; p < x.rows(); ++p) {
            const Index part = mesh.parts[to_size(p)];
            if (part < 0)
                x.row(p) = around.row(p);
            else
                x.row(p) += shifts.row(part) / counts[part];
        }
        return x;
    }
};

MeshMotion::MeshMotion(const Mesh& mesh, const OrientedView& vertices, const Positions& ends,
                       const GradualSimilarity& similarity, PathKind path, Progress& progress)
    : similarity_(similarity),
      motion_(vertices.positions, vertices.normals, ends, similarity, path, progress) {
    if (path != PathKind::kRigid) return;
    const Positions straight = mesh.unit.apply(similarity.whole.inverse().apply(ends));
    Positions places = mesh.positions;
    for (std::size_t v = mesh.places.size(); v-- > 0;)
        places.row(mesh.places[v]) = straight.row(static_cast<Eigen::Index>(v));
    bend_ = std::make_unique<const Bend>(mesh, places, progress);
    std::vector<Index> first(to_size(mesh.positions.rows()), -1);
    for (Index v = 0; v < to_index(mesh.places.size()); ++v) {
        Index& standing = first[to_size(mesh.places[to_size(v)])];
        if (standing < 0) standing = v;
        const Eigen::RowVector3d here =
            vertices.positions.row(v) - vertices.positions.row(standing);
        const Eigen::RowVector3d there = ends.row(v) - ends.row(standing);
        if (!here.isZero(0.0) || !there.isZero(0.0)) beside_.push_back({v, here, there});
    }
}

MeshMotion::~MeshMotion() = default;
MeshMotion::MeshMotion(MeshMotion&&) noexcept = default;

Positions MeshMotion::at(double t) const {
    Progress silent;
    return at(t, silent);
}

Positions MeshMotion::at(double t, Progress& progress) const {
    Positions moved = motion_.at(t).positions;
    if (!bend_) return moved;
    const Mesh& mesh = bend_->mesh;
    const Similarity part = similarity_.at(t);
    const Positions straight = mesh.unit.apply(part.inverse().apply(moved));
    Positions around = mesh.positions;
    for (std::size_t v = mesh.places.size(); v-- > 0;)
        around.row(mesh.places[v]) = straight.row(static_cast<Eigen::Index>(v));
    moved = gather(part.apply(mesh.unit.restore(bend_->at(t, around, progress))), mesh.places);
    for (const auto& [vertex, here, there] : beside_)
        moved.row(vertex) += (1.0 - t) * here + t * there;
    return moved;
}

}  // namespace pointmorph
