#include "registration/crossed_limbs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace pointmorph {

namespace {

/// What leads away from a place.
struct Arm {
    std::vector<Index> rows;           ///< next to the surroundings of the place
    Vector3 middle = Vector3::Zero();  ///< of these
    double radius = 0.0;               ///< their mean distance from it
    bool is_free = false;              ///< whether it leads to an end, and to nothing else
};

/// A limb where it meets another: the arm by which it hangs on the rest, and that of its end.
struct Limb {
    const Arm *from, *to;

    /// The cosine of the angle by which it bends at a place.
    double straightness(const Vector3& at) const {
        return (at - from->middle).normalized().dot((to->middle - at).normalized());
    }
    Vector3 axis() const { return to->middle - from->middle; }
    /// How far a place lies from the axis, which is moved, over the radius there.
    double distance(const Vector3& place, const Vector3& move) const {
        const Vector3 off = place - from->middle - move;
        const double share = std::clamp(off.dot(axis()) / axis().squaredNorm(), 0.0, 1.0);
        return (off - share * axis()).norm() / ((1.0 - share) * from->radius + share * to->radius);
    }
};

using Limbs = std::array<Limb, 2>;

/// Of each row the limb that it belongs to, 0 or 1; −1 elsewhere.
using LimbOfRows = std::vector<signed char>;

class CrossingSearch {
public:
    CrossingSearch(const Positions& positions, double unit)
        : positions_(positions),
          radius_(0.12 * unit),
          width_(0.035 * unit),
          state_(to_size(positions.rows()), State::kUnseen) {}

    /// The limbs that meet around a row, if two do.
    std::optional<LimbOfRows> find(const SurfaceGraph& graph, Index row) {
        constexpr int kCenterings = 2;
        Vector3 at = positions_.row(row).transpose();
        for (int k = 0;; ++k) {
            look_around(graph, row, at);
            if (!arms_are_those_of_limbs()) break;
            if (k == kCenterings) {
                const std::optional<Limbs> limbs = limbs_at(graph, at);
                if (!limbs) break;
                LimbOfRows of_rows = divided(*limbs);
                const bool is_whole = make_whole(graph, *limbs, of_rows);
                forget();
                return is_whole ? std::optional(std::move(of_rows)) : std::nullopt;
            }
            at.setZero();
            for (const Index i : inside_) at += positions_.row(i).transpose();
            at /= static_cast<double>(inside_.size());
            forget();
        }
        forget();
        return std::nullopt;
    }

private:
    enum class State : char { kUnseen, kInside, kShell, kArm, kOutside };

    State& state(Index row) { return state_[to_size(row)]; }
    double distance(Index row, const Vector3& at) const {
        return (positions_.row(row).transpose() - at).norm();
    }

    /// What hangs together with a row within the radius, and the arms that lead away from there.
    void look_around(const SurfaceGraph& graph, Index row, const Vector3& at) {
        const double inner = radius_ * radius_;
        inside_.assign(1, row);
        state(row) = State::kInside;
        shell_.clear();
        outside_.clear();
        for (std::size_t k = 0; k < inside_.size(); ++k)
            for (const Index j : graph[inside_[k]]) {
                if (state(j) != State::kUnseen) continue;
                const double off = (positions_.row(j).transpose() - at).squaredNorm();
                if (off < inner) {
                    state(j) = State::kInside;
                    inside_.push_back(j);
                } else {
                    put_beyond(j, off);
                }
            }
        find_arms(graph, at);
    }

    void put_beyond(Index row, double squared_distance) {
        const double outer = (radius_ + width_) * (radius_ + width_);
        const bool is_near = squared_distance < outer;
        state(row) = is_near ? State::kShell : State::kOutside;
        (is_near ? shell_ : outside_).push_back(row);
    }

    /// Each from a row of the shell that is next to the surroundings.
    void find_arms(const SurfaceGraph& graph, const Vector3& at) {
        constexpr std::size_t kFewest = 5;  // fewer rows are no arm
        constexpr double kFarOff = std::numeric_limits<double>::infinity();
        const double inner = radius_ * radius_;
        arms_.clear();
        for (std::size_t first = 0, seeds = shell_.size(); first < seeds; ++first) {
            if (state(shell_[first]) != State::kShell) continue;
            Arm arm;
            arm.rows.push_back(shell_[first]);
            state(shell_[first]) = State::kArm;
            for (std::size_t k = 0; k < arm.rows.size(); ++k)
                for (const Index j : graph[arm.rows[k]]) {
                    if (state(j) == State::kUnseen) {
                        const double off = (positions_.row(j).transpose() - at).squaredNorm();
                        put_beyond(j, off < inner ? kFarOff : off);
                    }
                    if (state(j) != State::kShell) continue;
                    state(j) = State::kArm;
                    arm.rows.push_back(j);
                }
            if (arm.rows.size() >= kFewest) arms_.push_back(std::move(arm));
        }
        if (!are_as_many_as_limbs()) return;
        for (Arm& arm : arms_) {
            const auto count = static_cast<double>(arm.rows.size());
            for (const Index i : arm.rows) arm.middle += positions_.row(i).transpose() / count;
            for (const Index i : arm.rows) arm.radius += distance(i, arm.middle) / count;
        }
    }

    bool are_as_many_as_limbs() const { return arms_.size() == 3 || arms_.size() == 4; }

    bool arms_are_those_of_limbs() const {
        constexpr double kThin = 0.6;  // over the radius of the surroundings
        return are_as_many_as_limbs() && std::ranges::all_of(arms_, [&](const Arm& arm) {
                   return arm.radius < kThin * radius_;
               });
    }

    /// The rows that an arm leads to, and no more than `most` and those next to the last.
    std::vector<Index> reached(const SurfaceGraph& graph, const Arm& arm, std::size_t most) {
        std::vector<Index> rows;
        std::vector<State> before;
        const auto add = [&](Index i) {
            if (state(i) == State::kInside) return;
            before.push_back(std::exchange(state(i), State::kInside));
            rows.push_back(i);
        };
        add(arm.rows.front());
        for (std::size_t k = 0; k < rows.size() && rows.size() <= most; ++k)
            for (const Index j : graph[rows[k]]) add(j);
        for (std::size_t k = 0; k < rows.size(); ++k) state(rows[k]) = before[k];
        return rows;
    }

    /// Finds out which arms lead to ends. Whether the other ones are two that hang together.
    bool find_ends(const SurfaceGraph& graph) {
        constexpr double kLargest = 0.1;  // share of the rows
        const auto most = static_cast<std::size_t>(kLargest * static_cast<double>(graph.size()));
        const auto lead_to = [](const std::vector<Index>& rows, const Arm& arm) {
            return std::ranges::find(rows, arm.rows.front()) != rows.end();
        };
        std::vector<const Arm*> hung;
        for (Arm& arm : arms_) {
            const std::vector<Index> rows = reached(graph, arm, most);
            arm.is_free = rows.size() <= most;
            if (!arm.is_free)
                hung.push_back(&arm);
            else if (std::ranges::count_if(
                         arms_, [&](const Arm& other) { return lead_to(rows, other); }) > 1)
                return false;
        }
        return hung.size() == 2 && hung.size() < arms_.size() &&
               lead_to(reached(graph, *hung[0], to_size(graph.size())), *hung[1]);
    }

    /// The arms that go together, if it is clear. The first limb goes on; the other one does, or
    /// ends here.
    std::optional<Limbs> limbs_at(const SurfaceGraph& graph, const Vector3& at) {
        constexpr double kStraight = 0.7, kStraightPastAnEnd = 0.8, kClearly = 0.3;
        if (!find_ends(graph)) return std::nullopt;
        std::vector<const Arm*> hung, free;
        for (const Arm& arm : arms_) (arm.is_free ? free : hung).push_back(&arm);
        const bool both_go_on = free.size() == 2;
        for (std::size_t k = 0; k < hung.size(); ++k) {
            constexpr double kBeyond = 0.4;
            const Vector3 on = (at - hung[k]->middle).normalized();
            beyond_[k] = {{}, at + kBeyond * radius_ * on, hung[k]->radius, true};
        }
        const auto paired = [&](std::size_t first) {
            const std::size_t other = 1 - first;
            return Limbs{Limb{hung[first], free[0]},
                         Limb{hung[other], both_go_on ? free[1] : &beyond_[other]}};
        };
        const auto straightness = [&](const Limbs& limbs) {
            return std::min(limbs[0].straightness(at), limbs[1].straightness(at));
        };
        const std::array<Limbs, 2> ways{paired(0), paired(1)};
        const double one = straightness(ways[0]), other = straightness(ways[1]);
        if (std::max(one, other) < (both_go_on ? kStraight : kStraightPastAnEnd) ||
            std::abs(one - other) < kClearly)
            return std::nullopt;
        return ways[one > other ? 0 : 1];
    }

    /// Rows go to the limb whose axis is nearer, and those of arms to their own.
    LimbOfRows divided(const Limbs& limbs) const {
        // Axes that meet would divide each limb in two: one limb passes in front of the other.
        constexpr double kApart = 0.6;  // radii
        const Vector3 across = limbs[0].axis().cross(limbs[1].axis()).normalized();
        const double apart = 0.5 * across.dot(limbs[0].from->middle + limbs[0].to->middle -
                                              limbs[1].from->middle - limbs[1].to->middle);
        const double radius = std::ranges::min(arms_, {}, &Arm::radius).radius;
        const double more = std::max(0.0, kApart * radius - std::abs(apart));
        const Vector3 move = (apart < 0.0 ? -0.5 : 0.5) * more * across;
        LimbOfRows of_rows(state_.size(), -1);
        for (const Index i : inside_) {
            const Vector3 place = positions_.row(i).transpose();
            of_rows[to_size(i)] =
                limbs[0].distance(place, move) <= limbs[1].distance(place, -move) ? 0 : 1;
        }
        for (std::size_t k = 0; k < limbs.size(); ++k)
            for (const Arm* arm : {limbs[k].from, limbs[k].to})
                for (const Index i : arm->rows) of_rows[to_size(i)] = static_cast<signed char>(k);
        return of_rows;
    }

    /// What doesn't hang together with its limb goes to the other. Whether all does then, with both
    /// arms of each.
    bool make_whole(const SurfaceGraph& graph, const Limbs& limbs, LimbOfRows& of_rows) const {
        constexpr int kRounds = 4;  // what is inside what goes to the other limb follows it
        for (int round = 0; round < kRounds; ++round) {
            std::vector<char> is_reached(of_rows.size(), 0);
            for (std::size_t k = 0; k < limbs.size(); ++k) {
                std::vector<Index> reached{limbs[k].from->rows.front()};
                is_reached[to_size(reached.front())] = 1;
                for (std::size_t n = 0; n < reached.size(); ++n)
                    for (const Index j : graph[reached[n]])
                        if (of_rows[to_size(j)] == static_cast<signed char>(k) &&
                            std::exchange(is_reached[to_size(j)], char{1}) == 0)
                            reached.push_back(j);
                const std::vector<Index>& end = limbs[k].to->rows;
                if (!end.empty() && is_reached[to_size(end.front())] == 0) return false;
            }
            bool is_whole = true;
            for (const Index i : inside_) {
                if (is_reached[to_size(i)] != 0) continue;
                is_whole = false;
                of_rows[to_size(i)] = static_cast<signed char>(1 - of_rows[to_size(i)]);
            }
            if (is_whole) return true;
        }
        return false;
    }

    void forget() {
        for (const std::vector<Index>* rows : {&inside_, &shell_, &outside_})
            for (const Index i : *rows) state(i) = State::kUnseen;
    }

    const Positions& positions_;
    const double radius_, width_;  ///< of the surroundings, and of the shell that tells arms apart
    std::vector<State> state_;     ///< of each row
    std::vector<Index> inside_, shell_, outside_;
    std::vector<Arm> arms_;
    std::array<Arm, 2> beyond_;  ///< where a limb that ends would go on, without rows
};

/// Drops the edges from one limb to the other.
SurfaceGraph cut_between(const SurfaceGraph& graph, const LimbOfRows& limb) {
    SurfaceGraph cut;
    for (Index i = 0; i < graph.size(); ++i) {
        for (auto e = to_size(graph.offsets[to_size(i)]);
             e < to_size(graph.offsets[to_size(i) + 1]); ++e) {
            const Index j = graph.neighbors[e];
            const signed char here = limb[to_size(i)], there = limb[to_size(j)];
            if (here >= 0 && there >= 0 && here != there) continue;
            cut.neighbors.push_back(j);
            cut.lengths.push_back(graph.lengths[e]);
        }
        cut.offsets.push_back(static_cast<std::int64_t>(cut.neighbors.size()));
    }
    return cut;
}

}  // namespace

SurfaceGraph without_crossings(const Positions& positions, double unit, SurfaceGraph graph,
                               std::span<const Index> centers) {
    CrossingSearch search(positions, unit);
    for (const Index center : centers)
        if (const auto limbs = search.find(graph, center)) graph = cut_between(graph, *limbs);
    return graph;
}

}  // namespace pointmorph
