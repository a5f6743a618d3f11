#include "registration/rolls.hpp"

#include <algorithm>
#include <cmath>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/from_nodes.hpp"
#include "registration/self_motions.hpp"

namespace pointmorph {

namespace {

/// The axis of a shape: the middles of its points at evenly spaced lengths.
class LengthAxis {
public:
    LengthAxis(const CoarseShape& shape, const Eigen::MatrixXd& along) {
        Eigen::Index first = 0, last = 0;
        whole_ = along.maxCoeff(&first, &last);
        const Values of_nodes = 0.5 * (whole_ + (along.col(first) - along.col(last)).array());
        lengths_ = from_nodes(shape.levels.front(), of_nodes);
        find_middles(shape);
    }

    /// From one end to the other along the surface, in √area.
    double whole() const { return whole_; }
    const Values& lengths() const { return lengths_; }
    /// Whether there is one at all lengths.
    bool is_known() const {
        const auto steps = middles_.bottomRows(kStations - 1) - middles_.topRows(kStations - 1);
        return middles_.allFinite() && steps.rowwise().squaredNorm().minCoeff() > 0.0;
    }

    /// The half turn about the axis at the length of a point.
    Similarity half_turn(Index point) const {
        const double at = lengths_[point] / whole_ * static_cast<double>(kStations - 1);
        const Vector3 tangent = (middle(at + 1.0) - middle(at - 1.0)).stableNormalized();
        const Matrix3 turn = 2.0 * tangent * tangent.transpose() - Matrix3::Identity();
        const Vector3 here = middle(at);
        return {1.0, turn, here - turn * here};
    }

private:
    static constexpr Eigen::Index kStations = 41;

    /// `at` counts stations.
    Vector3 middle(double at) const {
        at = std::clamp(at, 0.0, static_cast<double>(kStations - 1));
        const Eigen::Index before = std::min(static_cast<Eigen::Index>(at), kStations - 2);
        const double share = at - static_cast<double>(before);
        return ((1.0 - share) * middles_.row(before) + share * middles_.row(before + 1))
            .transpose();
    }

    void find_middles(const CoarseShape& shape) {
        constexpr double kReach = 2.0;  // stations
        middles_ = Positions::Zero(kStations, 3);
        Values weights = Values::Zero(kStations);
        for (Index i = 0; i < shape.size(); ++i) {
            const double at = lengths_[i] / whole_ * static_cast<double>(kStations - 1);
            for (Eigen::Index k = 0; k < kStations; ++k) {
                const double off = (at - static_cast<double>(k)) / kReach;
                const double weight = shape.areas[i] * std::max(0.0, 1.0 - off * off);
                middles_.row(k) += weight * shape.positions.row(i);
                weights[k] += weight;
            }
        }
        middles_.array().colwise() /= weights.array();
    }

    double whole_ = 0.0;
    Values lengths_;     ///< of the points
    Positions middles_;  ///< `kStations` by 3
};

Eigen::RowVector3d moved(const Similarity& motion, const Eigen::RowVector3d& place) {
    return (motion.rotation * place.transpose() + motion.translation).transpose();
}

/// Whether every node of a shape can be reached along the surface.
bool is_of_one_piece(const Eigen::MatrixXd& along) {
    for (Eigen::Index k = 1; k < along.rows(); ++k)
        if (!(along(k, 0) > 0.0)) return false;  // what isn't reached is 0 off
    return true;
}

/// Rows where a mark says which side is up: that half turns take off the features and curves, or to
/// where regions are others.
std::vector<Index> telling_rows(const Rolls& rolls, const CoarseShape& shape,
                                std::span<const Index> features) {
    const double far = rolls.thickness;
    const auto rolled = [&](Index row) {
        return moved(rolls.turns[to_size(row)], shape.positions.row(row));
    };
    std::vector<Index> rows;
    for (const Index row : features)
        if ((rolled(row) - shape.positions.row(row)).norm() > far) rows.push_back(row);
    std::vector<Index> curves;  // the middles of regions don't pull
    for (Index k = 0; k < shape.guides.size(); ++k)
        if (shape.guides.weights[k] > 0.0) curves.push_back(shape.guides.coarse_rows[to_size(k)]);
    if (!curves.empty()) {
        const Positions places = gather(shape.positions, curves);
        const KdTree<3> tree(places);
        for (const Index row : curves) {
            const Eigen::RowVector3d place = rolled(row);
            const Index nearest = curves[to_size(nearest_rows(tree, place).front())];
            if ((place - shape.positions.row(nearest)).norm() > far) rows.push_back(row);
        }
    }
    if (shape.labels.rows() > 0) {
        const double most = shape.labels.maxCoeff();
        Positions places(shape.size(), 3);
        for (Index i = 0; i < shape.size(); ++i) places.row(i) = rolled(i);
        const std::vector<Index> there = nearest_rows(KdTree<3>(shape.positions), places);
        for (Index i = 0; i < shape.size(); ++i)
            if ((shape.labels.row(i) - shape.labels.row(there[to_size(i)])).norm() > 0.5 * most)
                rows.push_back(i);
    }
    return rows;
}

}  // namespace

std::optional<Rolls> half_rolls(const CoarseShape& shape, const Eigen::MatrixXd& along) {
    constexpr double kLong = 20.0;
    if (along.rows() < 2 || !is_of_one_piece(along)) return {};
    const LengthAxis axis(shape, along);
    if (!axis.is_known()) return {};
    Rolls rolls{{}, axis.lengths(), 0.0};
    for (Index i = 0; i < shape.size(); ++i) {
        rolls.turns.push_back(axis.half_turn(i));
        const Eigen::RowVector3d place = shape.positions.row(i);
        rolls.thickness += 0.5 * shape.areas[i] * (moved(rolls.turns.back(), place) - place).norm();
    }
    rolls.thickness /= shape.areas.sum();
    if (!(axis.whole() >= kLong * rolls.thickness)) return {};
    return rolls;
}

std::vector<Similarity> untold_turns(const Rolls& rolls, const CoarseShape& shape,
                                     std::span<const Index> features) {
    constexpr double kReach = 5.0;  // how far a mark tells the roll, over the thickness
    std::vector<Similarity> turns = rolls.turns;
    const std::vector<Index> telling = telling_rows(rolls, shape, features);
    for (Index i = 0; i < shape.size(); ++i)
        if (std::ranges::any_of(telling, [&](Index row) {
                return std::abs(rolls.lengths[row] - rolls.lengths[i]) < kReach * rolls.thickness;
            }))
            turns[to_size(i)] = {};
    return turns;
}

Candidate followed_by_turns(const Candidate& map, const CoarseShape& source,
                            const CoarseShape& target, std::span<const Similarity> turns) {
    Candidate result = map;
    Registration& to = result.registration;
    Positions there(source.size(), 3);
    std::vector<Matrix3> rotations;
    for (Index i = 0; i < source.size(); ++i) {
        there.row(i) = moved(turns[to_size(i)], source.positions.row(i));
        rotations.push_back(turns[to_size(i)].rotation);
    }
    to.source_points = preceded(map.registration.source_points, source, there, rotations);
    to.source = at_nodes(to.source_points, source.levels.back());
    // Half turns are their own inverse.
    DeformedCloud& back = to.target_points;
    const std::vector<Index> rows = nearest_rows(KdTree<3>(source.positions), back.positions);
    for (Index i = 0; i < target.size(); ++i) {
        const Similarity& turn = turns[to_size(rows[to_size(i)])];
        back.positions.row(i) = moved(turn, back.positions.row(i));
        back.normals.row(i) *= turn.rotation.transpose();
        back.linear[to_size(i)] = turn.rotation * back.linear[to_size(i)];
    }
    to.target = at_nodes(back, target.levels.back());
    return result;
}

}  // namespace pointmorph
