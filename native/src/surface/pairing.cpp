#include "pointmorph/surface/pairing.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>

#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr Index kLargestCluster = 1000;
/// Clusters of this size are handed to the threads as wholes, larger ones level by level.
constexpr Index kSubtree = 4096;

template <int Dim>
using Vector = Eigen::Matrix<double, Dim, 1>;
template <int Dim>
using Matrix = Eigen::Matrix<double, Dim, Dim>;

/// One point of a cloud's image.
template <int Dim>
struct Image {
    Eigen::Matrix<double, Dim, 1, Eigen::DontAlign> at;  // no padding
    Index row;
};

/// A cluster's points of one cloud: a part of that cloud's images, which splits reorder.
template <int Dim>
using Part = std::span<Image<Dim>>;

template <int Dim>
struct Cluster {
    Part<Dim> source, target;

    Index size() const { return to_index(source.size() + target.size()); }
    bool is_final(Index max_size) const {
        const auto limit = to_size(max_size);
        return (source.size() <= limit && target.size() <= limit) || source.size() < 2 ||
               target.size() < 2;
    }
};

template <int Dim>
struct Halves {
    Cluster<Dim> low, high;
};

/// Where the points of a cluster are.
template <int Dim>
struct Spread {
    Vector<Dim> centroid;
    Matrix<Dim> covariance;  ///< up to a factor; its lower triangle
};

template <int Dim>
Spread<Dim> spread(const Cluster<Dim>& cluster) {
    // One pass, relative to some point of the cluster, which keeps the cancellation harmless.
    const Vector<Dim> origin = cluster.source.front().at;
    Vector<Dim> sum = Vector<Dim>::Zero();
    Matrix<Dim> products = Matrix<Dim>::Zero();
    for (const Part<Dim>& part : {cluster.source, cluster.target})
        for (const Image<Dim>& image : part) {
            const Vector<Dim> x = image.at - origin;
            sum += x;
            for (int c = 0; c < Dim; ++c)
                for (int r = c; r < Dim; ++r) products(r, c) += x[r] * x[c];
        }
    const double count = cluster.size();
    const Vector<Dim> mean = sum / count;
    for (int c = 0; c < Dim; ++c)
        for (int r = c; r < Dim; ++r) products(r, c) -= count * mean[r] * mean[c];
    return {origin + mean, products};
}

/// The eigenvector of the largest eigenvalue, by squaring: the others' shares fade until the matrix
/// is v vᵀ. Where two eigenvalues agree to rounding, any mix of their vectors is as good. Zero
/// without any spread.
template <int Dim>
Vector<Dim> greatest_variation(const Matrix<Dim>& covariance) {
    constexpr int kMostSquarings = 40;
    constexpr double kRankOne = 1.0 - 1e-13;
    Matrix<Dim> power = covariance.template selfadjointView<Eigen::Lower>();
    for (int i = 0; i < kMostSquarings; ++i) {
        const double trace = power.trace();
        if (!(trace > 0.0)) return Vector<Dim>::Zero();
        power /= trace;
        if (power.squaredNorm() >= kRankOne) break;
        power = (power * power).eval();
    }
    int longest = 0;
    power.diagonal().maxCoeff(&longest);
    return power.col(longest).normalized();
}

/// Where a point is along an axis through the centroid. One function, so that a cut found among
/// these numbers falls between the same points again.
template <int Dim>
double along(const Vector<Dim>& axis, const Vector<Dim>& centroid, const Image<Dim>& image) {
    return axis.dot(image.at - centroid);
}

/// Splits where `axis` · (x − centroid) is below `cut`.
template <int Dim>
Halves<Dim> split_at(const Cluster<Dim>& cluster, const Vector<Dim>& centroid,
                     const Vector<Dim>& axis, double cut) {
    // A partition without branches, which would be guessed wrong every other time.
    const auto divide = [&](Part<Dim> part) {
        std::size_t low = 0;
        for (Image<Dim>& image : part) {
            const Image<Dim> here = image;
            image = part[low];
            part[low] = here;
            low += along(axis, centroid, here) < cut ? 1 : 0;
        }
        return low;
    };
    const std::size_t s = divide(cluster.source), t = divide(cluster.target);
    return {{cluster.source.first(s), cluster.target.first(t)},
            {cluster.source.subspan(s), cluster.target.subspan(t)}};
}

template <int Dim>
bool has_both(const Halves<Dim>& halves) {
    return !halves.low.source.empty() && !halves.low.target.empty() &&
           !halves.high.source.empty() && !halves.high.target.empty();
}

/// The cut nearest to the centroid that leaves both halves at least one point of each cloud.
template <int Dim>
std::optional<double> admissible_cut(const Cluster<Dim>& cluster, const Vector<Dim>& centroid,
                                     const Vector<Dim>& axis) {
    double first = -std::numeric_limits<double>::infinity();  // by which both clouds have begun
    double last = -first;                                     // before which neither has ended
    for (const Part<Dim>& part : {cluster.source, cluster.target}) {
        double low = std::numeric_limits<double>::infinity(), high = -low;
        for (const Image<Dim>& image : part) {
            const double place = along(axis, centroid, image);
            low = std::min(low, place);
            high = std::max(high, place);
        }
        first = std::max(first, low);
        last = std::min(last, high);
    }
    if (!(first < last)) return std::nullopt;
    return std::clamp(0.0, std::nextafter(first, last), last);
}

/// Halves each cloud's points by itself.
template <int Dim>
Halves<Dim> split_by_rank(const Cluster<Dim>& cluster, const Vector<Dim>& centroid,
                          const Vector<Dim>& axis) {
    const auto halve = [&](Part<Dim> part) {
        const std::size_t half = part.size() / 2;
        std::nth_element(part.begin(), part.begin() + static_cast<std::ptrdiff_t>(half), part.end(),
                         [&](const Image<Dim>& a, const Image<Dim>& b) {
                             const double x = along(axis, centroid, a);
                             const double y = along(axis, centroid, b);
                             return x != y ? x < y : a.row < b.row;
                         });
        return half;
    };
    const std::size_t s = halve(cluster.source), t = halve(cluster.target);
    return {{cluster.source.first(s), cluster.target.first(t)},
            {cluster.source.subspan(s), cluster.target.subspan(t)}};
}

template <int Dim>
Halves<Dim> split(const Cluster<Dim>& cluster) {
    const Spread<Dim> where = spread(cluster);
    const Vector<Dim> axis = greatest_variation<Dim>(where.covariance);
    const Halves<Dim> halves = split_at(cluster, where.centroid, axis, 0.0);
    if (has_both(halves)) return halves;
    if (const auto cut = admissible_cut(cluster, where.centroid, axis))
        return split_at(cluster, where.centroid, axis, *cut);

    const Eigen::SelfAdjointEigenSolver<Matrix<Dim>> eigen(where.covariance);
    for (int i = Dim - 2; i >= 0; --i) {
        const Vector<Dim> other = eigen.eigenvectors().col(i);
        if (const auto cut = admissible_cut(cluster, where.centroid, other))
            return split_at(cluster, where.centroid, other, *cut);
    }
    return split_by_rank(cluster, where.centroid, axis);
}

/// Each row's partner, or −1 where the row is a partner of rows of the other cloud: within a
/// cluster, the points of the larger side have one each.
struct Partners {
    std::vector<Index> of_source, of_target;
};

/// Pairs the points of one cluster by the greedy rule. One object a thread: keeps its memory.
template <int Dim>
class Matcher {
public:
    explicit Matcher(Partners& partners) : partners_(partners) {}

    void match(const Cluster<Dim>& cluster) {
        if (cluster.source.size() >= cluster.target.size())
            match(cluster.source, cluster.target, partners_.of_source);
        else
            match(cluster.target, cluster.source, partners_.of_target);
    }

private:
    struct Candidate {
        const Image<Dim>* image;    ///< of the smaller side
        const Image<Dim>* nearest;  ///< of the larger side, not taken
        double squared_distance;
    };

    static bool closer(double distance, Index row, double other_distance, Index other_row) {
        return distance != other_distance ? distance < other_distance : row < other_row;
    }

    static void find_nearest(Candidate& candidate, Part<Dim> images,
                             const std::vector<Index>& partner) {
        candidate.nearest = nullptr;
        for (const Image<Dim>& image : images) {
            if (partner[to_size(image.row)] >= 0) continue;
            const double distance = (image.at - candidate.image->at).squaredNorm();
            if (!candidate.nearest ||
                closer(distance, image.row, candidate.squared_distance, candidate.nearest->row)) {
                candidate.nearest = &image;
                candidate.squared_distance = distance;
            }
        }
    }

    void match(Part<Dim> larger, Part<Dim> smaller, std::vector<Index>& partner) {
        candidates_.clear();
        for (const Image<Dim>& image : smaller) {
            candidates_.push_back({&image, nullptr, 0.0});
            find_nearest(candidates_.back(), larger, partner);
        }
        while (!candidates_.empty()) {
            const auto best = std::ranges::min_element(candidates_, [](const Candidate& a,
                                                                       const Candidate& b) {
                return closer(a.squared_distance, a.image->row, b.squared_distance, b.image->row);
            });
            const Image<Dim>* taken = best->nearest;
            partner[to_size(taken->row)] = best->image->row;
            *best = candidates_.back();
            candidates_.pop_back();
            for (Candidate& candidate : candidates_)
                if (candidate.nearest == taken) find_nearest(candidate, larger, partner);
        }
        for (const Image<Dim>& image : larger) {
            Index& mine = partner[to_size(image.row)];
            if (mine >= 0) continue;
            double nearest = std::numeric_limits<double>::infinity();
            for (const Image<Dim>& other : smaller) {
                const double distance = (other.at - image.at).squaredNorm();
                if (mine < 0 || closer(distance, other.row, nearest, mine)) {
                    mine = other.row;
                    nearest = distance;
                }
            }
        }
    }

    Partners& partners_;
    std::vector<Candidate> candidates_;
};

/// Clusters level by level while they are large, then subtrees as wholes.
template <int Dim>
void match_all(const Cluster<Dim>& root, Index max_size, Partners& partners, Progress& progress) {
    std::vector<Cluster<Dim>> subtrees, level;
    std::vector<Halves<Dim>> halves;
    const auto sort_in = [&](const Cluster<Dim>& cluster) {
        const bool whole = cluster.is_final(max_size) || cluster.size() <= kSubtree;
        (whole ? subtrees : level).push_back(cluster);
    };
    sort_in(root);
    const double step = 0.5 * std::numbers::ln2 / std::log(2.0 + root.size() / kSubtree);
    for (double done = 0.0; !level.empty(); done = std::min(0.5, done + step)) {
        halves.resize(level.size());
        parallel_for(
            to_index(level.size()), progress,
            [&](Index begin, Index end) {
                for (auto i = to_size(begin); i < to_size(end); ++i) halves[i] = split(level[i]);
            },
            done, done, 1);
        level.clear();
        for (const Halves<Dim>& two : halves) {
            sort_in(two.low);
            sort_in(two.high);
        }
    }

    parallel_for(
        to_index(subtrees.size()), progress,
        [&](Index begin, Index end) {
            Matcher<Dim> matcher(partners);
            std::vector<Cluster<Dim>> open;
            for (Index i = begin; i < end; ++i) {
                open.push_back(subtrees[to_size(i)]);
                while (!open.empty()) {
                    const Cluster<Dim> cluster = open.back();
                    open.pop_back();
                    if (cluster.is_final(max_size)) {
                        matcher.match(cluster);
                        continue;
                    }
                    const Halves<Dim> two = split(cluster);
                    open.push_back(two.high);
                    open.push_back(two.low);
                }
            }
        },
        0.5, 1.0, 1);
}

/// Every one of `rows` gets its nearest point of the other cloud.
template <int Dim>
void match_nearest(std::span<const Image<Dim>> images, const typename KdTree<Dim>::Points& others,
                   std::vector<Index>& partner, Progress& progress) {
    const KdTree<Dim> tree(others);
    parallel_for(to_index(images.size()), progress, [&](Index begin, Index end) {
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            double squared_distance = 0.0;
            tree.nearest(images[i].at.data(), {&partner[to_size(images[i].row)], 1},
                         {&squared_distance, 1});
        }
    });
}

/// Sorted by source, then target.
Pairing sorted_pairs(const Partners& partners, std::span<const IndexPair> features) {
    // By counting: rows are visited in order, so that only the features' partners need sorting.
    const auto each_pair = [&](auto&& visit) {
        for (const IndexPair& pair : features) visit(pair.source, pair.target);
        for (std::size_t i = 0; i < partners.of_source.size(); ++i)
            if (partners.of_source[i] >= 0) visit(to_index(i), partners.of_source[i]);
        for (std::size_t j = 0; j < partners.of_target.size(); ++j)
            if (partners.of_target[j] >= 0) visit(partners.of_target[j], to_index(j));
    };
    // ends[i] is first where row i's pairs begin, and in the end where they end.
    std::vector<std::size_t> ends(partners.of_source.size() + 1, 0);
    each_pair([&](Index source, Index) { ++ends[to_size(source) + 1]; });
    std::partial_sum(ends.begin(), ends.end(), ends.begin());
    Pairing pairs(ends.back());
    each_pair([&](Index source, Index target) {
        pairs[ends[to_size(source)]++] = {source, target};
    });
    for (const IndexPair& feature : features) {
        const std::size_t begin = feature.source > 0 ? ends[to_size(feature.source) - 1] : 0;
        std::sort(pairs.begin() + static_cast<std::ptrdiff_t>(begin),
                  pairs.begin() + static_cast<std::ptrdiff_t>(ends[to_size(feature.source)]));
    }
    if (!features.empty()) pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    return pairs;
}

}  // namespace

template <int Dim>
Pairing pair_points(const typename KdTree<Dim>::Points& source,
                    const typename KdTree<Dim>::Points& target, std::span<const IndexPair> features,
                    const PairingOptions& options, Progress& progress) {
    assert(source.rows() > 0 && target.rows() > 0);
    if (options.max_cluster_size < 2 || options.max_cluster_size > kLargestCluster)
        throw OptionError("max_cluster_size",
                          "a number from 2 to " + std::to_string(kLargestCluster),
                          std::to_string(options.max_cluster_size), "The default is 10.");

    const auto images = [&](const typename KdTree<Dim>::Points& points, Index IndexPair::*side) {
        std::vector<bool> is_feature(to_size(points.rows()), false);
        for (const IndexPair& pair : features) is_feature[to_size(pair.*side)] = true;
        std::vector<Image<Dim>> result;
        result.reserve(is_feature.size());
        for (Index i = 0; i < points.rows(); ++i)
            if (!is_feature[to_size(i)]) result.push_back({points.row(i).transpose(), i});
        return result;
    };
    std::vector<Image<Dim>> source_images, target_images;
    Partners partners;
    parallel_invoke(2, [&](int k, bool) {
        const auto& points = k == 0 ? source : target;
        (k == 0 ? source_images : target_images) =
            images(points, k == 0 ? &IndexPair::source : &IndexPair::target);
        (k == 0 ? partners.of_source : partners.of_target).assign(to_size(points.rows()), -1);
    });

    if (target_images.empty())
        match_nearest<Dim>(source_images, target, partners.of_source, progress);
    else if (source_images.empty())
        match_nearest<Dim>(target_images, source, partners.of_target, progress);
    else
        match_all<Dim>({source_images, target_images}, options.max_cluster_size, partners,
                       progress);
    return sorted_pairs(partners, features);
}

template Pairing pair_points<2>(const KdTree<2>::Points&, const KdTree<2>::Points&,
                                std::span<const IndexPair>, const PairingOptions&, Progress&);
template Pairing pair_points<3>(const KdTree<3>::Points&, const KdTree<3>::Points&,
                                std::span<const IndexPair>, const PairingOptions&, Progress&);

}  // namespace pointmorph
