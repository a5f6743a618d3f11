#include "mesh/wrap_borders.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

struct Box {
    Eigen::RowVector3d lower, upper;

    double distance(const Box& other) const {
        return (other.lower - upper).cwiseMax(lower - other.upper).cwiseMax(0.0).norm();
    }
    /// Whether places lie farther from it than this in the mean, or from anything in it.
    bool is_beyond(double mean, const Positions& places) const {
        constexpr double kRounding = 1.0 + 1e-9;
        const double most = kRounding * mean * static_cast<double>(places.rows());
        double sum = 0.0;
        for (Eigen::Index p = 0; p < places.rows() && sum <= most; ++p)
            sum += distance({places.row(p), places.row(p)});
        return sum > most;
    }
};

Box box_of(const Positions& points) {
    return {points.colwise().minCoeff(), points.colwise().maxCoeff()};
}

/// How far apart the points of lines are, in √area; farther where borders are so long, as those of
/// very many loose faces, that there would be more than `kMost`.
double distance_along(const std::vector<Positions>& borders) {
    constexpr double kApart = 0.001, kMost = 2e6;
    double length = 0.0;
    for (const Positions& border : borders)
        for (Eigen::Index k = 0; k < border.rows(); ++k)
            length += (border.row((k + 1) % border.rows()) - border.row(k)).norm();
    return std::max(kApart, length / kMost);
}

}  // namespace

/// A closed polygon as many points, with its direction at each.
struct WrapBorders::Line {
    Positions points;
    Positions directions;
    KdTree<3> search;
    Box box;

    explicit Line(std::pair<Positions, Positions> dense)
        : points(std::move(dense.first)),
          directions(std::move(dense.second)),
          search(points),
          box(box_of(points)) {}

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

    static std::pair<Positions, Positions> dense(const Positions& corners, double apart) {
        std::vector<Eigen::RowVector3d> points, directions;
        for (Eigen::Index k = 0; k < corners.rows(); ++k) {
            const Eigen::RowVector3d from = corners.row(k);
            const Eigen::RowVector3d way = corners.row((k + 1) % corners.rows()) - from;
            const double length = way.norm();
            if (!(length > 0.0)) continue;
            const int steps = static_cast<int>(std::ceil(length / apart));
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
                         const std::vector<Positions>& borders, Progress& progress) {
    const Progress::Part part(progress, 0.0, 0.0);  // what works with it has the time
    const double apart = distance_along(borders);
    for (const Positions& border : borders) {
        progress.report(0.0);
        auto dense = Line::dense(border, apart);
        if (dense.first.rows() > 0)
            lines_.push_back(std::make_shared<const Line>(std::move(dense)));
    }
    std::vector<const Line*> lines(mesh.borders.size(), nullptr);
    parallel_for(
        to_index(lines.size()), progress,
        [&](Index begin, Index end) {
            for (auto b = to_size(begin); b < to_size(end); ++b)
                lines[b] = nearest_line(gather(start, mesh.borders[b]));
        },
        0.0, 0.0, 1);
    for (std::size_t b = 0; b < lines.size(); ++b)
        if (lines[b]) matched_.push_back({mesh.borders[b], lines[b]});
}

const WrapBorders::Line* WrapBorders::nearest_line(const Positions& places) const {
    constexpr double kNear = 0.05;  // √area
    const auto count = static_cast<double>(places.rows());
    const Box box = box_of(places);
    const Line* best = nullptr;
    double least = kNear;
    // Of very many lines, most are too far away as a whole, or from the first places.
    for (const auto& line : lines_) {
        if (box.distance(line->box) > 2.0 * least || line->box.is_beyond(least, places)) continue;
        double sum = 0.0;
        for (Index p = 0; p < places.rows() && sum / count < least; ++p)
            sum += (places.row(p) - line->points.row(line->nearest(places.row(p)))).norm();
        const double mean = sum / count;
        if (mean >= least) continue;
        least = mean;
        best = line.get();
    }
    return best;
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
