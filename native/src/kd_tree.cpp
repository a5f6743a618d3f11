#include "pointmorph/kd_tree.hpp"

// Ties are broken by the row: the same neighbours whatever the shape of the tree.
#define NANOFLANN_FIRST_MATCH
#include <algorithm>
#include <nanoflann.hpp>

namespace pointmorph {

namespace {

// nanoflann renamed its search parameters in 1.5.
#if NANOFLANN_VERSION >= 0x150
using SearchParameters = nanoflann::SearchParameters;
#else
using SearchParameters = nanoflann::SearchParams;
#endif

// Measured on surface clouds of 100,000 points: 10 to 20 is the fastest for 16 neighbours.
constexpr std::size_t kLeafSize = 16;

template <int Dim>
struct Adaptor {
    const typename KdTree<Dim>::Points& points;

    std::size_t kdtree_get_point_count() const { return static_cast<std::size_t>(points.rows()); }
    double kdtree_get_pt(std::size_t row, std::size_t column) const {
        return points(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column));
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

/// Collects everything closer than a radius (nanoflann's own has no strict bound).
class BallResult {
public:
    using DistanceType = double;
    using IndexType = Index;

    BallResult(double squared_radius, std::vector<std::pair<Index, double>>& result)
        : squared_radius_(squared_radius), result_(result) {}

    bool addPoint(double squared_distance, Index row) {
        if (squared_distance < squared_radius_) result_.emplace_back(row, squared_distance);
        return true;
    }
    double worstDist() const { return squared_radius_; }
    bool full() const { return true; }
    std::size_t size() const { return result_.size(); }
    bool empty() const { return result_.empty(); }

private:
    double squared_radius_;
    std::vector<std::pair<Index, double>>& result_;
};

}  // namespace

template <int Dim>
struct KdTree<Dim>::Impl {
    using Tree =
        nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Adaptor<Dim>>,
                                            Adaptor<Dim>, Dim, Index>;

    explicit Impl(const Points& points)
        : adaptor{points},
          tree(Dim, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize)) {
        tree.buildIndex();
    }

    Adaptor<Dim> adaptor;
    Tree tree;
};

template <int Dim>
KdTree<Dim>::KdTree(const Points& points)
    : points_(&points), impl_(points.rows() > 0 ? std::make_unique<Impl>(points) : nullptr) {}

template <int Dim>
KdTree<Dim>::~KdTree() = default;
template <int Dim>
KdTree<Dim>::KdTree(KdTree&&) noexcept = default;
template <int Dim>
KdTree<Dim>& KdTree<Dim>::operator=(KdTree&&) noexcept = default;

template <int Dim>
Index KdTree<Dim>::nearest(const double* query, std::span<Index> indices,
                           std::span<double> squared_distances) const {
    const std::size_t k = std::min(indices.size(), static_cast<std::size_t>(size()));
    if (k == 0) return 0;
    nanoflann::KNNResultSet<double, Index, std::size_t> result(k);
    result.init(indices.data(), squared_distances.data());
    impl_->tree.findNeighbors(result, query, SearchParameters());
    return static_cast<Index>(result.size());
}

template <int Dim>
void KdTree<Dim>::within(const double* query, double radius,
                         std::vector<std::pair<Index, double>>& result) const {
    result.clear();
    if (!impl_ || !(radius > 0.0)) return;
    BallResult ball(radius * radius, result);
    impl_->tree.findNeighbors(ball, query, SearchParameters());
    std::ranges::sort(result, [](const auto& a, const auto& b) {
        return a.second != b.second ? a.second < b.second : a.first < b.first;
    });
}

template class KdTree<2>;
template class KdTree<3>;
template class KdTree<6>;
template class KdTree<12>;

}  // namespace pointmorph
