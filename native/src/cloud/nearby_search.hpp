// The nearest of few points to each of many that come in spatial order, faster than by a tree
// alone.
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "cloud/nearest_result.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

/// What lies around each point of a tree. Keeps a reference to the tree.
/// By the triangle inequality, what is farther from a point than a query is from it and from the
/// last one of those wanted can't be wanted: from a point beside the query, a short list will do.
template <int Dim>
class NearbySearch {
public:
    NearbySearch(const KdTree<Dim>& tree, Progress& progress) : tree_(tree) {
        if (tree.size() < to_index(kListed)) return;
        rows_.resize(to_size(tree.size()));
        distances_.resize(rows_.size());
        parallel_for(tree.size(), progress, [&](Index begin, Index end) {
            for (Index i = begin; i < end; ++i) {
                auto& distances = distances_[to_size(i)];
                tree.nearest(tree.points().row(i).data(), rows_[to_size(i)], distances);
                for (double& distance : distances) distance = std::sqrt(distance);
            }
        });
    }

    /// As KdTree::nearest() of 16 points or fewer; `beside` may be any point of the tree, and
    /// becomes the nearest.
    Index nearest(const double* query, Index& beside, std::span<Index> indices,
                  std::span<double> squared_distances) const {
        if (rows_.empty() || !find(query, beside, indices, squared_distances)) {
            const Index found = tree_.nearest(query, indices, squared_distances);
            if (found > 0) beside = indices.front();
            return found;
        }
        beside = indices.front();
        return to_index(indices.size());
    }

private:
    static constexpr std::size_t kListed = 24;

    /// Axis by axis, as the tree does it.
    double squared_distance(const double* query, Index row) const {
        const double* const place = tree_.points().data() + Dim * row;
        double sum = 0.0;
        for (int d = 0; d < Dim; ++d) sum += (query[d] - place[d]) * (query[d] - place[d]);
        return sum;
    }

    /// False where the list may lack some; then what is written has no meaning.
    bool find(const double* query, Index beside, std::span<Index> indices,
              std::span<double> squared_distances) const {
        constexpr double kRounding = 1.0 + 1e-12;
        const auto& rows = rows_[to_size(beside)];
        const auto& distances = distances_[to_size(beside)];
        const double to_query = std::sqrt(squared_distance(query, beside));
        NearestResult nearest(std::numeric_limits<double>::infinity(), indices, squared_distances);
        double reach = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < kListed; ++k) {
            // All that follow are farther than any that is kept. Where those coincide with the
            // query, which of them are found is the tree's to say.
            if (distances[k] > reach) return squared_distances.back() > 0.0;
            const double squared = squared_distance(query, rows[k]);
            if (!(squared < nearest.worstDist())) continue;
            nearest.addPoint(squared, rows[k]);
            if (nearest.full())
                reach = kRounding * (to_query + std::sqrt(squared_distances.back()));
        }
        return false;
    }

    const KdTree<Dim>& tree_;
    std::vector<std::array<Index, kListed>> rows_;
    std::vector<std::array<double, kListed>> distances_;
};

}  // namespace pointmorph
