#include "pointmorph/transfer.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "pointmorph/parallel.hpp"

namespace pointmorph {

namespace {

/// Slopes are held back by this share of the samples' spread along them: nothing on an even
/// sampling, enough where the samples lie on a line or a point.
constexpr double kRidge = 1e-6;

/// Below the root of this share of the reach, samples count alike. Smaller follows single samples
/// more closely (0 would interpolate), larger averages over more.
constexpr double kPlateau = 0.01;

/// Weighted linear fit around `query`, evaluated there. The weights fade to 0 at the farthest
/// sample, which is left out: samples come and go without a step.
template <int Dim>
class LinearFit {
public:
    using Slope = Eigen::Matrix<double, Dim, 3>;

    LinearFit(const KdTree<Dim>& samples, const Positions& values, Index neighbors)
        : samples_(samples),
          values_(values),
          rows_(static_cast<std::size_t>(neighbors) + 1),
          squared_(rows_.size()) {}

    Eigen::RowVector3d operator()(const double* query) {
        const Index found = samples_.nearest(query, rows_, squared_);
        const Eigen::Map<const Eigen::Matrix<double, 1, Dim>> center(query);
        const double reach = std::sqrt(squared_[static_cast<std::size_t>(found) - 1]);
        // Fewer samples than asked for are all there are: none comes or goes.
        const bool all = found < static_cast<Index>(rows_.size());

        double sum = 0.0;
        Eigen::RowVector3d mean = Eigen::RowVector3d::Zero();
        Eigen::Matrix<double, 1, Dim> offset = Eigen::Matrix<double, 1, Dim>::Zero();
        for (Index i = 0; i < found; ++i) {
            const double weight = weight_of(i, reach, all);
            sum += weight;
            mean += weight * values_.row(row(i));
            offset += weight * (samples_.points().row(row(i)) - center);
        }
        if (!(sum > 0.0)) return values_.row(row(0));  // all in one place, at one distance
        mean /= sum;
        offset /= sum;

        Eigen::Matrix<double, Dim, Dim> spread = Eigen::Matrix<double, Dim, Dim>::Zero();
        Slope mixed = Slope::Zero();
        for (Index i = 0; i < found; ++i) {
            const double weight = weight_of(i, reach, all);
            const Eigen::Matrix<double, 1, Dim> d = samples_.points().row(row(i)) - center - offset;
            spread += weight * d.transpose() * d;
            mixed += weight * d.transpose() * (values_.row(row(i)) - mean);
        }
        const double trace = spread.trace();
        if (!(trace > 0.0)) return mean;
        spread.diagonal().array() += kRidge * trace;
        const Slope slope = spread.ldlt().solve(mixed);
        const Eigen::RowVector3d value = mean - offset * slope;
        return inside(value, found);
    }

private:
    Index row(Index i) const { return rows_[static_cast<std::size_t>(i)]; }

    double weight_of(Index i, double reach, bool all) const {
        if (!(reach > 0.0)) return 1.0;
        const double share = std::sqrt(squared_[static_cast<std::size_t>(i)]) / reach;
        const double fade = all ? 1.0 - 0.9 * share : std::max(0.0, 1.0 - share);
        return fade * fade / (share * share + kPlateau);
    }

    /// Within the box of the samples' values, half as large again: a fit over samples that lie to
    /// one side must not run away.
    Eigen::RowVector3d inside(const Eigen::RowVector3d& value, Index found) const {
        Eigen::RowVector3d low = values_.row(row(0)), high = low;
        for (Index i = 1; i < found; ++i) {
            low = low.cwiseMin(values_.row(row(i)));
            high = high.cwiseMax(values_.row(row(i)));
        }
        const Eigen::RowVector3d margin = (high - low) / 4.0;
        return value.cwiseMax(low - margin).cwiseMin(high + margin);
    }

    const KdTree<Dim>& samples_;
    const Positions& values_;
    std::vector<Index> rows_;
    std::vector<double> squared_;
};

}  // namespace

template <int Dim>
Positions transfer(const KdTree<Dim>& samples, const Positions& values,
                   const typename KdTree<Dim>::Points& queries, const TransferOptions& options,
                   Progress& progress) {
    Positions result(queries.rows(), 3);
    parallel_for(static_cast<Index>(queries.rows()), progress, [&](Index begin, Index end) {
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
