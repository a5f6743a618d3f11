#include "pointmorph/registration/misfit.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pointmorph/cloud/cloud.hpp"
#include "registration/product_keys.hpp"

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
    ProductKeys seekers_at(const std::vector<Index>& rows, double normal_weight) const {
        return {gather(seekers(normal_weight), rows), labels_of(shape, rows)};
    }
};

/// Mean difference between distances along one surface and along the other, between the nodes of
/// the coarsest level and their images.
double geodesic_distortion(const RegisteredShape& here, const RegisteredShape& there,
                           const Eigen::MatrixXd& here_distances,
                           const Eigen::MatrixXd& there_distances, double normal_weight,
                           Progress& progress) {
    const auto& graph = here.shape.levels.front();
    const auto& other = there.shape.levels.front();
    const ProductKeys to(gather(there.targets(normal_weight), other.node_rows),
                         labels_of(there.shape, other.node_rows));
    const Matches matches =
        nearest_of(here.seekers_at(graph.node_rows, normal_weight), to, progress);
    double sum = 0.0;
    for (Index j = 0; j < graph.size(); ++j)
        for (Index i = 0; i < graph.size(); ++i)
            sum += std::abs(here_distances(i, j) -
                            there_distances(matches.to[to_size(i)], matches.to[to_size(j)]));
    return sum / std::max<double>(1.0, std::pow(static_cast<double>(graph.size()), 2));
}

/// Adds what is left between the nodes' images and the other shape.
void add_gaps(const RegisteredShape& here, const RegisteredShape& there,
              const DeformationGraph& graph, double normal_weight, Progress& progress,
              Misfit& sums) {
    const ProductKeys all(there.targets(normal_weight), there.shape.labels);
    const Matches matches =
        nearest_of(here.seekers_at(graph.node_rows, normal_weight), all, progress);
    const double share = 0.5 / graph.size();
    for (Index k = 0; k < graph.size(); ++k) {
        const Index i = graph.node_rows[to_size(k)], j = matches.to[to_size(k)];
        const double agreement = here.images.normals.row(i).dot(there.shape.normals.row(j));
        const double back = here.shape.normals.row(i).dot(there.images.normals.row(j));
        sums.gap += share * (here.image(i) - there.position(j)).norm();
        sums.round_trip += share * (there.image(j) - here.position(i)).norm();
        sums.normals += share * (1.0 - 0.5 * (agreement + back));
        sums.opposed += share * (agreement < 0.0 ? 1.0 : 0.0);
    }
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
        add_gaps(here, there, graph, options.normal_weight, progress, sums);
        sums.geodesics += 0.5 * geodesic_distortion(here, there, distances[k], distances[1 - k],
                                                    options.normal_weight, progress);
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
    const auto torn_edges = [&](const CoarseShape& here, const CoarseShape& there,
                                const Matches& matches) {
        const SurfaceGraph& graph = here.graph;
        std::size_t torn = 0;
        for (Index i = 0; i < here.size(); ++i)
            for (auto e = to_size(graph.offsets[to_size(i)]);
                 e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
                const Index a = matches.to[to_size(i)], b = matches.to[to_size(graph.neighbors[e])];
                torn += (there.positions.row(a) - there.positions.row(b)).norm() >
                        options.tear_stretch * graph.lengths[e] + options.tear_gap;
            }
        return 0.5 * static_cast<double>(torn) /
               static_cast<double>(std::max<std::size_t>(graph.lengths.size(), 1));
    };
    double share =
        torn_edges(source, target, ProductKeyTree(target_keys).nearest(source_keys, progress));
    share += torn_edges(target, source, ProductKeyTree(source_keys).nearest(target_keys, progress));
    return share;
}

}  // namespace pointmorph
