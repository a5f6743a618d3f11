#include "pointmorph/disk/network.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "disk/network_surface.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/cloud/similarity.hpp"

namespace pointmorph {

namespace {

Dart twin(Dart dart) {
    return dart ^ 1;
}

/// A curve that might be added: the same sectors on both shapes.
struct Candidate {
    Sector from, to;
    std::array<CoarsePath, 2> paths;
    double cost;
};

/// Coarse points of a path, evenly along it.
std::vector<Index> sampled(const Positions& positions, const CoarsePath& path) {
    constexpr int kSamples = 24;
    std::vector<double> along{0.0};
    for (std::size_t k = 1; k < path.nodes.size(); ++k)
        along.push_back(along.back() +
                        (positions.row(path.nodes[k]) - positions.row(path.nodes[k - 1])).norm());
    std::vector<Index> result;
    std::size_t k = 0;
    for (int i = 0; i <= kSamples; ++i) {
        const double goal = along.back() * i / kSamples;
        while (k + 1 < along.size() && along[k + 1] - goal <= goal - along[k]) ++k;
        result.push_back(path.nodes[k]);
    }
    return result;
}

/// The span of class bits over two elements: how many are independent, and which are in it.
class Span {
public:
    bool holds(std::uint32_t bits) const { return reduced(bits) == 0; }
    void add(std::uint32_t bits) {
        if (const std::uint32_t left = reduced(bits); left != 0) sums_.push_back(left);
    }
    Index rank() const { return to_index(sums_.size()); }

private:
    std::uint32_t reduced(std::uint32_t bits) const {
        for (const std::uint32_t sum : sums_)
            if ((bits & std::bit_floor(sum)) != 0) bits ^= sum;
        return bits;
    }
    std::vector<std::uint32_t> sums_;
};

/// What a pair of paths costs for running in different places on both shapes, in √area: by position
/// once the features are laid over each other, and by the distances along the surface from all
/// features, which don't depend on poses.
struct Weights {
    double place, reach;
};

class Tracer {
public:
    Tracer(const std::array<NetworkShape, 2>& shapes, const std::array<CoarseModel, 2>& models,
           std::span<const std::string> names, const Weights& weights,
           const DecompositionOptions& options, Progress& progress)
        : shapes_(shapes),
          models_(models),
          names_(names),
          weights_(weights),
          progress_(progress),
          most_extremities_(options.extremities),
          corners_(to_index(names.size())),
          group_(names.size()) {
        for (const std::size_t m : {0u, 1u})
            surfaces_[m] = std::make_unique<NetworkSurface>(shapes[m], models[m], options);
        std::iota(group_.begin(), group_.end(), 0);
        for (auto& potential : potentials_) potential.assign(names.size(), 0);
        const auto feature_places = [&](std::size_t m) {
            return Positions(surfaces_[m]->coarse().positions.topRows(corners_));
        };
        const Similarity onto_target = fit_similarity(feature_places(0), feature_places(1));
        laid_over_[0] = onto_target.apply(surfaces_[0]->coarse().positions);
        laid_over_[1] = surfaces_[1]->coarse().positions;
        for (const std::size_t m : {0u, 1u}) {
            reach_[m] = distances_from_features(surfaces_[m]->coarse(), names.size());
        }
    }

    /// Traces all curves.
    void run(std::span<const std::vector<Index>> loops) {
        agree_on_handles();
        for (std::size_t l = 0; l < loops.size(); ++l)
            for (std::size_t k = 0; k < loops[l].size(); ++k)
                lead(loops[l][k], loops[l][(k + 1) % loops[l].size()], l);
        while (groups() > 1) join_groups();
        while (spans_[0].rank() < rank()) open_handle();
        while (part_patch()) progress_.throw_if_cancelled();
        check();
    }

    /// See Network::detour. A curve that passes a limb on the wrong side forces later ones round
    /// it.
    double detour() const {
        double sum = 0.0;
        for (const NetworkCurve& curve : curves_)
            for (const std::size_t m : {0u, 1u})
                sum += curve_length(curve.on[m].points) / surfaces_[m]->coarse().unit -
                       reach_[m](curve.from, curve.to);
        return sum / static_cast<double>(curves_.size());
    }

    /// What was traced.
    Network finished() {
        Network result;
        result.patches = faces();
        result.genus = rank() / 2;
        result.detour = detour();
        std::vector<Index> face(2 * curves_.size());
        for (std::size_t f = 0; f < result.patches.size(); ++f)
            for (const Dart dart : result.patches[f]) face[to_size(dart)] = to_index(f);
        const auto patches = to_index(result.patches.size());
        for (const std::size_t m : {0u, 1u}) {
            result.labels[m] = surfaces_[m]->labels(face, patches, progress_);
            const CoarseCloud& coarse = surfaces_[m]->coarse();
            result.unmarked[m] =
                unmarked_extremities(coarse, distances_from_features(coarse, names_.size()),
                                     most_extremities_, progress_);
        }
        result.curves = std::move(curves_);
        return result;
    }

private:
    using Accept = std::function<bool(const Candidate&)>;

    Index rank() const { return surfaces_[0]->rank(); }
    Index groups() const {
        Index count = 0;
        for (Index k = 0; k < corners_; ++k) count += group_[to_size(k)] == k ? 1 : 0;
        return count;
    }
    std::string quoted(Index corner) const { return "\"" + names_[to_size(corner)] + "\""; }

    /// Decides how many handles both shapes have: the number that most scales find on both, and
    /// that is known from elsewhere.
    void agree_on_handles() {
        constexpr Index kMostHandles = 4, kKnown = 2;
        std::array<std::vector<Index>, 2> votes;
        std::array<Index, 2> likeliest{};
        for (const std::size_t m : {0u, 1u}) {
            votes[m].assign(kMostHandles + 1, 0);
            for (Index h = 0; h <= kMostHandles; ++h) {
                votes[m][to_size(h)] =
                    to_index(std::ranges::count(models_[m].scales, 2 * h, &LoopClasses::rank));
                if (votes[m][to_size(h)] > 0 && shapes_[m].genus == h)
                    votes[m][to_size(h)] += kKnown;
            }
            likeliest[m] = shapes_[m].genus.value_or(
                to_index(std::ranges::max_element(votes[m]) - votes[m].begin()));
        }
        Index best = -1, most = 0;
        for (Index h = 0; h <= kMostHandles; ++h) {
            const Index sum = votes[0][to_size(h)] + votes[1][to_size(h)];
            if (votes[0][to_size(h)] == 0 || votes[1][to_size(h)] == 0 || sum <= most) continue;
            best = h;
            most = sum;
        }
        if (best < 0)
            throw TopologyError(
                shapes_[0].surface.name + " and " + shapes_[1].surface.name,
                "closed surfaces with the same number of handles, at most " +
                    std::to_string(kMostHandles) + ", each thick enough to be found",
                "genus " + std::to_string(likeliest[0]) + " and " + std::to_string(likeliest[1]),
                "Close holes, sample more densely, or use method auto.");
        for (const auto& surface : surfaces_) surface->take_rank(2 * best);
    }

    /// Which handles a candidate goes round once it is closed along the network.
    std::array<std::uint32_t, 2> closed_bits(const Candidate& c) const {
        std::array<std::uint32_t, 2> bits;
        for (const std::size_t m : {0u, 1u})
            bits[m] = c.paths[m].bits ^ potentials_[m][to_size(c.from.corner)] ^
                      potentials_[m][to_size(c.to.corner)];
        return bits;
    }

    /// Pairs of paths between two sectors, with their costs: low where both are short, and alike
    /// once the shapes are laid over each other, so that they pass a limb or handle on the same
    /// side.
    void weigh(const Sector& from, const Sector& to,
               const std::array<std::vector<CoarsePath>, 2>& paths, const Accept& accept,
               std::vector<Candidate>& found) const {
        std::array<std::vector<std::vector<Index>>, 2> samples;
        for (const std::size_t m : {0u, 1u})
            for (const CoarsePath& path : paths[m])
                samples[m].push_back(sampled(surfaces_[m]->coarse().positions, path));
        const double unit = surfaces_[1]->coarse().unit;
        for (std::size_t s = 0; s < paths[0].size(); ++s)
            for (std::size_t t = 0; t < paths[1].size(); ++t) {
                double apart = 0.0, other_reach = 0.0;
                for (std::size_t k = 0; k < samples[0][s].size(); ++k) {
                    const Index a = samples[0][s][k], b = samples[1][t][k];
                    apart += (laid_over_[0].row(a) - laid_over_[1].row(b)).norm() / unit;
                    other_reach += (reach_[0].row(a) - reach_[1].row(b)).norm() /
                                   std::sqrt(static_cast<double>(corners_));
                }
                apart = (weights_.place * apart + weights_.reach * other_reach) /
                        static_cast<double>(samples[0][s].size());
                Candidate candidate{from, to, {paths[0][s], paths[1][t]}, 0.0};
                candidate.cost = paths[0][s].length + paths[1][t].length + apart;
                if (accept(candidate)) found.push_back(std::move(candidate));
            }
    }

    /// Adds the cheapest candidate that can be drawn; false where there is none.
    bool add_best(std::vector<Candidate>& candidates) {
        constexpr std::size_t kMostTries = 40;
        std::ranges::stable_sort(candidates, {}, &Candidate::cost);
        for (std::size_t k = 0; k < std::min(kMostTries, candidates.size()); ++k)
            if (add(candidates[k])) return true;
        return false;
    }

    bool add(const Candidate& c) {
        std::array<SurfaceCurve, 2> drawn;
        for (const std::size_t m : {0u, 1u}) {
            auto curve = surfaces_[m]->traced(c.paths[m], c.from, c.to, progress_);
            if (!curve) return false;
            drawn[m] = std::move(*curve);
        }
        const auto bits = closed_bits(c);
        const Index a = group_[to_size(c.from.corner)], b = group_[to_size(c.to.corner)];
        for (const std::size_t m : {0u, 1u}) {
            if (a == b) spans_[m].add(bits[m]);
            for (Index k = 0; a != b && k < corners_; ++k)
                if (group_[to_size(k)] == b) potentials_[m][to_size(k)] ^= bits[m];
            surfaces_[m]->add(drawn[m], c.from, c.to);
        }
        if (a != b) std::ranges::replace(group_, std::max(a, b), std::min(a, b));
        curves_.push_back({c.from.corner, c.to.corner, std::move(drawn)});
        return true;
    }

    /// All candidates from some corner to later ones.
    std::vector<Candidate> candidates(const std::function<bool(Index, Index)>& wanted,
                                      const Accept& accept) {
        std::vector<Candidate> found;
        for (Index a = 0; a < corners_; ++a) {
            std::vector<Sector> goals;
            for (Index b = a + 1; b < corners_; ++b)
                if (wanted(a, b))
                    for (const Sector& sector : surfaces_[0]->sectors(b)) goals.push_back(sector);
            if (goals.empty()) continue;
            for (const Sector& from : surfaces_[0]->sectors(a)) {
                progress_.throw_if_cancelled();
                const auto s = surfaces_[0]->paths(from, goals, true);
                const auto t = surfaces_[1]->paths(from, goals, true);
                for (std::size_t g = 0; g < goals.size(); ++g)
                    weigh(from, goals[g], {s[g], t[g]}, accept, found);
            }
        }
        return found;
    }

    /// A part of a loop that was given.
    void lead(Index a, Index b, std::size_t loop) {
        const Index from = std::min(a, b), to = std::max(a, b);
        if (std::ranges::any_of(curves_, [&](const NetworkCurve& c) {
                return std::min(c.from, c.to) == from && std::max(c.from, c.to) == to;
            }))
            return;
        auto found = candidates([&](Index p, Index q) { return p == from && q == to; },
                                [](const Candidate&) { return true; });
        if (add_best(found)) return;
        throw_no_curve(from, to, "loop " + std::to_string(loop + 1));
    }

    [[noreturn]] void throw_no_curve(Index a, Index b, const std::string& subject) const {
        std::array<bool, 2> open{};
        for (const std::size_t m : {0u, 1u}) {
            const auto goals = surfaces_[m]->sectors(b);
            for (const Sector& from : surfaces_[m]->sectors(a))
                for (const auto& paths : surfaces_[m]->paths(from, goals, true))
                    open[m] = open[m] || !paths.empty();
        }
        const std::string curve = "from " + quoted(a) + " to " + quoted(b);
        if (open[0] && open[1])
            throw FeatureError(
                subject, "curves that meet in the same order around each feature on both models",
                "a curve " + curve + " that leaves between different curves on " +
                    shapes_[0].surface.name + " than on " + shapes_[1].surface.name,
                "Check that no loop is reversed, that left and right are not swapped on one model, "
                "and that both models have the same features in the same places.");
        const std::string where = open[0] ? shapes_[1].surface.name
                                  : open[1]
                                      ? shapes_[0].surface.name
                                      : shapes_[0].surface.name + " and " + shapes_[1].surface.name;
        throw FeatureError(
            subject, "curves that don't cross",
            "a curve " + curve + " that crosses " + curves_in_words() + ", on " + where,
            "Let loops meet only at shared features, or leave one out.");
    }

    std::string curves_in_words() const {
        constexpr std::size_t kMost = 6;
        std::string words;
        for (std::size_t k = 0; k < std::min(kMost, curves_.size()); ++k)
            words += (words.empty() ? "" : ", ") + quoted(curves_[k].from) + " to " +
                     quoted(curves_[k].to);
        return "one of the curves " + words + (curves_.size() > kMost ? ", …" : "");
    }

    void join_groups() {
        auto found =
            candidates([&](Index a, Index b) { return group_[to_size(a)] != group_[to_size(b)]; },
                       [](const Candidate&) { return true; });
        if (add_best(found)) return;
        for (Index b = 1; b < corners_; ++b)
            if (group_[to_size(b)] != group_[0]) throw_no_curve(0, b, "features");
    }

    void open_handle() {
        auto found = candidates([](Index, Index) { return true; },
                                [&](const Candidate& c) {
                                    const auto bits = closed_bits(c);
                                    return !spans_[0].holds(bits[0]) && !spans_[1].holds(bits[1]);
                                });
        if (add_best(found)) return;
        throw FeatureError(
            "features", "features around every handle, arranged alike on both models",
            std::to_string(corners_) +
                " features, and no curves between them that open the next handle on both",
            "Mark three or more places around each handle and three through its hole, or use "
            "method auto.");
    }

    std::vector<std::vector<Dart>> faces() const {
        std::vector<Dart> next(2 * curves_.size());
        for (Index k = 0; k < corners_; ++k) {
            const auto around = surfaces_[0]->darts(k);
            for (std::size_t i = 0; i < around.size(); ++i)
                next[to_size(twin(around[(i + 1) % around.size()]))] = around[i];
        }
        std::vector<std::vector<Dart>> result;
        std::vector<char> seen(next.size(), 0);
        for (std::size_t d = 0; d < next.size(); ++d) {
            if (seen[d]) continue;
            result.emplace_back();
            for (Dart dart = static_cast<Dart>(d); !seen[to_size(dart)];
                 dart = next[to_size(dart)]) {
                seen[to_size(dart)] = 1;
                result.back().push_back(dart);
            }
        }
        return result;
    }

    Index tail(Dart dart) const {
        const NetworkCurve& curve = curves_[to_size(dart / 2)];
        return dart % 2 == 0 ? curve.from : curve.to;
    }

    /// How often a walk comes to a corner that it has met before.
    Index repeats(std::span<const Index> walk) const {
        std::vector<Index> sorted(walk.begin(), walk.end());
        std::ranges::sort(sorted);
        const auto distinct = std::ranges::unique(sorted).begin() - sorted.begin();
        return to_index(walk.size()) - to_index(distinct);
    }

    /// One more curve through a patch that meets itself.
    bool part_patch() {
        std::vector<Candidate> found;
        for (const auto& face : faces()) {
            std::vector<Index> walk;
            for (const Dart dart : face) walk.push_back(tail(dart));
            const Index now = repeats(walk);
            if (now == 0) continue;
            const std::size_t size = walk.size();
            for (std::size_t i = 0; i < size; ++i) {
                std::vector<Sector> goals;
                for (std::size_t j = i + 2; j < size; ++j) {
                    if (walk[i] == walk[j] || (i == 0 && j + 1 == size)) continue;
                    std::vector<Index> one(walk.begin() + Index(i), walk.begin() + Index(j) + 1);
                    std::vector<Index> other(walk.begin() + Index(j), walk.end());
                    other.insert(other.end(), walk.begin(), walk.begin() + Index(i) + 1);
                    if (repeats(one) + repeats(other) < now) goals.push_back({walk[j], face[j]});
                }
                if (goals.empty()) continue;
                progress_.throw_if_cancelled();
                const Sector from{walk[i], face[i]};
                const auto s = surfaces_[0]->paths(from, goals, false);
                const auto t = surfaces_[1]->paths(from, goals, false);
                for (std::size_t g = 0; g < goals.size(); ++g)
                    weigh(
                        from, goals[g], {s[g], t[g]}, [](const Candidate&) { return true; }, found);
            }
        }
        return add_best(found);
    }

    void check() const {
        const auto patches = faces();
        const Index euler = corners_ - to_index(curves_.size()) + to_index(patches.size());
        bool meets_itself = euler != 2 - rank();
        for (const auto& patch : patches)
            for (const Dart dart : patch)
                meets_itself = meets_itself || std::ranges::find(patch, twin(dart)) != patch.end();
        if (meets_itself)
            throw FeatureError(
                "features", "enough features for curves that cut both models into disks",
                std::to_string(corners_) + " features and " + std::to_string(curves_.size()) +
                    " curves that leave a patch touching itself",
                "Mark more features, around handles and on limbs.");
    }

    const std::array<NetworkShape, 2>& shapes_;
    const std::array<CoarseModel, 2>& models_;
    std::span<const std::string> names_;
    Weights weights_;
    Progress& progress_;
    Index most_extremities_;
    Index corners_;
    std::array<std::unique_ptr<NetworkSurface>, 2> surfaces_;
    std::array<Positions, 2> laid_over_;    ///< coarse points, the source's as the target lies
    std::array<Eigen::MatrixXd, 2> reach_;  ///< distances of coarse points from all corners, √area
    std::vector<NetworkCurve> curves_;
    std::vector<Index> group_;  ///< of each corner: the lowest corner it is joined with
    std::array<std::vector<std::uint32_t>, 2> potentials_;
    std::array<Span, 2> spans_;
};

/// Gives islands to the patch around them, and every point except the features to some patch.
void clean_up(std::vector<Index>& labels, const Neighborhoods& nearest,
              std::span<const Index> features, Index patches) {
    const ConnectedComponents parts = connected_components(filtered(
        nearest, [&](Index i, Index j) { return labels[to_size(i)] == labels[to_size(j)]; }));
    std::vector<char> is_feature(labels.size(), 0);
    for (const Index row : features) is_feature[to_size(row)] = 1;
    std::vector<Index> largest(to_size(patches), -1);
    for (std::size_t i = 0; i < labels.size(); ++i) {
        if (labels[i] < 0) continue;
        Index& best = largest[to_size(labels[i])];
        const Index mine = parts.label[i];
        if (best < 0 || parts.sizes[to_size(mine)] > parts.sizes[to_size(best)]) best = mine;
    }
    constexpr Index kIsland = 20;  // times as small as the patch itself
    std::vector<char> open(labels.size(), 0);
    for (std::size_t i = 0; i < labels.size(); ++i) {
        if (is_feature[i]) continue;
        const Index mine = parts.label[i];
        open[i] = labels[i] < 0 || (mine != largest[to_size(labels[i])] &&
                                    parts.sizes[to_size(mine)] * kIsland <
                                        parts.sizes[to_size(largest[to_size(labels[i])])]);
    }
    // From the shore inward, each point takes the label of most of its neighbors.
    for (bool changed = true; changed;) {
        changed = false;
        std::vector<std::pair<Index, Index>> moves;
        for (Index i = 0; i < nearest.size(); ++i) {
            if (!open[to_size(i)]) continue;
            std::map<Index, Index> votes;
            for (const Index j : nearest[i])
                if (!open[to_size(j)] && !is_feature[to_size(j)]) ++votes[labels[to_size(j)]];
            if (votes.empty()) continue;
            moves.emplace_back(i, std::ranges::max_element(votes, {}, [](const auto& v) {
                                      return v.second;
                                  })->first);
        }
        for (const auto& [i, label] : moves) {
            labels[to_size(i)] = label;
            open[to_size(i)] = 0;
            changed = true;
        }
    }
    // A component of its own, without neighbors outside.
    for (std::size_t i = 0; i < labels.size(); ++i)
        if (labels[i] < 0 && !is_feature[i]) labels[i] = 0;
}

}  // namespace

Network trace_network(const std::array<NetworkShape, 2>& shapes, std::span<const std::string> names,
                      std::span<const std::vector<Index>> loops,
                      const DecompositionOptions& options, Progress& progress) {
    if (names.size() < 3)
        throw FeatureError("features", "at least 3 for a network of curves",
                           std::to_string(names.size()),
                           "Mark places around each handle and at the tips of limbs.");
    // Shortest first can go astray: of three weightings, take the one with the smallest detour.
    constexpr std::array<Weights, 3> kWeights{{{3.0, 0.0}, {0.0, 6.0}, {0.0, 12.0}}};
    constexpr double kStraight = 0.03;
    const std::array<CoarseModel, 2> models{CoarseModel(shapes[0], options, progress),
                                            CoarseModel(shapes[1], options, progress)};
    std::unique_ptr<Tracer> best;
    std::exception_ptr failure;
    for (const Weights& weights : kWeights) {
        auto tracer = std::make_unique<Tracer>(shapes, models, names, weights, options, progress);
        try {
            tracer->run(loops);
        } catch (const FeatureError&) {
            if (!failure) failure = std::current_exception();
            continue;
        }
        if (!best || tracer->detour() < best->detour()) best = std::move(tracer);
        if (best->detour() < kStraight) break;
    }
    if (!best) std::rethrow_exception(failure);
    progress.report(0.8);
    Network result = best->finished();
    for (const std::size_t m : {0u, 1u})
        clean_up(result.labels[m], shapes[m].surface.nearest, shapes[m].features,
                 to_index(result.patches.size()));
    return result;
}

}  // namespace pointmorph
