#include "registration/divided_components.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "base/quietly.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "registration/component_lists.hpp"
#include "registration/whole.hpp"

namespace pointmorph {

namespace {

constexpr double kPlace = 0.5;  // of a difference in place counts: what lies around shifts it

/// The components of one shape, in coordinates that both have.
struct Pieces {
    Pieces(const ComponentView& view, const Similarity& to_common)
        : topology(view.topology),
          places(to_common.apply(view.positions)),
          rows(rows_of(topology)),
          wholes(wholes_of(places, topology, rows)),
          kept(wholes.size(), 0),
          shares(wholes.size(), 0),
          partner(wholes.size(), -1) {}

    Topology topology;
    Positions places;
    std::vector<std::vector<Index>> rows;
    // Of the main ones:
    std::vector<Whole> wholes;
    std::vector<char> kept;      ///< marked, or divided, or one that another is divided among
    std::vector<char> shares;    ///< of another component
    std::vector<Index> partner;  ///< −1 without a counterpart
};

/// What a component is divided among, and its rows by that.
struct Division {
    Index component;
    std::vector<Index> members;
    std::vector<std::vector<Index>> shares;
};

/// Several components as one; `origin` is near them.
JoinedWhole as_one(const Pieces& pieces, std::span<const Index> members, const Whole& origin) {
    JoinedWhole joined(origin.middle);
    for (const Index m : members)
        joined.add(pieces.wholes[to_size(m)], to_index(pieces.rows[to_size(m)].size()));
    return joined;
}

/// Where a component is; its size is positive.
class Place {
public:
    explicit Place(const Whole& whole)
        : middle_(whole.middle), reach_(kWithin * std::sqrt(1.0 + kThinnest * kThinnest)) {
        const double least = kThinnest * whole.size;
        place_.compute(whole.covariance + least * least * Matrix3::Identity());
        reach_ *= whole.size;
    }

    /// Nothing farther from the middle lies in it.
    double reach() const { return reach_; }

    /// Whether the middle of another one lies in it.
    bool holds(const Whole& other) const {
        const Vector3 arm = (other.middle - middle_).transpose();
        return arm.dot(place_.solve(arm)) <= kWithin * kWithin;
    }

private:
    static constexpr double kThinnest = 0.15;  // of the size: a place is at least that thick
    static constexpr double kWithin = 2.2;     // standard deviations; the face of a box is at 1.7

    Eigen::RowVector3d middle_;
    double reach_;
    Eigen::LLT<Matrix3> place_;
};

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

Positions middles_of(std::span<const Whole> wholes) {
    Positions middles(static_cast<Eigen::Index>(wholes.size()), 3);
    for (std::size_t c = 0; c < wholes.size(); ++c)
        middles.row(static_cast<Eigen::Index>(c)) = wholes[c].middle;
    return middles;
}

/// Finds which components of one shape to divide among those of the other.
class Divider {
public:
    Divider(const Pieces& here, const Pieces& there)
        : here_(here), there_(there), middles_(middles_of(there.wholes)), tree_(middles_) {}

    std::optional<Division> division(Index component, Progress& progress) const {
        constexpr std::size_t kMostMembers = 64;  // more are a crowd, such as leaves
        constexpr std::size_t kFewest = 4;        // points that a share needs to be something
        constexpr int kRounds = 3;                // of leaving those out that get fewer
        const Whole& whole = here_.wholes[to_size(component)];
        if (here_.kept[to_size(component)] || !(whole.size > 0.0)) return {};
        std::vector<Index> members = members_within(Place(whole), component);
        if (members.size() < 2 || members.size() > kMostMembers) return {};
        const DistanceFrom from(whole);
        const double alike = largest_unlikeness(whole, from);
        for (int round = 0; round < kRounds; ++round) {
            members = alike_together(std::move(members), whole, from, alike);
            if (members.size() < 2) return {};
            auto shares = shares_of(component, members, progress);
            std::vector<Index> large;
            for (std::size_t k = 0; k < members.size(); ++k)
                if (shares[k].size() >= kFewest) large.push_back(members[k]);
            if (large.size() == members.size())
                return Division{component, std::move(members), std::move(shares)};
            members = std::move(large);
        }
        return {};
    }

private:
    /// The components that lie in a component's place and have no other counterpart.
    std::vector<Index> members_within(const Place& place, Index component) const {
        std::vector<std::pair<Index, double>> near;
        tree_.within_unsorted(here_.wholes[to_size(component)].middle.data(), place.reach(), near);
        std::vector<Index> members;
        for (const auto& [m, squared] : near) {
            const Index partner = there_.partner[to_size(m)];
            if (there_.kept[to_size(m)] || (partner >= 0 && partner != component)) continue;
            if (place.holds(there_.wholes[to_size(m)])) members.push_back(m);
        }
        std::ranges::sort(members);
        return members;
    }

    /// That several may have: much less than any single one has.
    double largest_unlikeness(const Whole& whole, const DistanceFrom& from) const {
        constexpr double kAlike = 0.4;     // over the component's size, at most
        constexpr double kMuchMore = 0.5;  // times that of the likest single one, at most
        double alike = kAlike * whole.size;
        std::vector<std::pair<Index, double>> near;
        tree_.within_unsorted(whole.middle.data(), alike / (kMuchMore * kPlace), near);
        for (const auto& [m, squared] : near) {
            const Whole& one = there_.wholes[to_size(m)];
            if (kMuchMore * from.at_least(one, kPlace) < alike)
                alike = std::min(alike, kMuchMore * from(one, kPlace));
        }
        return alike;
    }

    /// Those that resemble a component as one; those that spoil the likeness left out. Fewer than
    /// two where they don't.
    std::vector<Index> alike_together(std::vector<Index> members, const Whole& whole,
                                      const DistanceFrom& from, double alike) const {
        JoinedWhole joined = as_one(there_, members, whole);
        const auto take_out = [&](JoinedWhole& from_all, Index m) {
            from_all.take_out(there_.wholes[to_size(m)], to_index(there_.rows[to_size(m)].size()));
        };
        double found = from(joined.all(), kPlace);
        while (found > alike && members.size() > 2) {
            std::size_t worst = 0;
            found = std::numeric_limits<double>::infinity();
            for (std::size_t k = 0; k < members.size(); ++k) {
                JoinedWhole others = joined;
                take_out(others, members[k]);
                const Whole all = others.all();
                if (from.at_least(all, kPlace) >= found) continue;
                const double without = from(all, kPlace);
                if (without >= found) continue;
                found = without;
                worst = k;
            }
            take_out(joined, members[worst]);
            members.erase(members.begin() + static_cast<std::ptrdiff_t>(worst));
        }
        if (found > alike || is_mostly_one(there_, members)) return {};
        return members;
    }

    /// The rows of a component by the member that they are for, once it is laid over all members.
    std::vector<std::vector<Index>> shares_of(Index component, std::span<const Index> members,
                                              Progress& progress) const {
        const auto& rows = here_.rows[to_size(component)];
        const Whole& from = here_.wholes[to_size(component)];
        const Whole to = as_one(there_, members, from).all();
        const Matrix3 stretch = stretch_between(from, to, Matrix3::Identity());
        std::vector<Index> rows_there;
        std::vector<std::size_t> member_of;
        for (std::size_t k = 0; k < members.size(); ++k) {
            const auto& own = there_.rows[to_size(members[k])];
            rows_there.insert(rows_there.end(), own.begin(), own.end());
            member_of.resize(rows_there.size(), k);
        }
        const Positions points = gather(there_.places, rows_there);
        const KdTree<3> tree(points);
        std::vector<Index> nearest(rows.size());
        quietly(progress, [&](Progress& quiet) {
            parallel_for(to_index(rows.size()), quiet, [&](Index begin, Index end) {
                for (Index i = begin; i < end; ++i) {
                    const Eigen::RowVector3d place =
                        (here_.places.row(rows[to_size(i)]) - from.middle) * stretch.transpose() +
                        to.middle;
                    double squared;
                    tree.nearest(place.data(), {&nearest[to_size(i)], 1}, {&squared, 1});
                }
            });
        });
        std::vector<std::vector<Index>> shares(members.size());
        for (std::size_t i = 0; i < rows.size(); ++i)
            shares[member_of[to_size(nearest[i])]].push_back(rows[i]);
        return shares;
    }

    const Pieces &here_, &there_;
    Positions middles_;
    KdTree<3> tree_;
};

/// The divisions that are in place. Their members, and what was the counterpart of what is divided,
/// are set free for them.
std::vector<Division> find_divisions(Pieces& here, Pieces& there, Progress& progress) {
    std::vector<Division> divisions;
    const Divider divider(here, there);
    for (Index component = 0; component < to_index(here.wholes.size()); ++component) {
        if (!progress.poll()) progress.throw_if_cancelled();
        std::optional<Division> found = divider.division(component, progress);
        if (!found) continue;
        for (const Index m : found->members) there.kept[to_size(m)] = 1;
        const Index before = here.partner[to_size(component)];
        if (before >= 0) there.partner[to_size(before)] = -1;
        here.partner[to_size(component)] = -1;
        divisions.push_back(std::move(*found));
    }
    return divisions;
}

/// Makes the shares components, each the counterpart of its member: the first keeps the number, the
/// others come after all main ones. How many there are of each.
std::vector<Index> divide(Pieces& here, Pieces& there, std::vector<Division> divisions) {
    std::vector<Index> among;
    if (divisions.empty()) return among;
    Topology& topology = here.topology;
    const std::size_t main = topology.main().size();
    std::size_t all = main;
    for (const Division& division : divisions) all += division.shares.size() - 1;
    for (Index& label : topology.labels)
        if (to_size(label) >= main) label += to_index(all - main);
    const auto strays = topology.components.begin() + static_cast<std::ptrdiff_t>(main);
    topology.components.insert(strays, all - main, Component{});
    here.rows.insert(here.rows.begin() + static_cast<std::ptrdiff_t>(main), all - main, {});
    here.wholes.resize(all);
    here.kept.resize(all, 1);
    here.shares.resize(all, 1);
    here.partner.resize(all, -1);
    std::size_t next = main;
    for (Division& division : divisions) {
        among.push_back(to_index(division.shares.size()));
        Component part = topology.components[to_size(division.component)];
        part.genus.reset();  // it was that of the whole
        for (std::size_t k = 0; k < division.shares.size(); ++k) {
            const std::size_t number = k == 0 ? to_size(division.component) : next++;
            for (const Index row : division.shares[k])
                topology.labels[to_size(row)] = to_index(number);
            part.points = to_index(division.shares[k].size());
            topology.components[number] = part;
            here.wholes[number] = whole_of(here.places, division.shares[k]);
            here.rows[number] = std::move(division.shares[k]);
            here.kept[number] = here.shares[number] = 1;
            here.partner[number] = division.members[k];
            there.partner[to_size(division.members[k])] = to_index(number);
        }
    }
    return among;
}

/// Main components without a counterpart, but for what is marked, and a topology of these alone:
/// all else are strays.
struct AloneComponents {
    explicit AloneComponents(const Pieces& pieces) {
        const auto others = to_index(pieces.topology.components.size());
        std::vector<Index> places(to_size(others), -1);
        for (std::size_t c = 0; c < pieces.partner.size(); ++c) {
            if (pieces.partner[c] >= 0 || pieces.kept[c]) continue;
            places[c] = to_index(numbers.size());
            numbers.push_back(to_index(c));
            topology.components.push_back(pieces.topology.components[c]);
        }
        Component rest;
        for (const Index label : pieces.topology.labels) {
            const Index place = places[to_size(label)];
            rest.points += place < 0;
            topology.labels.push_back(place < 0 ? to_index(numbers.size()) : place);
        }
        topology.components.push_back(rest);
        topology.strays = 1;
    }

    std::vector<Index> numbers{};
    Topology topology{};
};

/// Matches what lost its counterpart to divided components with what has none.
void match_freed(const std::pair<const ComponentView&, const ComponentView&>& views, Pieces& source,
                 Pieces& target, const MatchedBy& by, Progress& progress) {
    const auto& [source_view, target_view] = views;
    const AloneComponents s(source), t(target);
    if (s.numbers.empty() || t.numbers.empty()) return;
    const ComponentMatching found = match_components(
        {s.topology, source_view.positions, source_view.normals, source_view.images},
        {t.topology, target_view.positions, target_view.normals, target_view.images}, {},
        by.alignment, by.options, progress);
    for (const auto& [i, j] : found.matched) {
        source.partner[to_size(s.numbers[to_size(i)])] = t.numbers[to_size(j)];
        target.partner[to_size(t.numbers[to_size(j)])] = s.numbers[to_size(i)];
    }
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
    sort_by_points(matching.matched, source.topology, target.topology);
    return matching;
}

}  // namespace

DividedComponents divide_components(const ComponentView& source, const ComponentView& target,
                                    const ComponentMatching& matching, const MatchedBy& by,
                                    Progress& progress) {
    Pieces s(source, Similarity{}), t(target, by.alignment);
    for (const IndexPair& pair : matching.matched) {
        s.partner[to_size(pair.source)] = pair.target;
        t.partner[to_size(pair.target)] = pair.source;
    }
    const auto keep = [](Pieces& pieces, Index row) {
        const std::size_t label = to_size(pieces.topology.labels[to_size(row)]);
        if (label < pieces.kept.size()) pieces.kept[label] = 1;
    };
    for (const IndexPair& mark : by.marks) {
        keep(s, mark.source);
        keep(t, mark.target);
    }
    DividedComponents divided;
    divided.among_target = divide(s, t, find_divisions(s, t, progress));
    divided.among_source = divide(t, s, find_divisions(t, s, progress));
    const bool any = !divided.among_target.empty() || !divided.among_source.empty();
    if (std::ranges::any_of(matching.matched, [&](const IndexPair& pair) {
            return s.partner[to_size(pair.source)] < 0 || t.partner[to_size(pair.target)] < 0;
        }))
        match_freed({source, target}, s, t, by, progress);
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
