#include "pointmorph/registration/restarts.hpp"

#include <algorithm>
#include <span>
#include <utility>

#include "pointmorph/base/assignment.hpp"
#include "pointmorph/registration/misfit.hpp"
#include "pointmorph/registration/thin_plate.hpp"

namespace pointmorph {

namespace {

/// Ends of long limbs, not all that sticks out: those are what a registration loses.
UnmarkedExtremities unmarked(const CoarseShape& shape, std::span<const IndexPair> features,
                             Index IndexPair::*side, const RestartOptions& options,
                             Progress& progress) {
    std::vector<Index> rows;
    for (const IndexPair& f : features) rows.push_back(f.*side);
    return unmarked_extremities(shape.graph, 1.0, distances_from(shape.graph, 1.0, rows),
                                options.extremities, progress);
}

/// The coarsest level with the extremities as features, the others without.
Registration led_by(const CoarsePair& shapes, std::span<const IndexPair> extremities,
                    const RegistrationStart& start, const RegistrationOptions& options,
                    Progress& progress) {
    std::vector<IndexPair> features(shapes.features.begin(), shapes.features.end());
    features.insert(features.end(), extremities.begin(), extremities.end());
    const Registration coarse = register_level({shapes.source, shapes.target, features}, 0, start,
                                               options.levels.front(), options, progress);
    return register_shapes(shapes, {coarse.source_points.positions, coarse.target_points.positions},
                           options, progress, 1);
}

}  // namespace

std::vector<IndexPair> extremities_by_features(const CoarsePair& shapes,
                                               const RestartOptions& options, Progress& progress) {
    constexpr std::size_t kFewest = 3;
    if (shapes.features.size() < kFewest) return {};
    const auto s = unmarked(shapes.source, shapes.features, &IndexPair::source, options, progress),
               t = unmarked(shapes.target, shapes.features, &IndexPair::target, options, progress);
    Eigen::MatrixXd costs(s.distances.rows(), t.distances.rows());
    for (Eigen::Index i = 0; i < costs.rows(); ++i)
        for (Eigen::Index j = 0; j < costs.cols(); ++j) {
            const Eigen::ArrayXd difference =
                (s.distances.row(i) - t.distances.row(j)).transpose().array();
            costs(i, j) = (difference - difference.mean()).abs().mean() +
                          options.offset_weight * std::abs(difference.mean());
        }
    std::vector<IndexPair> pairs;
    for (const auto& [i, j] : cheapest_pairs(costs, options.largest_difference))
        pairs.push_back({s.rows[to_size(i)], t.rows[to_size(j)]});
    return pairs;
}

Restarts register_best(const CoarsePair& shapes, StartedRegistration first,
                       const RestartOptions& options, const RegistrationOptions& registration,
                       Progress& progress) {
    const auto torn = [&](const Registration& result) {
        return torn_share(shapes, result, registration, progress);
    };
    Restarts restarts;
    restarts.registration = std::move(first.registration);
    restarts.tried.push_back({std::move(first.start), torn(restarts.registration)});
    if (restarts.tried.front().torn <= registration.most_torn) return restarts;

    const NodeDistances distances = node_distances(shapes.source, shapes.target);
    const auto finest = to_index(shapes.source.levels.size()) - 1;
    const auto energy = [&](const Registration& result) {
        return registration_misfit(shapes, finest, result, distances, registration, progress)
            .energy();
    };
    const auto score = [&](const Restart& restart) {
        return restart.energy * (1.0 + restart.torn / registration.most_torn);
    };
    restarts.tried.front().energy = energy(restarts.registration);
    const auto consider = [&](const char* start, Registration result) {
        restarts.tried.push_back({start, torn(result), energy(result)});
        if (score(restarts.tried.back()) >= score(restarts.tried[restarts.taken])) return;
        restarts.taken = restarts.tried.size() - 1;
        restarts.registration = std::move(result);
    };

    const RegistrationStart plate = thin_plate_start(shapes);
    const auto extremities = extremities_by_features(shapes, options, progress);
    if (!extremities.empty())
        consider("tips", led_by(shapes, extremities, plate, registration, progress));
    if (restarts.tried[restarts.taken].torn > registration.most_torn)
        consider("fine",
                 register_level(shapes, finest, plate, options.fine, registration, progress));
    return restarts;
}

}  // namespace pointmorph
