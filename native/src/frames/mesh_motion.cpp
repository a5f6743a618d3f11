#include "pointmorph/frames/mesh_motion.hpp"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
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

/// What a triangle does on the whole way: a turn after a symmetric stretch.
struct Move {
    Turn turn;
    Matrix3 stretch = Matrix3::Identity();

    Matrix3 at(double t) const {
        return turn.at(t) * ((1.0 - t) * Matrix3::Identity() + t * stretch);
    }
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

/// Sides from the first corner, and the normal at rest, where every triangle has an area.
Matrix3 rest_frame(const Mesh& mesh, Index f) {
    const auto t = mesh.triangles.row(f);
    const Positions& x = mesh.positions;
    Matrix3 frame;
    frame << (x.row(t[1]) - x.row(t[0])).transpose(), (x.row(t[2]) - x.row(t[0])).transpose(),
        mesh.normals.row(f).transpose();
    return frame;
}

/// The same elsewhere. The normal is the triangle's own, or that of its surroundings where it has
/// no area.
Matrix3 end_frame(const Mesh& mesh, const Positions& x, const Normals& normals, Index f) {
    const auto t = mesh.triangles.row(f);
    const Vector3 u = (x.row(t[1]) - x.row(t[0])).transpose();
    const Vector3 v = (x.row(t[2]) - x.row(t[0])).transpose();
    Vector3 normal = u.cross(v);
    constexpr double kThin = 1e-6;
    if (!(normal.norm() > kThin * std::max(u.squaredNorm(), v.squaredNorm())))
        normal = (normals.row(t[0]) + normals.row(t[1]) + normals.row(t[2])).transpose();
    Matrix3 frame;
    frame << u, v, normal.normalized();
    return frame;
}

/// Triangles that share an edge turn the same way round: from the one that turns least in each
/// part, over the edges where turns differ least.
void make_turns_agree(const Triangles& triangles, std::vector<Move>& moves) {
    const MeshEdges edges(triangles);
    const auto count = to_index(moves.size());
    std::vector<Index> order(to_size(count));
    for (Index f = 0; f < count; ++f) order[to_size(f)] = f;
    std::ranges::stable_sort(order, {},
                             [&](Index f) { return moves[to_size(f)].turn.whole.norm(); });
    using Step = std::pair<double, std::pair<Index, Index>>;  // difference; to, from
    std::priority_queue<Step, std::vector<Step>, std::greater<>> steps;
    std::vector<char> is_done(to_size(count), 0);
    const auto finish = [&](Index f) {
        is_done[to_size(f)] = 1;
        for (Index k = 0; k < 3; ++k)
            for (const MeshEdges::Side& side : edges[edges.edge_of(f, k)]) {
                const Index other = side.triangle;
                if (is_done[to_size(other)]) continue;
                const Turn &here = moves[to_size(f)].turn, &there = moves[to_size(other)].turn;
                steps.push({turn_near(there.whole, here).apart(here), {other, f}});
            }
    };
    for (const Index seed : order) {
        if (is_done[to_size(seed)]) continue;
        finish(seed);
        while (!steps.empty()) {
            const auto [f, from] = steps.top().second;
            steps.pop();
            if (is_done[to_size(f)]) continue;
            Turn& turn = moves[to_size(f)].turn;
            turn = turn_near(turn.whole, moves[to_size(from)].turn);
            finish(f);
        }
    }
}

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
        const Normals end_normals = sheet.normals(ends, progress);
        parallel_for(to_index(moves.size()), progress, [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f) {
                const Matrix3 linear =
                    end_frame(mesh, ends, end_normals, f) * rest_frame(mesh, f).inverse();
                const Matrix3 rotation = best_rotation(linear).rotation;
                const Matrix3 stretch = rotation.transpose() * linear;
                moves[to_size(f)] = {{turn_of(rotation), Vector3::Zero()},
                                     0.5 * (stretch + stretch.transpose())};
            }
        });
        make_turns_agree(mesh.triangles, moves);
        find_least(ends, progress);
        // What a surface of a million places takes would be a gigabyte.
        constexpr Index kMost = 400000;
        if (mesh.positions.rows() <= kMost) factorize(progress);
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
        const Matrix3 now =
            ((1.0 - t) * Matrix3::Identity() + t * moves[to_size(f)].stretch) * rest_frame(mesh, f);
        const Vector3 u = now.col(0), v = now.col(1);
        Matrix2 sides;
        sides << u.norm(), u.dot(v) / u.norm(), 0.0, u.cross(v).norm() / u.norm();
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

    /// Of the triangles: the cosine between each and the planes at its corners; 1 without an area.
    std::vector<double> agreements(const Normals& planes, const Positions& x,
                                   Progress& progress) const {
        std::vector<double> result(moves.size(), 1.0);
        parallel_for(to_index(moves.size()), progress, [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f) {
                const Vector3 normal = facing_of(sheet.places(x, f));
                Vector3 plane = Vector3::Zero();
                for (Index k = 0; k < 3; ++k) plane += planes.row(mesh.triangles(f, k)).transpose();
                if (const double length = normal.norm() * plane.norm(); length > 0.0)
                    result[to_size(f)] = normal.dot(plane) / length;
            }
        });
        return result;
    }

    /// Twice the area of a triangle, toward where it faces.
    static Vector3 facing_of(const ElasticSheet::Corners& corners) {
        return (corners.col(1) - corners.col(0)).cross(Vector3(corners.col(2) - corners.col(0)));
    }

    /// What lies against its surroundings at an end may do so on the way.
    void find_least(const Positions& ends, Progress& progress) {
        constexpr double kNever = -2.0, kRounding = 1e-6;
        least.assign(moves.size(), kSteep);
        for (const Positions* x : {&mesh.positions, &ends}) {
            const std::vector<double> now =
                agreements(planes(facings_at(*x), progress), *x, progress);
            for (std::size_t f = 0; f < now.size(); ++f)
                least[f] = std::min(least[f], now[f] < kRounding ? kNever : now[f] - kRounding);
        }
    }

    /// Where triangles face at `x`.
    std::vector<Vector3> facings_at(const Positions& x) const {
        std::vector<Vector3> result(moves.size());
        for (Index f = 0; f < to_index(result.size()); ++f)
            result[to_size(f)] = facing_of(sheet.places(x, f));
        return result;
    }

    /// Turns triangles back that lie against where those around would face, and then those that lie
    /// against where they do; but for what does so at one of the ends.
    void turn_back(double t, const std::vector<Vector3>& facing, Positions& x,
                   Progress& progress) const {
        WrapPartners onto{x, planes(facing, progress)};
        std::vector<double> now;
        const auto find = [&] {
            now = agreements(onto.normals, x, progress);
            return std::ranges::mismatch(now, least, std::greater_equal<>{}).in1 != now.end();
        };
        UntangleOptions options;
        options.plane_length *= std::sqrt(mesh.area());
        options.concerns = [&](Index f) { return now[to_size(f)] < least[to_size(f)]; };
        options.sides = [&](Index f) { return sides_at(f, t); };
        options.is_exact = true;
        // Nothing jumps when a triangle begins to be turned back: in full once it lies against.
        options.share = [&](Index f) {
            const double steep = least[to_size(f)];
            return std::clamp((steep - now[to_size(f)]) / steep, 0.0, 1.0);
        };
        const std::vector<char> none(to_size(x.rows()), 0);
        constexpr int kRounds = 3;
        for (int round = 0; round < kRounds && find(); ++round)
            untangle(mesh, sheet, onto, none, options, x, progress);
        for (int round = 0; round < kRounds; ++round) {
            onto = {x, planes(facings_at(x), progress)};
            if (!find()) return;
            untangle(mesh, sheet, onto, none, options, x, progress);
        }
    }

    /// Places at t; each part about where `around` has it.
    Positions at(double t, const Positions& around, Progress& progress) const {
        std::vector<Vector3> facing(moves.size());  // where each triangle's own move has it face
        const Positions right = sheet.forces_toward(
            [&](Index f) {
                const ElasticSheet::Corners corners =
                    moves[to_size(f)].at(t) * sheet.places(mesh.positions, f);
                facing[to_size(f)] = facing_of(corners);
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
        turn_back(t, facing, x, progress);
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
    return gather(part.apply(mesh.unit.restore(bend_->at(t, around, progress))), mesh.places);
}

}  // namespace pointmorph
