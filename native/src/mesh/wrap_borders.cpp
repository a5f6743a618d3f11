#include "mesh/wrap_borders.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace pointmorph {

/// A closed polygon as many points, with its direction at each.
struct WrapBorders::Line {
    Positions points;
    Positions directions;
    KdTree<3> search;

    explicit Line(std::pair<Positions, Positions> dense)
        : points(std::move(dense.first)), directions(std::move(dense.second)), search(points) {}

    Index nearest(const Eigen::RowVector3d& place) const {
        Index row = 0;
        double squared = 0.0;
        search.nearest(place.data(), {&row, 1}, {&squared, 1});
        return row;
    }

    /// The nearest place on the line through the nearest point.
    Eigen::RowVector3d foot(const Eigen::RowVector3d& place, Index row) const {
        const Eigen::RowVector3d along = directions.row(row);
        return points.row(row) + (place - points.row(row)).dot(along) * along;
    }

    static std::pair<Positions, Positions> dense(const Positions& corners) {
        constexpr double kApart = 0.001;  // √area
        std::vector<Eigen::RowVector3d> points, directions;
        for (Eigen::Index k = 0; k < corners.rows(); ++k) {
            const Eigen::RowVector3d from = corners.row(k);
            const Eigen::RowVector3d way = corners.row((k + 1) % corners.rows()) - from;
            const double length = way.norm();
            if (!(length > 0.0)) continue;
            const int steps = static_cast<int>(std::ceil(length / kApart));
            for (int s = 0; s < steps; ++s) {
                points.emplace_back(from + (s + 0.5) / steps * way);
                directions.emplace_back(way / length);
            }
        }
        Positions p(static_cast<Eigen::Index>(points.size()), 3), d(p.rows(), 3);
        for (std::size_t i = 0; i < points.size(); ++i) {
            p.row(static_cast<Eigen::Index>(i)) = points[i];
            d.row(static_cast<Eigen::Index>(i)) = directions[i];
        }
        return {p, d};
    }
};

WrapBorders::WrapBorders(const Mesh& mesh, const Positions& start,
                         const std::vector<Positions>& borders) {
    constexpr double kNear = 0.05;  // √area
    for (const Positions& border : borders) {
        auto dense = Line::dense(border);
        if (dense.first.rows() > 0)
            lines_.push_back(std::make_shared<const Line>(std::move(dense)));
    }
    for (const std::vector<Index>& places : mesh.borders) {
        const Line* best = nullptr;
        double least = kNear;
        for (const auto& line : lines_) {
            double sum = 0.0;
            for (const Index p : places)
                sum += (start.row(p) - line->points.row(line->nearest(start.row(p)))).norm();
            const double mean = sum / static_cast<double>(places.size());
            if (mean >= least) continue;
            least = mean;
            best = line.get();
        }
        if (best) matched_.push_back({places, best});
    }
}

void WrapBorders::draw(const Positions& x, double length, std::vector<SymmetricBlock>& blocks,
                       Positions& right) const {
    for (const auto& [places, line] : matched_)
        for (std::size_t k = 0; k < places.size(); ++k) {
            const Index p = places[k];
            const double share =
                0.5 * ((x.row(places[(k + 1) % places.size()]) - x.row(p)).norm() +
                       (x.row(places[(k + places.size() - 1) % places.size()]) - x.row(p)).norm());
            const Index row = line->nearest(x.row(p));
            const Vector3 along = line->directions.row(row).transpose();
            SymmetricBlock across;
            across.add_isotropic(share / length);
            across.add_along(along, -share / length);
            blocks[to_size(p)].values += across.values;
            right.row(p) += (across * line->points.row(row).transpose()).transpose();
        }
}

void WrapBorders::land(Positions& x) const {
    for (const auto& [places, line] : matched_)
        for (const Index p : places) x.row(p) = line->foot(x.row(p), line->nearest(x.row(p)));
}

}  // namespace pointmorph
