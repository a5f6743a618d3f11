#include "registration/pose_rating.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace pointmorph {

namespace {

/// How far maps lie from `best`; `least` is what their costs are compared with.
OtherMaps differences(const NodeImages& best, std::span<const NodeImages> maps, double least) {
    const auto count = static_cast<Eigen::Index>(maps.size());
    OtherMaps others{Values(count), Eigen::MatrixXd(count, best.source.rows()),
                     Eigen::MatrixXd(count, best.target.rows())};
    for (Eigen::Index k = 0; k < count; ++k) {
        const NodeImages& map = maps[static_cast<std::size_t>(k)];
        others.ratios[k] = map.cost / least;
        others.source.row(k) = (map.source - best.source).rowwise().norm().transpose();
        others.target.row(k) = (map.target - best.target).rowwise().norm().transpose();
    }
    return others;
}

}  // namespace

double doubt_from(const Competitor& other) {
    constexpr double kCost = 40.0;
    return std::pow(std::min(other.distance / kApart, 1.0), 1.5) *
           std::pow(std::max(other.ratio, 0.5), -kCost);
}

Alternatives alternatives_to_first(const CoarsePair& shapes, std::span<const Candidate> maps,
                                   std::span<const NodeImages> tried) {
    Alternatives result;
    result.source_rows = shapes.source.levels.front().node_rows;
    result.target_rows = shapes.target.levels.front().node_rows;
    std::vector<NodeImages> finished;
    for (const Candidate& map : maps)
        finished.push_back(node_images(map, result.source_rows, result.target_rows));
    const NodeImages& best = finished.front();
    const std::span others = std::span(finished).subspan(1);
    result.finished = differences(best, others, best.cost);
    for (std::size_t k = 0; k < others.size(); ++k)
        result.finished.ratios[static_cast<Eigen::Index>(k)] =
            ratio_in_doubt(best, others[k], tried);
    const auto rolled = std::ranges::find_if(maps.subspan(1), &Candidate::is_rolled);
    if (rolled != maps.end()) result.finished.rolled = to_index(rolled - maps.begin()) - 1;
    if (tried.empty()) return result;
    constexpr double kWorst = 1.3;  // what is worse counts next to nothing
    const auto worse =
        std::ranges::upper_bound(tried, kWorst * tried.front().cost, {}, &NodeImages::cost);
    result.trials = differences(best, {tried.begin(), worse}, tried.front().cost);
    return result;
}

Pose rated(const CoarsePair& shapes, std::vector<Candidate> maps,
           std::span<const NodeImages> tried) {
    Pose pose;
    if (tried.size() > 1) pose.margin = std::max(1.0, tried[1].cost / tried[0].cost);
    pose.best = std::move(maps.front());
    pose.rivals.assign(std::make_move_iterator(maps.begin() + 1),
                       std::make_move_iterator(maps.end()));
    const auto at_nodes = [&](const Candidate& map) {
        return node_images(map, shapes.source.levels.front().node_rows,
                           shapes.target.levels.front().node_rows);
    };
    const NodeImages best = at_nodes(pose.best);
    const Positions images = images_at_rest(pose.best);
    std::vector<Competitor> competitors;
    for (const Candidate& rival : pose.rivals)
        competitors.push_back({ratio_in_doubt(best, at_nodes(rival), tried),
                               (images_at_rest(rival) - images).rowwise().norm().mean()});
    if (!pose.rivals.empty())
        pose.margin = std::max(1.0, pose.rivals.front().cost / pose.best.cost);
    pose.confidence = pose_confidence(pose.best.misfit, competitors);
    return pose;
}

double pose_confidence(const Misfit& misfit, std::span<const Competitor> competitors) {
    constexpr double kPlain = 4.5, kOpposed = 20.0;
    double others = 0.0;
    for (const Competitor& other : competitors) others += doubt_from(other);
    const double alone = 1.0 / (1.0 + std::exp(kOpposed * std::sqrt(misfit.opposed) - kPlain));
    return alone / (1.0 + others);
}

}  // namespace pointmorph
