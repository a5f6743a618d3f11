#include "pointmorph/surface/transfer.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <string>
#include <vector>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr Index kFewestNeighbors = 6;
constexpr Index kMostNeighbors = 64;

/// Added to the samples' variance along every axis, as a share of the sum over all axes: nothing
/// on an even sampling, and where the samples lie on a line or a point, no slope across it.
constexpr double kAddedVariance = 1e-10;

/// Below the root of this share of the reach, samples count alike. Smaller follows single samples
/// more closely (0 would interpolate), larger averages over more.
constexpr double kPlateau = 0.01;

/// How far from the samples' mean the linear function is followed, in standard deviations of the
/// samples that way. Among independent random samples of a square a query is 0.8 away, 3 where one
/// in a hundred is, 9 at the most and on the rim.
constexpr double kFarthestFollowed = 10.0;

/// Weighted linear fit around a query, evaluated there. The weights fade to 0 at the farthest
/// sample: samples come and go without a step. One object a thread: keeps its memory.
template <int Dim>
class LinearFit {
public:
    using Point = Eigen::Matrix<double, 1, Dim>;

    LinearFit(const KdTree<Dim>& samples, const Positions& values, Index neighbors)
        : samples_(samples),
          values_(values),
          rows_(to_size(neighbors) + 1),  // the farthest counts for nothing
          squared_(rows_.size()),
          weights_(rows_.size()) {}

    Eigen::RowVector3d operator()(const double* query) {
        const auto found = to_size(samples_.nearest(query, rows_, squared_));
        const Eigen::Map<const Point> center(query);
        weigh(found);

        double sum = 0.0;
        Point offset = Point::Zero();  // of the samples' mean from the query
        Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
        for (std::size_t i = 0; i < found; ++i) {
            sum += weights_[i];
            offset += weights_[i] * (samples_.points().row(rows_[i]) - center);
            mean += weights_[i] * values_.row(rows_[i]);
        }
        offset /= sum;
        mean /= sum;

        Eigen::Matrix<double, Dim, Dim> variance = Eigen::Matrix<double, Dim, Dim>::Zero();
        Eigen::Matrix<double, Dim, 3> covariance = Eigen::Matrix<double, Dim, 3>::Zero();
        for (std::size_t i = 0; i < found; ++i) {
            const Point x = samples_.points().row(rows_[i]) - center - offset;
            variance += weights_[i] / sum * x.transpose() * x;
            covariance += weights_[i] / sum * x.transpose() * (values_.row(rows_[i]) - mean);
        }
        const double trace = variance.trace();
        if (!(trace > 0.0)) return mean;
        variance.diagonal().array() += kAddedVariance * trace;

        // The query lies −offset from the mean. Going there by the slope changes each value by at
        // most its standard deviation times the distance in the samples' own.
        const Eigen::Matrix<double, Dim, 1> solved = variance.ldlt().solve(offset.transpose());
        const double distance = std::sqrt(std::max(0.0, offset.dot(solved)));
        const double follow = distance > kFarthestFollowed ? kFarthestFollowed / distance : 1.0;
        return mean - follow * solved.transpose() * covariance;
    }

private:
    void weigh(std::size_t found) {
        const double reach = squared_[found - 1];  // squared as well
        // Fewer samples than asked for are all there are: none comes or goes.
        const double fading = found < rows_.size() ? 0.9 : 1.0;
        double largest = 0.0;
        for (std::size_t i = 0; i < found; ++i) {
            const double share = reach > 0.0 ? squared_[i] / reach : 0.0;
            const double fade = 1.0 - fading * std::sqrt(share);
            weights_[i] = fade * fade / (share + kPlateau);
            largest = std::max(largest, weights_[i]);
        }
        // All at the same distance: they count alike.
        if (!(largest > 0.0)) std::fill_n(weights_.begin(), found, 1.0);
    }

    const KdTree<Dim>& samples_;
    const Positions& values_;
    std::vector<Index> rows_;
    std::vector<double> squared_, weights_;
};

}  // namespace

template <int Dim>
Positions transfer(const KdTree<Dim>& samples, const Positions& values,
                   const typename KdTree<Dim>::Points& queries, const TransferOptions& options,
                   Progress& progress) {
    assert(samples.size() > 0 && values.rows() == samples.size());
    if (options.neighbors < kFewestNeighbors || options.neighbors > kMostNeighbors)
        throw OptionError("neighbors",
                          "a number from " + std::to_string(kFewestNeighbors) + " to " +
                              std::to_string(kMostNeighbors),
                          std::to_string(options.neighbors), "The default is 12.");
    Positions result(queries.rows(), 3);
    parallel_for(to_index(queries.rows()), progress, [&](Index begin, Index end) {
        LinearFit<Dim> fit(samples, values, options.neighbors);
        for (Index i = begin; i < end; ++i) result.row(i) = fit(queries.row(i).data());
    });
    return result;
}

template Positions transfer<2>(const KdTree<2>&, const Positions&, const KdTree<2>::Points&,
                               const TransferOptions&, Progress&);
template Positions transfer<3>(const KdTree<3>&, const Positions&, const KdTree<3>::Points&,
                               const TransferOptions&, Progress&);

}  // namespace pointmorph
