#include "frames/lifetimes.hpp"

#include <algorithm>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

/// Times at which points come and go, evenly over the morph.
constexpr int kKeys = 16;

/// Of loops on one thread, between two reports.
constexpr Index kRowsPerReport = 256;

/// Fractions of a step at which open triangles are known, crowded pairs hidden, empty places found.
constexpr double kOpened = 0.1, kHidden = 0.3, kFound = 0.9;

/// In spacings: a point isn't needed any more once others have come closer.
constexpr double kCrowded = 0.4;

double time_of(int key) {
    return static_cast<double>(key) / kKeys;
}

/// Complete from the first key to the last one.
Lifetime lifetime(int first, int last) {
    return {time_of(first - 1), time_of(first), time_of(last), time_of(last + 1)};
}

}  // namespace

Lifetimes::Lifetimes(const Resampling& resampling, std::span<const IndexPair> pairs,
                     const EndSamples& source, const EndSamples& target, Progress& progress)
    : resampling_(resampling), hidden_since_(pairs.size()), tree_(to_index(pairs.size())) {
    if (resampling.options().omega > 0.0)
        missing_.emplace(resampling, pairs, source, target, chosen_, progress);
}

void Lifetimes::pass(const Resampling::FrameAt& frame_at, Progress& progress) {
    for (int key = 1; key < kKeys; ++key) {
        const Progress::Part part(progress, static_cast<double>(key - 1) / (kKeys - 1),
                                  static_cast<double>(key) / (kKeys - 1));
        step(key, frame_at, progress);
    }
}

std::vector<InsertedPoint> Lifetimes::points() const {
    std::vector<InsertedPoint> result;
    result.reserve(chosen_.size());
    for (std::size_t id = 0; id < chosen_.size(); ++id) {
        result.push_back(chosen_[id].point);
        result.back().lifetime = lifetime(first_key_[id], last_key_[id]);
    }
    return result;
}

void Lifetimes::step(int key, const Resampling::FrameAt& frame_at, Progress& progress) {
    std::vector<InsertedPoint> points;
    for (const Index id : alive_) points.push_back(chosen_[to_size(id)].point);
    FrameSample sample(time_of(key), frame_at(time_of(key)), resampling_, std::move(points), alive_,
                       chosen_.size());
    std::vector<OpenTriangle> open;
    {
        const Progress::Part part(progress, 0.0, kOpened);
        if (missing_) {
            Progress silent;
            open = missing_->open_triangles(
                sample, [&] { tree_.move(sample.positions, silent); }, progress);
        } else {
            tree_.move(sample.positions, progress);
        }
        sample.tree = &tree_;
    }
    if (resampling_.options().crowding) {
        const Progress::Part part(progress, kOpened, kHidden);
        hide_crowded(sample, key, progress);
    }
    if (!missing_) return;

    const std::vector<char> dead = crowded(sample, progress);
    const auto places = [&] {
        const Progress::Part part(progress, kHidden, kFound);
        return (*missing_)(sample, open, dead, progress);
    }();
    std::vector<Index> living;
    for (std::size_t a = 0; a < alive_.size(); ++a)
        if (!dead[a]) living.push_back(alive_[a]);
    const Progress::Part part(progress, kFound, 1.0);
    choose(sample, places, living, progress);
    first_key_.resize(chosen_.size(), key);
    last_key_.resize(chosen_.size());
    for (const Index id : living) last_key_[to_size(id)] = key;
    alive_ = std::move(living);
}

/// Points that others have come close to.
std::vector<char> Lifetimes::crowded(const FrameSample& sample, Progress& progress) const {
    const auto count = to_index(sample.ids.size());
    std::vector<char> dead(to_size(count));
    std::vector<std::vector<Index>> earlier(dead.size());  // that are as close
    const auto look_around = [&](Index begin, Index end) {
        NeighborSearch find;
        for (Index a = begin; a < end; ++a) {
            const Index row = sample.pairs + a;
            const auto look_at = [&](Index other) {
                if (other < sample.pairs)
                    dead[to_size(a)] = 1;
                else if (other < row)
                    earlier[to_size(a)].push_back(other - sample.pairs);
                return false;
            };
            find.nearest(sample, sample.positions.row(row).transpose(),
                         sample.normals.row(row).transpose(),
                         kCrowded * sample.spacing_at(sample.points[to_size(a)]), look_at);
        }
    };
    constexpr Index kChunk = 64;
    parallel_for(count, progress, look_around, kHidden, kHidden, kChunk);
    const auto lives = [&](Index other) { return !dead[to_size(other)]; };
    for (std::size_t a = 0; a < dead.size(); ++a)
        if (!dead[a]) dead[a] = std::ranges::any_of(earlier[a], lives);
    return dead;
}

/// First come, first served.
void Lifetimes::choose(const FrameSample& sample, std::span<const MissingPoints::Place> places,
                       std::vector<Index>& living, Progress& progress) {
    if (places.empty()) return;
    const auto count = to_index(places.size());
    Positions positions(count, 3);
    Normals normals(count, 3);
    for (Index i = 0; i < count; ++i) {
        const InsertedPoint& point = places[to_size(i)].point;
        positions.row(i) = blend(sample.positions, point).transpose();
        normals.row(i) = gap_triangle_normal(sample.positions, sample.normals, point).transpose();
    }
    const KdTree<3> tree(positions);
    std::vector<char> covered(to_size(count));
    std::vector<std::pair<Index, double>> near;
    for (Index i = 0; i < count; ++i) {
        if (i % kRowsPerReport == 0) progress.report(static_cast<double>(i) / count);
        if (covered[to_size(i)]) continue;
        living.push_back(to_index(chosen_.size()));
        chosen_.push_back(places[to_size(i)]);
        tree.within(positions.row(i).data(), kEmpty * sample.spacing_at(places[to_size(i)].point),
                    near);
        for (const auto& [other, squared] : near)
            if (normals.row(other).dot(normals.row(i)) > 0.0) covered[to_size(other)] = 1;
    }
}

/// Hides pairs, where points crowd, that have another one close by that stays.
void Lifetimes::hide_crowded(const FrameSample& sample, int key, Progress& progress) {
    const double area = resampling_.unit_area(sample.t) / (sample.unit.scale * sample.unit.scale);
    std::vector<char> is_crowded(to_size(sample.pairs));
    constexpr double kSearched = 0.7;  // share of the time
    const auto search = [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const double wanted =
                std::max(resampling_.wanted_density(i, 0.0), resampling_.wanted_density(i, 1.0));
            is_crowded[to_size(i)] =
                density(sample, i) * area > *resampling_.options().crowding * wanted;
        }
    };
    parallel_for(sample.pairs, progress, search, 0.0, kSearched);
    std::vector<char> stays(to_size(sample.pairs), 1);
    NeighborSearch find;
    // Pairs that are hidden already go first, so that they stay hidden.
    for (const bool was_hidden : {true, false})
        for (Index i = 0; i < sample.pairs; ++i) {
            if (i % kRowsPerReport == 0) progress.report(was_hidden ? kSearched : 1.0);
            if ((hidden_since_[to_size(i)] > 0) != was_hidden || !is_crowded[to_size(i)]) continue;
            const auto counts = [&](Index other) {
                return other != i && other < sample.pairs && stays[to_size(other)];
            };
            const double radius = kCrowded * resampling_.spacing(i, sample.t) / sample.unit.scale;
            stays[to_size(i)] = find.nearest(sample, sample.positions.row(i).transpose(),
                                             sample.normals.row(i).transpose(), radius, counts) < 0;
        }
    for (Index i = 0; i < sample.pairs; ++i) show_or_hide(i, !stays[to_size(i)], key);
}

void Lifetimes::show_or_hide(Index pair, bool hide, int key) {
    int& since = hidden_since_[to_size(pair)];
    if (hide && since == 0) since = key;
    const bool ends = !hide || key == kKeys - 1;
    if (since == 0 || !ends) return;
    hidden_.push_back({pair, lifetime(since, hide ? key : key - 1)});
    since = 0;
}

}  // namespace pointmorph
