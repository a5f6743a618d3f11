// A morph that follows its features while they change.
#pragma once

#include <memory>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/morph/morph.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/morph/morph_options.hpp"
#include "pointmorph/surface/features.hpp"

namespace pointmorph {

/// Keeps what a map needs to be bent to changed features in a moment: prepared shapes, coarse
/// shapes, the registration. Apart from Morph, which stays as light as it is. Made once, const
/// afterward; queries may come from several threads. Updates start from the map that it was made
/// with, so that the same features give the same bits, whatever was asked for before.
class LiveMorph {
public:
    /// `input.start` is the map of `input.features`, from a morph with these options. Throws
    /// CloudError where it is missing, OptionError for method paper and for domains other than
    /// auto, whose maps come from a domain that can't be bent.
    LiveMorph(MorphInput input, const MorphOptions& options, Progress& progress);
    /// Throws the same.
    LiveMorph(const Morph& morph, Progress& progress);
    ~LiveMorph();
    LiveMorph(LiveMorph&&) noexcept;

    /// Where source points go, #source by 3, from the coarsest level of the registration alone: for
    /// display while a feature is dragged. Hard points meet exactly; the order of the features
    /// doesn't matter. For the features as they were, the map to the bit. Throws FeatureError.
    Positions source_to_target(const std::vector<Feature>& features, Progress& progress) const;

    /// The whole morph, its map about as good as one from scratch (docs/benchmarks.md). Where a
    /// feature lies farther than `trusted_distance` from where the map has it, or bending would
    /// tear, it is found from scratch, and MorphReport::update and a warning say why. For the
    /// features as they were, the maps are the same to the bit. How likely a map is to be right is
    /// not judged again: the diagnostics and the warnings about the shapes are those of the morph
    /// that this was made of; of maps that were given, the confidence is NaN. Throws what Morph
    /// throws.
    Morph updated(std::vector<Feature> features, Progress& progress) const;

private:
    /// `judged` is the morph that the map is of, or null.
    LiveMorph(MorphInput input, const MorphOptions& options, const Morph* judged,
              Progress& progress);

    struct State;
    std::unique_ptr<const State> state_;
};

}  // namespace pointmorph
