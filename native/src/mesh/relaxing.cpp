#include "mesh/relaxing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "mesh/creases.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

class Relaxing {
public:
    Relaxing(const Mesh& mesh, ElasticSheet& sheet, const RelaxGround& ground, Positions& x)
        : mesh_(mesh),
          sheet_(sheet),
          ground_(ground),
          creases_(mesh, sheet),
          sides_(ground.sides),
          x_(x) {}

    void slide(Progress& progress) {
        const Positions forces = sheet_.forces(x_, sides_, 1.0, progress);
        Positions next = x_;
        Normals sides = sides_;
        const auto count = to_index(x_.rows());
        parallel_for(count, progress, [&](Index begin, Index end) {
            for (Index v = begin; v < end; ++v) {
                if (ground_.is_fixed[to_size(v)] || sheet_.around(v).empty()) continue;
                const auto [place, normal] = slid(v, forces.row(v).transpose());
                next.row(v) = place.transpose();
                sides.row(v) = normal.transpose();
            }
        });
        keep_back(next, sides, progress);
        x_ = std::move(next);
        sides_ = std::move(sides);
    }

private:
    /// Where a vertex would go, and the surface's normal there.
    std::pair<Vector3, Vector3> slid(Index v, const Vector3& force) const {
        constexpr double kStep = 0.5;  // all the way, neighbors would swing past each other
        const Laplacian& laplacian = sheet_.laplacian();
        const Vector3 place = x_.row(v).transpose(), side = sides_.row(v).transpose();
        Vector3 way = force;
        for (Index k = laplacian.offsets[to_size(v)]; k < laplacian.offsets[to_size(v) + 1]; ++k)
            way += laplacian.weights[to_size(k)] *
                   (x_.row(laplacian.neighbors[to_size(k)]) - x_.row(v)).transpose();
        way *= kStep / laplacian.sums[to_size(v)];
        way -= way.dot(side) * side;
        const Vector3 there = place + way;
        const auto [on, normal] = ground_.landed(v, there, side);
        if (ground_.is_onto) return {on, normal};
        return {on + place - ground_.landed(v, place, side).first, normal};
    }

    /// Whether a face is worse at `next` than at `x_`.
    bool is_worse(Index f, const Positions& next, const Normals& sides) const {
        constexpr double kAgree = 0.3, kLeastArea = 0.25;
        const auto corners = mesh_.triangles.row(f);
        const Vector3 then = creases_.facing(next, f), now = creases_.facing(x_, f);
        if (then.norm() < kLeastArea * now.norm()) return true;
        const auto agreement = [&](const Vector3& facing, const Normals& planes) {
            const Eigen::RowVector3d plane =
                planes.row(corners[0]) + planes.row(corners[1]) + planes.row(corners[2]);
            const double lengths = facing.norm() * plane.norm();
            return lengths > 0.0 ? facing.dot(plane.transpose()) / lengths : 0.0;
        };
        const double agrees = agreement(then, sides);
        if (agrees < kAgree && agrees < agreement(now, sides_)) return true;
        return creases_.of_face(next, f) > creases_.of_face(x_, f);
    }

    /// Takes vertices back to where they were until no face is worse.
    void keep_back(Positions& next, Normals& sides, Progress& progress) const {
        take_back(
            mesh_, sheet_, [&](Index f) { return is_worse(f, next, sides); },
            [&](Index v) {
                if (next.row(v) == x_.row(v) && sides.row(v) == sides_.row(v)) return false;
                next.row(v) = x_.row(v);
                sides.row(v) = sides_.row(v);
                return true;
            },
            progress);
    }

    const Mesh& mesh_;
    ElasticSheet& sheet_;
    const RelaxGround& ground_;
    Creases creases_;
    Normals sides_;
    Positions& x_;
};

}  // namespace

void relax(const Mesh& mesh, ElasticSheet& sheet, const RelaxGround& ground, Index iterations,
           Positions& x, Progress& progress) {
    if (iterations == 0) return;
    const int sweeps = static_cast<int>(std::min<Index>(iterations, 60));
    sheet.set_metric(x, sweeps, progress);
    Relaxing relaxing(mesh, sheet, ground, x);
    for (Index i = 0; i < iterations; ++i) relaxing.slide(progress);
}

}  // namespace pointmorph
