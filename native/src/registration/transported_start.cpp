#include "registration/transported_start.hpp"

#include <cmath>
#include <vector>

#include "pointmorph/base/assignment.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "registration/from_nodes.hpp"

namespace pointmorph {

namespace {

/// The nodes of a shape, about their middle, over their root mean square distance from it.
struct NodeCloud {
    Positions positions;
    Normals normals;
};

NodeCloud nodes_of(const CoarseShape& shape) {
    const std::vector<Index>& rows = shape.levels.front().node_rows;
    NodeCloud cloud{gather(shape.positions, rows), gather(shape.normals, rows)};
    cloud.positions.rowwise() -= cloud.positions.colwise().mean().eval();
    const double size =
        std::sqrt(cloud.positions.squaredNorm() / static_cast<double>(cloud.positions.rows()));
    if (size > 0.0) cloud.positions /= size;
    return cloud;
}

/// Places of all points, blended from where their nodes' partners are.
Positions images(const CoarseShape& from, const std::vector<std::vector<Index>>& partners,
                 const CoarseShape& to) {
    const std::vector<Index>& nodes = to.levels.front().node_rows;
    Positions of_nodes = Positions::Zero(static_cast<Eigen::Index>(partners.size()), 3);
    for (std::size_t i = 0; i < partners.size(); ++i) {
        for (const Index j : partners[i])
            of_nodes.row(static_cast<Eigen::Index>(i)) += to.positions.row(nodes[to_size(j)]);
        of_nodes.row(static_cast<Eigen::Index>(i)) /= static_cast<double>(partners[i].size());
    }
    return from_nodes(from.levels.front(), of_nodes);
}

}  // namespace

RegistrationStart transported_start(const CoarseShape& source, const CoarseShape& target) {
    constexpr double kNormalWeight = 0.5;
    const NodeCloud s = nodes_of(source), t = nodes_of(target);
    Eigen::MatrixXd costs(s.positions.rows(), t.positions.rows());
    for (Eigen::Index i = 0; i < costs.rows(); ++i)
        for (Eigen::Index j = 0; j < costs.cols(); ++j)
            costs(i, j) = (s.positions.row(i) - t.positions.row(j)).squaredNorm() +
                          kNormalWeight * (1.0 - s.normals.row(i).dot(t.normals.row(j)));
    const std::vector<std::vector<Index>> there = even_assignment(costs);
    std::vector<std::vector<Index>> back(to_size(to_index(costs.cols())));
    for (std::size_t i = 0; i < there.size(); ++i)
        for (const Index j : there[i]) back[to_size(j)].push_back(to_index(i));
    return {images(source, there, target), images(target, back, source)};
}

}  // namespace pointmorph
