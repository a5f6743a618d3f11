#include "registration/divided_components.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/whole.hpp"

namespace pointmorph {

namespace {

/// The main components of one shape, in coordinates that both have.
struct Pieces {
    Topology topology;
    Positions places;
    std::vector<std::vector<Index>> rows{};
    std::vector<Whole> wholes{};
    std::vector<char> kept{};      ///< marked, or divided, or one that another is divided among
    std::vector<char> shares{};    ///< of another component
    std::vector<Index> partner{};  ///< −1 without a counterpart
};

Pieces pieces_of(const ComponentView& view, const Similarity& to_common) {
    Pieces pieces{view.topology, to_common.apply(view.positions)};
    const std::size_t main = view.topology.main().size();
    pieces.rows.resize(main);
    for (std::size_t i = 0; i < view.topology.labels.size(); ++i) {
        const std::size_t label = to_size(view.topology.labels[i]);
        if (label < main) pieces.rows[label].push_back(to_index(i));
    }
    for (const auto& rows : pieces.rows) pieces.wholes.push_back(whole_of(pieces.places, rows));
    pieces.kept.assign(main, 0);
    pieces.shares.assign(main, 0);
    pieces.partner.assign(main, -1);
    return pieces;
}

/// Several components as one.
Whole as_one(const Pieces& pieces, std::span<const Index> members) {
    std::vector<Whole> wholes;
    std::vector<Index> points;
    for (const Index m : members) {
        wholes.push_back(pieces.wholes[to_size(m)]);
        points.push_back(to_index(pieces.rows[to_size(m)].size()));
    }
    return whole_of(wholes, points);
}

/// Whether the middle of one lies in the other's place.
bool lies_in(const Whole& one, const Whole& other) {
    constexpr double kThinnest = 0.15;  // of the size: a place is at least that thick
    constexpr double kWithin = 2.2;     // standard deviations; the face of a box is at 1.7
    const Vector3 arm = (one.middle - other.middle).transpose();
    const double least = kThinnest * other.size;
    const Matrix3 place = other.covariance + least * least * Matrix3::Identity();
    return arm.dot(place.llt().solve(arm)) <= kWithin * kWithin;
}

/// How unlike two are; half as much by place, which what lies around them shifts.
double unlikeness(const Whole& one, Whole other) {
    other.middle = 0.5 * (one.middle + other.middle);
    return distance_between(one, other);
}

/// Whether one of several is nearly all of them: it is the counterpart then, and has parts.
bool is_mostly_one(const Pieces& pieces, std::span<const Index> members) {
    constexpr double kMost = 0.7;  // of the points
    std::size_t all = 0, most = 0;
    for (const Index m : members) {
        all += pieces.rows[to_size(m)].size();
        most = std::max(most, pieces.rows[to_size(m)].size());
    }
    return static_cast<double>(most) > kMost * static_cast<double>(all);
}

/// The components that lie together in the place of a component and resemble it as one, much more
/// than any single one does; those that spoil the likeness left out. None where fewer than two are
/// left.
std::vector<Index> members_for(const Pieces& here, Index component, const Pieces& there) {
    constexpr double kAlike = 0.4;     // largest unlikeness over the component's size
    constexpr double kMuchMore = 0.5;  // times as unlike as the likest single one, at most
    const Whole& whole = here.wholes[to_size(component)];
    std::vector<Index> members;
    double alike = kAlike * whole.size;
    for (Index m = 0; m < to_index(there.wholes.size()); ++m) {
        const Index partner = there.partner[to_size(m)];
        alike = std::min(alike, kMuchMore * unlikeness(whole, there.wholes[to_size(m)]));
        if (there.kept[to_size(m)] || (partner >= 0 && partner != component)) continue;
        if (lies_in(there.wholes[to_size(m)], whole)) members.push_back(m);
    }
    if (members.size() < 2) return {};
    double found = unlikeness(whole, as_one(there, members));
    while (found > alike && members.size() > 2) {
        std::size_t worst = 0;
        found = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < members.size(); ++k) {
            std::vector<Index> others = members;
            others.erase(others.begin() + static_cast<std::ptrdiff_t>(k));
            const double without = unlikeness(whole, as_one(there, others));
            if (without >= found) continue;
            found = without;
            worst = k;
        }
        members.erase(members.begin() + static_cast<std::ptrdiff_t>(worst));
    }
    if (found > alike || is_mostly_one(there, members)) return {};
    return members;
}

/// The rows of a component by the member that they are for, once it is laid over all members.
std::vector<std::vector<Index>> shares_of(const Pieces& here, Index component, const Pieces& there,
                                          std::span<const Index> members) {
    const auto& rows = here.rows[to_size(component)];
    const Whole &from = here.wholes[to_size(component)], to = as_one(there, members);
    const Matrix3 stretch = stretch_between(from, to, Matrix3::Identity());
    std::vector<std::unique_ptr<Positions>> points;
    std::vector<KdTree<3>> trees;
    for (const Index m : members) {
        points.push_back(std::make_unique<Positions>(gather(there.places, there.rows[to_size(m)])));
        trees.emplace_back(*points.back());
    }
    std::vector<std::vector<Index>> shares(members.size());
    for (const Index row : rows) {
        const Eigen::RowVector3d place =
            (here.places.row(row) - from.middle) * stretch.transpose() + to.middle;
        double least = std::numeric_limits<double>::infinity();
        std::size_t nearest = 0;
        for (std::size_t k = 0; k < members.size(); ++k) {
            Index beside;
            double squared;
            trees[k].nearest(place.data(), {&beside, 1}, {&squared, 1});
            if (squared >= least) continue;
            least = squared;
            nearest = k;
        }
        shares[nearest].push_back(row);
    }
    return shares;
}

/// Makes the shares components: the first keeps the number, the others come after all main ones.
/// Their numbers.
std::vector<Index> divide(Pieces& pieces, Index component,
                          const std::vector<std::vector<Index>>& shares) {
    Topology& topology = pieces.topology;
    const auto main = to_index(topology.main().size());
    const auto added = to_index(shares.size()) - 1;
    for (Index& label : topology.labels)
        if (label >= main) label += added;
    const Component whole = topology.components[to_size(component)];
    topology.components.insert(topology.components.begin() + main, to_size(added), whole);
    std::vector<Index> numbers;
    for (std::size_t k = 0; k < shares.size(); ++k) {
        const Index number = k == 0 ? component : main + to_index(k) - 1;
        for (const Index row : shares[k]) topology.labels[to_size(row)] = number;
        topology.components[to_size(number)].points = to_index(shares[k].size());
        numbers.push_back(number);
    }
    pieces.rows.resize(topology.main().size());
    pieces.wholes.resize(topology.main().size());
    pieces.kept.resize(topology.main().size(), 1);
    pieces.shares.resize(topology.main().size(), 1);
    pieces.partner.resize(topology.main().size(), -1);
    for (std::size_t k = 0; k < shares.size(); ++k) {
        pieces.rows[to_size(numbers[k])] = shares[k];
        pieces.wholes[to_size(numbers[k])] = whole_of(pieces.places, shares[k]);
    }
    pieces.kept[to_size(component)] = pieces.shares[to_size(component)] = 1;
    return numbers;
}

/// Divides a component of `here` where that is in place; how many it is divided among, or 0.
Index divide_where_alike(Pieces& here, Index component, Pieces& there) {
    if (here.kept[to_size(component)]) return 0;
    std::vector<Index> members = members_for(here, component, there);
    std::vector<std::vector<Index>> shares;
    while (members.size() > 1) {
        shares = shares_of(here, component, there, members);
        constexpr std::size_t kFewest = 4;  // points that a share needs to be something
        const auto least = std::ranges::min_element(shares, {}, &std::vector<Index>::size);
        if (least->size() >= kFewest) break;
        members.erase(members.begin() + (least - shares.begin()));
    }
    if (members.size() < 2) return 0;
    const Index before = here.partner[to_size(component)];
    if (before >= 0) there.partner[to_size(before)] = -1;
    const std::vector<Index> numbers = divide(here, component, shares);
    for (std::size_t k = 0; k < members.size(); ++k) {
        here.partner[to_size(numbers[k])] = members[k];
        there.partner[to_size(members[k])] = numbers[k];
        there.kept[to_size(members[k])] = 1;
    }
    return to_index(members.size());
}

/// The same, once more in the numbers of both.
ComponentMatching matching_of(const Pieces& source, const Pieces& target,
                              const ComponentMatching& before) {
    ComponentMatching matching;
    for (std::size_t i = 0; i < source.partner.size(); ++i) {
        if (source.partner[i] < 0)
            matching.source_alone.push_back(to_index(i));
        else
            matching.matched.push_back({to_index(i), source.partner[i]});
    }
    for (std::size_t j = 0; j < target.partner.size(); ++j)
        if (target.partner[j] < 0) matching.target_alone.push_back(to_index(j));
    matching.on_others = before.on_others;
    std::ranges::stable_sort(matching.matched, std::greater<>(), [&](const IndexPair& pair) {
        return source.rows[to_size(pair.source)].size() + target.rows[to_size(pair.target)].size();
    });
    return matching;
}

}  // namespace

DividedComponents divide_components(const ComponentView& source, const ComponentView& target,
                                    const ComponentMatching& matching,
                                    std::span<const IndexPair> marks, const Similarity& alignment,
                                    Progress& progress) {
    Pieces s = pieces_of(source, Similarity{}), t = pieces_of(target, alignment);
    for (const IndexPair& pair : matching.matched) {
        s.partner[to_size(pair.source)] = pair.target;
        t.partner[to_size(pair.target)] = pair.source;
    }
    const auto keep = [](Pieces& pieces, Index row) {
        const std::size_t label = to_size(pieces.topology.labels[to_size(row)]);
        if (label < pieces.kept.size()) pieces.kept[label] = 1;
    };
    for (const IndexPair& mark : marks) {
        keep(s, mark.source);
        keep(t, mark.target);
    }
    DividedComponents divided;
    const auto divide_all = [&](Pieces& here, Pieces& there, std::vector<Index>& among) {
        const auto main = to_index(here.topology.main().size());
        for (Index component = 0; component < main; ++component) {
            progress.throw_if_cancelled();
            const Index count = divide_where_alike(here, component, there);
            if (count > 0) among.push_back(count);
        }
    };
    divide_all(s, t, divided.among_target);
    divide_all(t, s, divided.among_source);
    const bool any = !divided.among_target.empty() || !divided.among_source.empty();
    divided.matching = any ? matching_of(s, t, matching) : matching;
    if (any)
        for (const auto& [i, j] : divided.matching.matched)
            divided.kinds.push_back(s.shares[to_size(i)]   ? GroupKind::kShareOfSource
                                    : t.shares[to_size(j)] ? GroupKind::kShareOfTarget
                                                           : GroupKind::kPlain);
    divided.source = std::move(s.topology);
    divided.target = std::move(t.topology);
    return divided;
}

std::vector<std::string> divisions_in_words(const DividedComponents& divided,
                                            const std::string& source, const std::string& target) {
    std::vector<std::string> words;
    const auto say = [&](std::span<const Index> among, const std::string& whole,
                         const std::string& members) {
        if (among.empty()) return;
        const Index all = std::accumulate(among.begin(), among.end(), Index{0});
        words.push_back(std::to_string(among.size()) + (among.size() == 1 ? " piece" : " pieces") +
                        " of " + whole + (among.size() == 1 ? " is" : " are") + " divided among " +
                        std::to_string(all) + " of " + members + ", which lie together in " +
                        (among.size() == 1 ? "its" : "their") + " place.");
    };
    say(divided.among_target, source, target);
    say(divided.among_source, target, source);
    return words;
}

}  // namespace pointmorph
