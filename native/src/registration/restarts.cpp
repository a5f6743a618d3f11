#include "pointmorph/registration/restarts.hpp"

#include <algorithm>
#include <utility>

#include "pointmorph/base/assignment.hpp"
#include "pointmorph/surface/graph_extremities.hpp"
#include "pointmorph/surface/surface_graph.hpp"

namespace pointmorph {

namespace {

/// Tips that no feature marks, and their distances to the features: #tips by #features.
struct Signatures {
    std::vector<Index> tips;
    Eigen::MatrixXd distances;
};

Signatures signatures(const CoarseShape& shape, std::span<const IndexPair> features,
                      Index IndexPair::*side, const AttemptOptions& options, Progress& progress) {
    constexpr Index kSamples = 30;
    const auto count = static_cast<Eigen::Index>(features.size());
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(shape.size(), count);
    GeodesicSearch search(shape.graph);
    for (Eigen::Index f = 0; f < count; ++f)
        for (const auto& [i, distance] : search.from(features[to_size(f)].*side))
            all(i, f) = distance;
    Signatures result;
    // Ends of long limbs, not all that sticks out: those are what a registration loses.
    for (const Extremity& tip :
         extremities(shape.graph, 1.0, kSamples, options.tips, options.prominence, progress))
        if (all.row(tip.point).minCoeff() >= options.covered) result.tips.push_back(tip.point);
    result.distances = all(result.tips, Eigen::all);
    return result;
}

}  // namespace

std::vector<IndexPair> tips_by_features(const CoarseShape& source, const CoarseShape& target,
                                        std::span<const IndexPair> features,
                                        const AttemptOptions& options, Progress& progress) {
    constexpr std::size_t kFewest = 3;
    if (features.size() < kFewest) return {};
    const Signatures s = signatures(source, features, &IndexPair::source, options, progress);
    const Signatures t = signatures(target, features, &IndexPair::target, options, progress);
    const auto rows = s.distances.rows(), columns = t.distances.rows();
    // A tip of the source without a partner takes one of the further columns.
    Eigen::MatrixXd costs = Eigen::MatrixXd::Constant(rows, columns + rows, options.tip_difference);
    for (Eigen::Index i = 0; i < rows; ++i)
        for (Eigen::Index j = 0; j < columns; ++j) {
            const Eigen::ArrayXd difference =
                (s.distances.row(i) - t.distances.row(j)).transpose().array();
            costs(i, j) = (difference - difference.mean()).abs().mean() +
                          options.offset_weight * std::abs(difference.mean());
        }
    std::vector<IndexPair> pairs;
    const std::vector<Index> partners = least_assignment(costs);
    for (Eigen::Index i = 0; i < rows; ++i) {
        const Index j = partners[to_size(i)];
        if (j < columns && costs(i, j) < options.tip_difference)
            pairs.push_back({s.tips[to_size(i)], t.tips[to_size(j)]});
    }
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
