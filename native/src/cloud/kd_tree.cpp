#include "pointmorph/cloud/kd_tree.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <nanoflann.hpp>
#include <type_traits>

#include "cloud/bucket_tree.hpp"
#include "cloud/moving_tree.hpp"
#include "cloud/nearest_result.hpp"

namespace pointmorph {

namespace {

// nanoflann renamed its search parameters in 1.5.
#if NANOFLANN_VERSION >= 0x150
using SearchParameters = nanoflann::SearchParameters;
#else
using SearchParameters = nanoflann::SearchParams;
#endif

// Measured on surface clouds of 100,000 points: 10 to 20 is the fastest for 16 neighbors.
constexpr std::size_t kLeafSize = 16;

/// The rows of an array, as nanoflann asks for them.
struct PlanePoints {
    const KdTree<2>::Points& points;

    std::size_t kdtree_get_point_count() const { return to_size(points.rows()); }
    double kdtree_get_pt(std::size_t row, std::size_t column) const {
        return points(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column));
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

/// Ends the search at the first point closer than a radius.
class AnyResult {
public:
    using DistanceType = double;
    using IndexType = Index;

    explicit AnyResult(double squared_radius) : squared_radius_(squared_radius) {}

    bool addPoint(double squared_distance, Index) {
        found_ = squared_distance < squared_radius_;
        return !found_;
    }
    double worstDist() const { return squared_radius_; }
    bool full() const { return true; }
    std::size_t size() const { return found_ ? 1 : 0; }
    bool empty() const { return !found_; }

private:
    double squared_radius_;
    bool found_ = false;
};

/// nanoflann's. On surfaces in space, a BucketTree is built in half of its time, and asked in three
/// quarters; in the plane both are asked alike.
class PlaneTree {
public:
    explicit PlaneTree(const KdTree<2>::Points& points)
        : points_{points}, tree_(2, points_, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize)) {
        tree_.buildIndex();
    }

    template <class Result>
    void find(Result& result, const double* query) const {
        tree_.findNeighbors(result, query, SearchParameters());
    }

private:
    using Metric = nanoflann::L2_Simple_Adaptor<double, PlanePoints>;

    PlanePoints points_;
    nanoflann::KDTreeSingleIndexAdaptor<Metric, PlanePoints, 2, Index> tree_;
};

/// Searches for 2 * Halves points or fewer; false where it doesn't know them.
template <std::size_t Halves, class Tree>
bool find_few(const Tree& tree, const double* query, double squared_radius,
              std::span<Index> indices, std::span<double> squared_distances, std::size_t& count) {
    FewNearest<Halves> few(squared_radius, indices.size());
    tree.find(few, query);
    const auto found = few.write(indices.data(), squared_distances.data());
    count = found.value_or(0);
    return found.has_value();
}

}  // namespace

template <int Dim>
struct KdTree<Dim>::Impl {
    explicit Impl(const Points& points) : tree(points) {}

    std::size_t nearest(const double* query, double squared_radius, std::span<Index> indices,
                        std::span<double> squared_distances) const {
        std::size_t count = 0;
        const std::size_t most = indices.size();
        if (most == 1) {
            NearestOne one(squared_radius);
            tree.find(one, query);
            if (!one.empty()) {
                indices[0] = one.row();
                squared_distances[0] = one.squared();
            }
            return one.size();
        }
        if constexpr (Dim == 6)
            if (most > 18 && most <= 24 &&
                find_few<12>(tree, query, squared_radius, indices, squared_distances, count))
                return count;
        if constexpr (Dim == 3) {
            if (most > 2 && most <= 8 &&
                find_few<4>(tree, query, squared_radius, indices, squared_distances, count))
                return count;
            if (most > 8 && most <= 18 &&
                find_few<9>(tree, query, squared_radius, indices, squared_distances, count))
                return count;
        }
        NearestResult result(squared_radius, indices, squared_distances);
        tree.find(result, query);
        return result.size();
    }

    std::conditional_t<Dim == 2, PlaneTree, BucketTree<Dim>> tree;
};

template <int Dim>
KdTree<Dim>::KdTree(const Points& points)
    : points_(&points),
      size_(to_index(points.rows())),
      impl_(size_ > 0 ? std::make_shared<const Impl>(points) : nullptr) {}

template <int Dim>
KdTree<Dim>::KdTree(const KdTree& other, const Points& same_points) requires(Dim != 2)
    : points_(&same_points), size_(other.size_), impl_(other.impl_) {}

template <int Dim>
KdTree<Dim>::~KdTree() = default;
template <int Dim>
KdTree<Dim>::KdTree(KdTree&&) noexcept = default;
template <int Dim>
KdTree<Dim>& KdTree<Dim>::operator=(KdTree&&) noexcept = default;

template <int Dim>
Index KdTree<Dim>::nearest(const double* query, std::span<Index> indices,
                           std::span<double> squared_distances) const {
    return nearest_within(query, std::numeric_limits<double>::infinity(), indices,
                          squared_distances);
}

template <int Dim>
Index KdTree<Dim>::nearest_within(const double* query, double radius, std::span<Index> indices,
                                  std::span<double> squared_distances) const {
    if (!impl_ || indices.empty() || !(radius > 0.0)) return 0;
    return to_index(impl_->nearest(query, radius * radius, indices, squared_distances));
}

template <int Dim>
void KdTree<Dim>::within_unsorted(const double* query, double radius,
                                  std::vector<std::pair<Index, double>>& result) const {
    result.clear();
    if (!impl_ || !(radius > 0.0)) return;
    BallResult ball(radius * radius, result);
    impl_->tree.find(ball, query);
}

template <int Dim>
void KdTree<Dim>::within(const double* query, double radius,
                         std::vector<std::pair<Index, double>>& result) const {
    within_unsorted(query, radius, result);
    std::ranges::sort(result, [](const auto& a, const auto& b) {
        return a.second != b.second ? a.second < b.second : a.first < b.first;
    });
}

template <int Dim>
bool KdTree<Dim>::any_within(const double* query, double radius) const {
    if (!impl_ || !(radius > 0.0)) return false;
    AnyResult any(radius * radius);
    impl_->tree.find(any, query);
    return !any.empty();
}

void MovingTree::Boxes::move(const Positions& positions, Progress& progress) {
    UnsetVector<Box> boxes(nodes_.size());
    parallel_for(to_index(nodes_.size()), progress, [&](Index begin, Index end) {
        for (auto at = to_size(begin); at < to_size(end); ++at) {
            const TreeNode& node = nodes_[at];
            if (node.axis >= 0) continue;
            const auto size = to_size(-node.axis), before = 2 * to_size(node.next);
            const std::size_t room = 2 * twos_of(size);
            double* const to = coordinates_.data() + 3 * before;
            Box box{positions.row(rows_[before]), positions.row(rows_[before])};
            for (std::size_t k = 0; k < room; ++k) {
                const double* const place = positions.data() + 3 * to_size(rows_[before + k]);
                for (std::size_t d = 0; d < 3; ++d) {
                    auto &lower = box.lower[static_cast<Eigen::Index>(d)],
                         &upper = box.upper[static_cast<Eigen::Index>(d)];
                    to[d * room + k] = place[d];
                    lower = std::min(lower, place[d]);
                    upper = std::max(upper, place[d]);
                }
            }
            boxes[at] = box;
        }
    });
    width_ = 0.0;
    for (std::size_t at = nodes_.size(); at-- > 0;) {
        Box& box = boxes[at];
        if (nodes_[at].axis < 0) {
            width_ += (box.upper - box.lower).squaredNorm();
            continue;
        }
        const Box &first = boxes[at + 1], &second = boxes[to_size(nodes_[at].next)];
        auto& [lower, upper] = children_[at];
        for (std::size_t d = 0; d < 3; ++d) {
            const auto axis = static_cast<Eigen::Index>(d);
            lower[d] = Two{first.lower[axis], second.lower[axis]};
            upper[d] = Two{first.upper[axis], second.upper[axis]};
        }
        box.lower = first.lower.cwiseMin(second.lower);
        box.upper = first.upper.cwiseMax(second.upper);
    }
}

void MovingTree::move(const Positions& positions, Progress& progress) {
    constexpr double kTooWide = 1.2;  // from there on, what it costs to ask is more
    size_ = to_index(positions.rows());
    const auto move_boxes = [&](double first, double last) {
        const Progress::Part part(progress, first, last);
        tree_->move(positions, progress);
    };
    if (tree_) move_boxes(0.0, 0.4);
    if (!tree_ || tree_->width() > kTooWide * width_) {
        parallel_invoke(2, progress, [&](int k, Progress&) {
            // With two threads, the calling one can be asked to end meanwhile.
            if (k == 1) tree_.emplace(positions.topRows(lasting_));
        });
        move_boxes(0.6, 1.0);
        width_ = tree_->width();
    }
    others_.reset();
    if (size_ > lasting_) others_.emplace(positions.bottomRows(size_ - lasting_));
}

Index MovingTree::nearest(const double* query, std::span<Index> rows,
                          std::span<double> squared_distances) const {
    FewNearest<kMost / 2> few(std::numeric_limits<double>::infinity(), rows.size());
    find(few, query);
    if (const auto found = few.write(rows.data(), squared_distances.data()))
        return to_index(*found);
    AnyNearest any{{std::numeric_limits<double>::infinity(), rows, squared_distances}};
    find(any, query);
    return to_index(any.nearest.size());
}

void MovingTree::find_within(const double* query, double radius,
                             std::vector<std::pair<Index, double>>& ball) const {
    ball.clear();
    if (!(radius > 0.0)) return;
    BallResult result(radius * radius, ball);
    find(result, query);
}

std::vector<Index> nearest_rows(const KdTree<3>& tree, const Positions& places) {
    std::vector<Index> result(to_size(places.rows()));
    double squared;
    for (std::size_t i = 0; i < result.size(); ++i)
        tree.nearest(places.row(static_cast<Eigen::Index>(i)).data(), {&result[i], 1},
                     {&squared, 1});
    return result;
}

Index nearest_on_sheet(const KdTree<3>& tree, const Positions& normals,
                       const Eigen::RowVector3d& place, const Eigen::RowVector3d& normal,
                       std::size_t most) {
    constexpr std::size_t kMost = 12;
    std::array<Index, kMost> near;
    std::array<double, kMost> squared;
    const std::size_t wanted = std::min(most, kMost);
    // Nearly always the first will do; of several at the very place, only a search for all does.
    if (tree.nearest(place.data(), std::span(near).first(1), std::span(squared).first(1)) == 1 &&
        squared[0] > 0.0 && normals.row(near[0]).dot(normal) > 0.0)
        return near[0];
    const Index found =
        tree.nearest(place.data(), std::span(near).first(wanted), std::span(squared).first(wanted));
    const auto last = near.begin() + found;
    const auto first =
        std::find_if(near.begin(), last, [&](Index i) { return normals.row(i).dot(normal) > 0.0; });
    return first == last ? near.front() : *first;
}

template class KdTree<2>;
template class KdTree<3>;
template class KdTree<6>;
template class KdTree<12>;
template class KdTree<32>;

}  // namespace pointmorph
