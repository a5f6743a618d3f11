#include "pointmorph/registration/misfit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"
#include "registration/product_keys.hpp"
#include "registration/rim.hpp"

namespace pointmorph {

namespace {

/// One of the shapes with what a registration does to it.
struct RegisteredShape {
    const CoarseShape& shape;
    const Deformation& deformation;
    const DeformedCloud& images;  ///< of all coarse points

    Positions::ConstRowXpr position(Index row) const { return shape.positions.row(row); }
    Positions::ConstRowXpr image(Index row) const { return images.positions.row(row); }

    /// Points of this shape as they search the other one's targets().
    ProductPoints seekers(double normal_weight) const {
        return product_points(oriented(images), oriented(shape), normal_weight);
    }
    ProductPoints targets(double normal_weight) const {
        return product_points(oriented(shape), oriented(images), normal_weight);
    }
};

/// 1 for nodes without a counterpart: those that are matched with an end of the other shape, and
/// what lies beyond. All 0 where that has no ends, or next to nothing lies beyond: which few nodes
/// do is chance, by which one map would cost less than another. `to`: coarse rows of the other
/// shape.
std::vector<char> left_over_nodes(const CoarseShape& here, const DeformationGraph& graph,
                                  const RegisteredShape& there, std::span<const Index> to) {
    constexpr double kLeast = 0.05;
    std::vector<char> none(to_size(graph.size()), 0);
    if (there.shape.ends.empty()) return none;
    const Positions& images = there.images.positions;
    std::vector<char> result = beyond_rim(graph, gather(here.positions, graph.node_rows), images,
                                          gather(images, end_rows(there.shape)));
    if (static_cast<double>(std::ranges::count(result, 1)) < kLeast * graph.size()) return none;
    for (std::size_t k = 0; k < result.size(); ++k)
        if (there.shape.ends[to_size(to[k])] != 0) result[k] = 1;
    return result;
}

/// The factor by which the nodes that have a counterpart have grown.
double growth(const RegisteredShape& here, const std::vector<char>& left_over) {
    double sum = 0.0, count = 0.0;
    for (std::size_t k = 0; k < left_over.size(); ++k)
        if (left_over[k] == 0) {
            sum += std::log(here.deformation.scales[to_index(k)]);
            ++count;
        }
    return count > 0.0 ? std::exp(sum / count) : 1.0;
}

/// Which coarse rows of a shape have a counterpart, and how much those have grown.
struct Counted {
    const DeformationGraph& graph;
    const std::vector<char>& left_over;
    double growth = 1.0;

    bool has(Index row) const {
        return left_over[to_size(graph.point_nodes[to_size(row)][0])] == 0;
    }
};

/// Mean difference between distances along one surface and along the other, between the nodes of
/// the coarsest level and the other shape's nodes that they were matched with.
double geodesic_distortion(const Eigen::MatrixXd& here_distances,
                           const Eigen::MatrixXd& there_distances, const std::vector<Index>& to,
                           const CoarseShape& here, const Counted& counted) {
    const std::vector<Index>& rows = here.levels.front().node_rows;
    std::vector<Index> nodes, ends;
    for (std::size_t k = 0; k < rows.size(); ++k)
        if (counted.has(rows[k])) {
            nodes.push_back(to_index(k));
            ends.push_back(to[k]);
        }
    // In several sums, of which none waits for another.
    constexpr std::size_t kSums = 4;
    std::array<double, kSums> sums{};
    for (std::size_t j = 0; j < nodes.size(); ++j) {
        const double* const own = here_distances.col(nodes[j]).data();
        const double* const across = there_distances.col(ends[j]).data();
        const auto add = [&](std::size_t i, double& sum) {
            sum += std::abs(counted.growth * own[nodes[i]] - across[ends[i]]);
        };
        std::size_t i = 0;
        for (; i + kSums <= nodes.size(); i += kSums)
            for (std::size_t k = 0; k < kSums; ++k) add(i + k, sums[k]);
        for (; i < nodes.size(); ++i) add(i, sums[i % kSums]);
    }
    const double sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    return sum / std::max<double>(1.0, std::pow(static_cast<double>(nodes.size()), 2));
}

/// Adds what is left between the nodes' images and the other shape.
void add_gaps(const RegisteredShape& here, const RegisteredShape& there,
              const DeformationGraph& graph, const Matches& matches,
              const std::vector<char>& left_over, Misfit& sums) {
    const auto left = to_index(std::ranges::count(left_over, 1));
    const double share = 0.5 / std::max<Index>(graph.size() - left, 1);
    for (Index k = 0; k < graph.size(); ++k) {
        if (left_over[to_size(k)] != 0) continue;
        const Index i = graph.node_rows[to_size(k)], j = matches.to[to_size(k)];
        const double agreement = here.images.normals.row(i).dot(there.shape.normals.row(j));
        const double back = here.shape.normals.row(i).dot(there.images.normals.row(j));
        sums.gap += share * (here.image(i) - there.position(j)).norm();
        sums.round_trip += share * (there.image(j) - here.position(i)).norm();
        sums.normals += share * (1.0 - 0.5 * (agreement + back));
        sums.opposed += share * (agreement < 0.0 ? 1.0 : 0.0);
    }
}

/// Which points have no counterpart where all are matched so; none where the other has no ends.
std::vector<char> left_over_points(const CoarseShape& here, const RegisteredShape& there,
                                   const Matches& matches) {
    if (there.shape.ends.empty()) return {};
    const DeformationGraph& graph = here.levels.back();
    std::vector<Index> to;
    for (const Index row : graph.node_rows) to.push_back(matches.to[to_size(row)]);
    const std::vector<char> left_over = left_over_nodes(here, graph, there, to);
    const Counted counted{graph, left_over};
    std::vector<char> result(to_size(here.size()));
    for (Index i = 0; i < here.size(); ++i)
        result[to_size(i)] =
            there.shape.ends[to_size(matches.to[to_size(i)])] != 0 || !counted.has(i);
    return result;
}

/// Share of the edges that are torn, but for those of what is left over, if anything is.
double torn_edges(const CoarseShape& here, const CoarseShape& there, const std::vector<Index>& to,
                  const std::vector<char>& left_over, const RegistrationOptions& options) {
    const SurfaceGraph& graph = here.graph;
    const auto is_left = [&](Index i) { return !left_over.empty() && left_over[to_size(i)] != 0; };
    std::size_t torn = 0;
    for (Index i = 0; i < here.size(); ++i)
        for (auto e = to_size(graph.offsets[to_size(i)]);
             e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
            const Index j = graph.neighbors[e], a = to[to_size(i)], b = to[to_size(j)];
            if (is_left(i) || is_left(j)) continue;
            torn += (there.positions.row(a) - there.positions.row(b)).norm() >
                    options.tear_stretch * graph.lengths[e] + options.tear_gap;
        }
    return 0.5 * static_cast<double>(torn) /
           static_cast<double>(std::max<std::size_t>(graph.lengths.size(), 1));
}

/// Adds how much the surroundings of the nodes have bent.
void add_bending(const RegisteredShape& here, const DeformationGraph& graph, Misfit& sums) {
    const double share = 0.5 / std::max<double>(1.0, static_cast<double>(graph.edge_ends.size()));
    const Deformation& d = here.deformation;
    for (Index k = 0; k < graph.size(); ++k)
        for (auto e = to_size(graph.edge_offsets[to_size(k)]);
             e < to_size(graph.edge_offsets[to_size(k) + 1]); ++e) {
            const Index l = graph.edge_ends[e];
            const Vector3 rest = (here.position(graph.node_rows[to_size(l)]) -
                                  here.position(graph.node_rows[to_size(k)]))
                                     .transpose();
            const Vector3 now = (d.positions.row(l) - d.positions.row(k)).transpose();
            const Matrix3 linear = 0.5 * (d.scales[k] * d.rotations[to_size(k)] +
                                          d.scales[l] * d.rotations[to_size(l)]);
            const double ratio = now.norm() / std::max(rest.norm(), 1e-300);
            sums.torn += ratio > 2.0 || ratio < 0.5 ? share : 0.0;
            sums.residual +=
                share * (now - linear * rest).squaredNorm() / std::max(rest.squaredNorm(), 1e-300);
            sums.rotation_change +=
                share * (d.rotations[to_size(k)] - d.rotations[to_size(l)]).norm();
            sums.scale_change += share * std::abs(std::log(d.scales[k] / d.scales[l]));
        }
}

}  // namespace

double Misfit::energy() const {
    struct Term {
        double value;
        double exponent;  ///< those that ranked maps of four-legged animals best
        double floor;     ///< what a perfect map of samples has anyway, so that none can win alone
    };
    const Term terms[] = {{gap, 0.8, 1e-3},          {round_trip, 0.5, 1e-3},
                          {normals, 1.6, 1e-3},      {opposed, 0.1, 1e-2},
                          {residual, 0.4, 1e-4},     {rotation_change, 0.4, 1e-3},
                          {scale_change, 0.5, 1e-3}, {geodesics, 0.3, 1e-2}};
    double logarithm = 0.0, exponents = 0.0;
    for (const Term& term : terms) {
        logarithm += term.exponent * std::log(term.value + term.floor);
        exponents += term.exponent;
    }
    return std::exp(logarithm / exponents);
}

Misfit registration_misfit(const CoarsePair& shapes, Index level, const Registration& registration,
                           const NodeDistances& distances, const RegistrationOptions& options,
                           Progress& progress) {
    const RegisteredShape both[2] = {
        {shapes.source, registration.source, registration.source_points},
        {shapes.target, registration.target, registration.target_points}};
    Misfit sums;
    for (const std::size_t k : {0u, 1u}) {
        const RegisteredShape &here = both[k], &there = both[1 - k];
        const DeformationGraph& graph = here.shape.levels[to_size(level)];
        const ProductPoints seekers = here.seekers(options.normal_weight);
        ProductPoints targets = there.targets(options.normal_weight);
        const auto keys_at = [](const CoarseShape& shape, const ProductPoints& points,
                                const std::vector<Index>& rows) {
            return ProductKeys(gather(points, rows), labels_of(shape, rows));
        };
        const auto& coarsest = here.shape.levels.front().node_rows;
        const Matches at_nodes = nearest_of(
            keys_at(here.shape, seekers, coarsest),
            keys_at(there.shape, targets, there.shape.levels.front().node_rows), progress);
        const Matches matches = nearest_of(keys_at(here.shape, seekers, graph.node_rows),
                                           {std::move(targets), there.shape.labels}, progress);
        const std::vector<char> left_over = left_over_nodes(here.shape, graph, there, matches.to);
        Counted counted{graph, left_over};
        if (!here.shape.ends.empty() || !there.shape.ends.empty())
            counted.growth = growth(here, left_over);
        add_gaps(here, there, graph, matches, left_over, sums);
        sums.geodesics += 0.5 * geodesic_distortion(distances[k], distances[1 - k], at_nodes.to,
                                                    here.shape, counted);
        add_bending(here, graph, sums);
    }
    return sums;
}

double torn_share(const CoarsePair& shapes, const Registration& registration,
                  const RegistrationOptions& options, Progress& progress) {
    const CoarseShape &source = shapes.source, &target = shapes.target;
    const ProductKeys source_keys(product_points(oriented(registration.source_points),
                                                 oriented(source), options.normal_weight),
                                  source.labels);
    const ProductKeys target_keys(
        product_points(oriented(target), oriented(registration.target_points),
                       options.normal_weight),
        target.labels);
    const std::array<Matches, 2> matches{
        ProductKeyTree(target_keys).nearest(source_keys, progress),
        ProductKeyTree(source_keys).nearest(target_keys, progress)};
    const RegisteredShape both[2] = {{source, registration.source, registration.source_points},
                                     {target, registration.target, registration.target_points}};
    double share = 0.0;
    for (const std::size_t k : {0u, 1u}) {
        const CoarseShape& here = both[k].shape;
        const RegisteredShape& there = both[1 - k];
        share += torn_edges(here, there.shape, matches[k].to,
                            left_over_points(here, there, matches[k]), options);
    }
    return share;
}

}  // namespace pointmorph
