// Which points resampling inserts, and when they appear and vanish. Internal.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "frames/gap_triangles.hpp"
#include "frames/missing_points.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/frames/resampling.hpp"

namespace pointmorph {

/// Steps through the morph, and decides which points appear and vanish at each step.
class Lifetimes {
public:
    /// Keeps references to all.
    Lifetimes(const Resampling& resampling, std::span<const IndexPair> pairs,
              const EndSamples& source, const EndSamples& target, Progress& progress);
    Lifetimes(Lifetimes&&) = delete;  // what finds missing points refers to those chosen

    /// All times, from source to target.
    void pass(const Resampling::FrameAt& frame_at, Progress& progress);

    std::vector<InsertedPoint> points() const;  ///< all that ever live
    const std::vector<HiddenPair>& hidden() const { return hidden_; }

private:
    void step(int key, const Resampling::FrameAt& frame_at, Progress& progress);
    std::vector<char> crowded(const FrameSample& sample, Progress& progress) const;
    void choose(const FrameSample& sample, std::span<const MissingPoints::Place> places,
                std::vector<Index>& living, Progress& progress);
    void hide_crowded(const FrameSample& sample, int key, Progress& progress);
    void show_or_hide(Index pair, bool hide, int key);

    const Resampling& resampling_;
    std::vector<MissingPoints::Place> chosen_;  ///< by id
    std::vector<int> first_key_, last_key_;     ///< by id
    std::vector<Index> alive_;                  ///< ids, ascending
    std::vector<int> hidden_since_;             ///< by pair, the key; 0: shown
    std::vector<HiddenPair> hidden_;
    MovingTree tree_;                       ///< of pairs, then of points that are alive
    std::optional<MissingPoints> missing_;  ///< none where no points are wanted
};

}  // namespace pointmorph
