#include "pointmorph/registration/restarts.hpp"

#include <algorithm>
#include <utility>

#include "pointmorph/base/assignment.hpp"

namespace pointmorph {

namespace {

/// Ends of long limbs, not all that sticks out: those are what a registration loses.
UnmarkedExtremities unmarked(const CoarseShape& shape, std::span<const IndexPair> features,
                             Index IndexPair::*side, const AttemptOptions& options,
                             Progress& progress) {
    std::vector<Index> rows;
    for (const IndexPair& f : features) rows.push_back(f.*side);
    return unmarked_extremities(shape.graph, 1.0, distances_from(shape.graph, 1.0, rows),
                                options.extremities, progress);
}

}  // namespace

std::vector<IndexPair> tips_by_features(const CoarseShape& source, const CoarseShape& target,
                                        std::span<const IndexPair> features,
                                        const AttemptOptions& options, Progress& progress) {
    constexpr std::size_t kFewest = 3;
    if (features.size() < kFewest) return {};
    const auto s = unmarked(source, features, &IndexPair::source, options, progress),
               t = unmarked(target, features, &IndexPair::target, options, progress);
    Eigen::MatrixXd costs(s.distances.rows(), t.distances.rows());
    for (Eigen::Index i = 0; i < costs.rows(); ++i)
        for (Eigen::Index j = 0; j < costs.cols(); ++j) {
            const Eigen::ArrayXd difference =
                (s.distances.row(i) - t.distances.row(j)).transpose().array();
            costs(i, j) = (difference - difference.mean()).abs().mean() +
                          options.offset_weight * std::abs(difference.mean());
        }
    std::vector<IndexPair> pairs;
    for (const auto& [i, j] : cheapest_pairs(costs, options.tip_difference))
        pairs.push_back({s.rows[to_size(i)], t.rows[to_size(j)]});
    return pairs;
}

Attempts register_best(const CoarseShape& source, const CoarseShape& target,
                       std::span<const IndexPair> features, const std::string& start_name,
                       Registration first, const AttemptOptions& options,
                       const RegistrationOptions& registration, Progress& progress) {
    const auto torn = [&](const Registration& result) {
        return torn_share(source, target, result, registration, progress);
    };
    Attempts attempts;
    attempts.registration = std::move(first);
    attempts.tried.push_back({start_name, torn(attempts.registration)});
    if (attempts.tried.front().torn <= registration.most_torn) return attempts;

    const NodeDistances distances = node_distances(source, target);
    const auto last = static_cast<Index>(source.levels.size()) - 1;
    const auto energy = [&](const Registration& result) {
        return registration_energy(source, target, last, result, distances, registration, progress);
    };
    const auto score = [&](const Attempt& attempt) {
        return attempt.energy * (1.0 + attempt.torn / registration.most_torn);
    };
    attempts.tried.front().energy = energy(attempts.registration);
    const auto consider = [&](const char* name, Registration result) {
        attempts.tried.push_back({name, torn(result), energy(result)});
        if (score(attempts.tried.back()) >= score(attempts.tried[attempts.taken])) return;
        attempts.taken = attempts.tried.size() - 1;
        attempts.registration = std::move(result);
    };
    const auto looks_wrong = [&] {
        return attempts.tried[attempts.taken].torn > registration.most_torn;
    };

    const RegistrationStart plate = thin_plate_start(source, target, features);
    const auto tips = tips_by_features(source, target, features, options, progress);
    if (!tips.empty()) {
        std::vector<IndexPair> guided(features.begin(), features.end());
        guided.insert(guided.end(), tips.begin(), tips.end());
        const Registration coarse = register_level(
            source, target, 0, guided, plate, registration.levels.front(), registration, progress);
        consider("tips",
                 register_shapes(source, target, features,
                                 {coarse.source_points.positions, coarse.target_points.positions},
                                 registration, progress, 1));
    }
    if (looks_wrong())
        consider("fine", register_level(source, target, last, features, plate, options.fine,
                                        registration, progress));
    return attempts;
}

}  // namespace pointmorph
