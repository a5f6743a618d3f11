#include "pointmorph/cloud/lod.hpp"

#include <algorithm>
#include <string>
#include <tuple>
#include <utility>

#include "cloud/moments.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/covariance.hpp"

namespace pointmorph {

namespace {

struct Member {
    Vector3 position;
    Index place;  ///< in `rows`
};

/// A subtree: consecutive members, and what is known of them before they are looked at.
struct Node {
    std::span<Member> members;
    Moments moments;
};

/// The direction of greatest variation; of both signs the one whose largest component is positive,
/// so that rounding doesn't swap the two halves.
Vector3 split_direction(const Moments& moments) {
    const Vector3 direction = principal_axes(moments.covariance()).axes.col(2);
    Eigen::Index largest;
    direction.cwiseAbs().maxCoeff(&largest);
    return direction[largest] < 0.0 ? Vector3(-direction) : direction;
}

class Splitter {
public:
    explicit Splitter(std::span<const Index> rows) : rows_(rows) {}

    /// Reorders the members and returns both halves, neither of them empty. One pass sorts them
    /// and gathers the children's moments.
    std::pair<Node, Node> split(const Node& node) const {
        const Vector3 centroid = node.moments.mean();
        const Vector3 direction = split_direction(node.moments);
        Moments below(centroid), above(centroid);
        auto first = node.members.begin(), last = node.members.end();
        while (first != last) {
            if (direction.dot(first->position - centroid) < 0.0) {
                below.add(first->position);
                ++first;
            } else {
                above.add(first->position);
                std::swap(*first, *--last);
            }
        }
        if (first == node.members.begin() || first == node.members.end()) return halve(node);
        return {{{node.members.begin(), first}, below}, {{first, node.members.end()}, above}};
    }

    /// Splits `root` and its parts until `is_done(node)`, and visits those depth first, which is
    /// the order of the members.
    template <class IsDone, class Visit>
    void descend(const Node& root, IsDone&& is_done, Visit&& visit) const {
        std::vector<Node> waiting{root};
        while (!waiting.empty()) {
            const Node node = waiting.back();
            waiting.pop_back();
            if (is_done(node)) {
                visit(node);
            } else {
                const auto [below, above] = split(node);
                waiting.push_back(above);
                waiting.push_back(below);
            }
        }
    }

    Index row(const Member& member) const { return rows_[to_size(member.place)]; }

private:
    /// For points that coincide as far as their covariance can tell.
    std::pair<Node, Node> halve(const Node& node) const {
        const auto key = [&](const Member& m) {
            return std::tuple(m.position.x(), m.position.y(), m.position.z(), row(m));
        };
        const auto middle = node.members.begin() + node.members.size() / 2;
        std::nth_element(node.members.begin(), middle, node.members.end(),
                         [&](const Member& a, const Member& b) { return key(a) < key(b); });
        return {node_of({node.members.begin(), middle}), node_of({middle, node.members.end()})};
    }

    static Node node_of(std::span<Member> members) {
        Node node{members, Moments(members.front().position)};
        for (const Member& member : members) node.moments.add(member.position);
        return node;
    }

    std::span<const Index> rows_;
};

}  // namespace

Lod simplify(const Positions& positions, std::span<const Index> rows, const LodOptions& options,
             Progress& progress) {
    if (options.max_cluster_size < 1)
        throw OptionError("max_cluster_size", "1 or more", std::to_string(options.max_cluster_size),
                          "Set the most points that a cluster may hold.");
    Lod result;
    result.offsets = {0};
    if (rows.empty()) {
        result.centroids.resize(0, 3);
        return result;
    }

    std::vector<Member> members;
    members.reserve(rows.size());
    Node root{{}, Moments(positions.row(rows.front()).transpose())};
    for (const Index row : rows) {
        members.push_back({positions.row(row), to_index(members.size())});
        root.moments.add(members.back().position);
    }
    root.members = members;

    // The first splits, one after the other, leave subtrees for all threads. Their number doesn't
    // depend on that of the threads.
    constexpr std::size_t kSubtree = 2048;
    const Splitter splitter(rows);
    const auto max_size = to_size(options.max_cluster_size);
    std::vector<Node> subtrees;
    splitter.descend(
        root,
        [&](const Node& node) {
            progress.report(0.0);
            return node.members.size() <= std::max(kSubtree, max_size);
        },
        [&](const Node& node) { subtrees.push_back(node); });
    std::vector<std::vector<Index>> sizes(subtrees.size());
    parallel_for(
        to_index(subtrees.size()), progress,
        [&](Index begin, Index end) {
            for (auto i = to_size(begin); i < to_size(end); ++i)
                splitter.descend(
                    subtrees[i], [&](const Node& node) { return node.members.size() <= max_size; },
                    [&](const Node& node) {
                        std::ranges::sort(node.members, {},
                                          [&](const Member& m) { return splitter.row(m); });
                        sizes[i].push_back(to_index(node.members.size()));
                    });
        },
        0.3, 0.9, 1);

    for (const auto& some : sizes)
        for (const Index size : some) result.offsets.push_back(result.offsets.back() + size);
    const auto count = to_index(result.offsets.size()) - 1;
    result.centroids.resize(count, 3);
    result.members.resize(rows.size());
    result.cluster.resize(rows.size());
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            for (Index c = begin; c < end; ++c) {
                const auto first = to_size(result.offsets[c]);
                const auto last = to_size(result.offsets[c + 1]);
                const Vector3 origin = members[first].position;
                Vector3 sum = Vector3::Zero();
                for (std::size_t m = first; m < last; ++m) {
                    sum += members[m].position - origin;
                    result.members[m] = splitter.row(members[m]);
                    result.cluster[to_size(members[m].place)] = c;
                }
                result.centroids.row(c) = origin + sum / static_cast<double>(last - first);
            }
        },
        0.9, 1.0);
    return result;
}

}  // namespace pointmorph
