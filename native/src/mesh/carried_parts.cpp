#include "mesh/carried_parts.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

std::vector<std::vector<Index>> places_of_parts(const Mesh& mesh) {
    std::vector<std::vector<Index>> places(to_size(mesh.part_areas.size()));
    for (Index p = 0; p < mesh.positions.rows(); ++p)
        if (const Index part = mesh.parts[to_size(p)]; part >= 0)
            places[to_size(part)].push_back(p);
    return places;
}

struct Ball {
    Eigen::RowVector3d middle;
    double radius;  ///< root mean square
};

Ball ball_around(const Mesh& mesh, const std::vector<Index>& places) {
    const Positions points = gather(mesh.positions, places);
    const Eigen::RowVector3d middle = points.colwise().mean();
    return {middle, std::sqrt((points.rowwise() - middle).rowwise().squaredNorm().mean())};
}

/// The weighted best similarity of places, those that disagree with most of them left out little by
/// little: what around a part is pressed together doesn't tell where it goes.
class Surroundings {
public:
    Surroundings(Positions from, Positions to, Values weights)
        : from_(std::move(from)), to_(std::move(to)), weights_(std::move(weights)) {}

    Similarity similarity() const {
        constexpr int kRounds = 5;
        Similarity best = fit(weights_);
        for (int round = 0; round < kRounds; ++round) {
            const Values off = (best.apply(from_) - to_).rowwise().norm();
            std::vector<double> sorted(off.begin(), off.end());
            const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
            std::ranges::nth_element(sorted, middle);
            if (!(*middle > 0.0)) break;
            best = fit(
                (weights_.array() / (1.0 + (off / *middle).array().square()).square()).matrix());
        }
        return best;
    }

private:
    Similarity fit(const Values& weights) const {
        const double sum = weights.sum();
        const Eigen::RowVector3d from = weights.transpose() * from_ / sum;
        const Eigen::RowVector3d to = weights.transpose() * to_ / sum;
        const Positions a = from_.rowwise() - from, b = to_.rowwise() - to;
        const Matrix3 cross = b.transpose() * weights.asDiagonal() * a;
        const double spread = weights.dot(a.rowwise().squaredNorm());
        const BestRotation turn = best_rotation(cross);
        Similarity result;
        result.rotation = turn.rotation;
        result.scale = spread > 0.0 && turn.trace > 0.0 ? turn.trace / spread : 1.0;
        result.translation = to.transpose() - result.scale * (result.rotation * from.transpose());
        return result;
    }

    Positions from_, to_;
    Values weights_;
};

}  // namespace

std::vector<Index> parts_without_counterpart(const Mesh& mesh, std::span<const Index> target_parts,
                                             std::span<const SurfacePoint> on_mesh,
                                             const WrapHolds& holds) {
    constexpr double kSmall = 0.06;  // radius, √area
    constexpr double kFew = 0.5;     // of the share of the target that its own area would have
    const auto count = to_index(mesh.part_areas.size());
    if (count < 2) return {};
    std::vector<char> is_held(to_size(count), 0);
    const auto hold = [&](Index place) {
        if (const Index part = mesh.parts[to_size(place)]; part >= 0) is_held[to_size(part)] = 1;
    };
    for (const WrapMark& mark : holds.marks) hold(mark.place);
    for (Index p = 0; p < mesh.positions.rows(); ++p)
        if ((holds.rigid.rows() > 0 && holds.rigid[p] > 0.0) ||
            (holds.fixed.rows() > 0 && holds.fixed[p] > 0.0))
            hold(p);
    Values samples = Values::Zero(count);
    double all = 0.0;
    for (const SurfacePoint& point : on_mesh) {
        if (point.triangle < 0) continue;
        samples[mesh.parts[to_size(mesh.triangles(point.triangle, 0))]] += 1.0;
        all += 1.0;
    }
    const double area = mesh.area();
    const auto places = places_of_parts(mesh);
    std::vector<Index> result;
    for (Index part = 1; part < count; ++part) {
        const auto larger = target_parts.first(to_size(part));
        if (is_held[to_size(part)] ||
            std::ranges::find(larger, target_parts[to_size(part)]) == larger.end())
            continue;
        if (samples[part] > kFew * all * mesh.part_areas[part] / area) continue;
        if (ball_around(mesh, places[to_size(part)]).radius < kSmall * std::sqrt(area))
            result.push_back(part);
    }
    return result;
}

Mesh without_parts(const Mesh& mesh, std::span<const Index> parts,
                   std::vector<SurfacePoint>& on_mesh, Progress& progress) {
    const auto count = to_index(mesh.triangles.rows());
    std::vector<Index> kept, number(to_size(count), -1);
    for (Index f = 0; f < count; ++f) {
        if (std::ranges::binary_search(parts, mesh.parts[to_size(mesh.triangles(f, 0))])) continue;
        number[to_size(f)] = to_index(kept.size());
        kept.push_back(f);
    }
    Mesh rest = mesh_of(mesh.unit, mesh.positions, mesh.triangles(kept, Eigen::all));
    const TriangleTree tree(rest.positions, rest.triangles, progress);
    for (SurfacePoint& point : on_mesh) {
        if (point.triangle < 0) continue;
        const Index f = number[to_size(point.triangle)];
        if (f >= 0)
            point.triangle = f;
        else
            point = tree.closest(place_of(point, mesh.triangles, mesh.positions));
    }
    return rest;
}

void carry_parts(const Mesh& mesh, const Mesh& rest, std::span<const Index> parts, Positions& x,
                 Progress& progress) {
    // As far around as the places tell, in radii of the part.
    constexpr double kAround = 3.0, kFarthest = 9.0;
    constexpr std::size_t kLeast = 16;
    std::vector<Index> rows;
    Values areas = Values::Zero(rest.positions.rows());
    for (Index f = 0; f < rest.triangles.rows(); ++f)
        for (Index k = 0; k < 3; ++k) areas[rest.triangles(f, k)] += rest.areas[f] / 3.0;
    for (Index p = 0; p < rest.positions.rows(); ++p)
        if (rest.parts[to_size(p)] >= 0) rows.push_back(p);
    const Positions places = gather(rest.positions, rows);
    const KdTree<3> tree(places);
    const auto of_parts = places_of_parts(mesh);
    parallel_for(
        to_index(parts.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k) {
                const auto& own = of_parts[to_size(parts[to_size(k)])];
                const Ball ball = ball_around(mesh, own);
                std::vector<std::pair<Index, double>> near;
                double reach = ball.radius;
                for (; near.size() < std::min(kLeast, rows.size()); reach *= 2.0)
                    tree.within(ball.middle.data(), kFarthest * reach, near);
                reach *= 0.5 * kAround;
                const auto size = static_cast<Eigen::Index>(near.size());
                Positions from(size, 3), to(size, 3);
                Values weights(size);
                for (Eigen::Index i = 0; i < size; ++i) {
                    const auto& [row, squared] = near[to_size(i)];
                    const Index place = rows[to_size(row)];
                    from.row(i) = rest.positions.row(place);
                    to.row(i) = x.row(place);
                    weights[i] = areas[place] * std::exp(-squared / (reach * reach));
                }
                const Similarity there =
                    Surroundings(std::move(from), std::move(to), std::move(weights)).similarity();
                const Positions carried = there.apply(gather(mesh.positions, own));
                for (std::size_t i = 0; i < own.size(); ++i)
                    x.row(own[i]) = carried.row(static_cast<Eigen::Index>(i));
            }
        },
        0.0, 1.0, 1);
}

void sink_parts(const Mesh& mesh, std::span<const Index> parts, const Mesh& surface, Positions& x,
                Progress& progress) {
    constexpr int kSteps = 8;
    constexpr double kBelow = 0.001;  // √area
    const double below = kBelow * std::sqrt(surface.area());
    const TriangleTree tree(surface.positions, surface.triangles, progress);
    const auto of_parts = places_of_parts(mesh);
    const auto sink = [&](const std::vector<Index>& places) {
        for (int step = 0; step < kSteps; ++step) {
            double most = 0.0;
            Vector3 outward = Vector3::Zero();
            for (const Index place : places) {
                const Vector3 at = x.row(place).transpose();
                const SurfacePoint on = tree.closest(at);
                const Vector3 normal = surface.normals.row(on.triangle).transpose();
                outward += normal;
                const Vector3 foot = place_of(on, surface.triangles, surface.positions);
                most = std::max(most, (at - foot).dot(normal));
            }
            if (!(most > 0.0) || outward.isZero()) return;
            const Eigen::RowVector3d way = (most + below) * outward.normalized().transpose();
            for (const Index place : places) x.row(place) -= way;
        }
    };
    parallel_for(
        to_index(parts.size()), progress,
        [&](Index begin, Index end) {
            for (Index k = begin; k < end; ++k) sink(of_parts[to_size(parts[to_size(k)])]);
        },
        0.0, 1.0, 1);
}

}  // namespace pointmorph
