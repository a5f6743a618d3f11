// How good a Morph says that its map is.
#include "base/unused_memory.hpp"
#include "morph/mesh_side.hpp"
#include "morph/morph_caches.hpp"
#include "morph/wrapped_mesh.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/morph/morph.hpp"

namespace pointmorph {

/// The caller has set the number of threads.
const OrderedNeighbors& Morph::neighbors(bool of_source, Progress& progress) const {
    const std::scoped_lock lock(caches_->neighbors_mutex);
    auto& neighbors = of_source ? caches_->source_neighbors : caches_->target_neighbors;
    if (!neighbors)
        neighbors = ordered_neighbors((of_source ? source_ : target_).positions,
                                      kNeighborsToMeasure, progress);
    return *neighbors;
}

std::vector<Cracks> Morph::cracks(std::span<const double> times, Progress& progress) const {
    const ThreadCount threads(options_.threads);
    progress.enter("cracks");
    auto result =
        find_cracks({source_.positions, &neighbors(true, progress)},
                    {target_.positions, &neighbors(false, progress)}, pairs_, times, progress);
    progress.finish();
    return result;
}

const Quality& Morph::quality(Progress& progress) const {
    const std::scoped_lock lock(caches_->quality_mutex);
    auto& quality = caches_->quality;
    if (!quality) {
        Positions own_source, own_target;
        const Positions& source_images = images_of(true, own_source, progress);
        const Positions& target_images = images_of(false, own_target, progress);
        const ThreadCount threads(options_.threads);
        progress.enter("quality");
        give_back_unused_memory(source_.size() + target_.size());
        quality =
            measure_quality({source_, target_, source_images, target_images, pairs_,
                             &neighbors(true, progress), &neighbors(false, progress),
                             report_.diagnostics.source_ends, report_.diagnostics.target_ends},
                            features_, progress);
        progress.finish();
    }
    return *quality;
}

const LocalConfidence& Morph::local_confidence(Progress& progress) const {
    if (report_.method.empty())
        throw CloudError(source_.name, "a newly computed map",
                         "a stored one, without its alternatives", "Morph again.");
    const Quality& quality = this->quality(progress);
    const std::scoped_lock lock(caches_->local_confidence_mutex);
    auto& confidence = caches_->local_confidence;
    if (!confidence) {
        Positions own_source, own_target;
        const Positions& source_images = images_of(true, own_source, progress);
        const Positions& target_images = images_of(false, own_target, progress);
        const ThreadCount threads(options_.threads);
        progress.enter("confidence");
        const TwoWayMap map{source_,
                            target_,
                            source_images,
                            target_images,
                            pairs_,
                            &neighbors(true, progress),
                            &neighbors(false, progress)};
        confidence =
            measure_local_confidence({map, quality, report_.diagnostics}, features_, progress);
        progress.finish();
    }
    return *confidence;
}

const MeshQuality& Morph::mesh_quality(Progress& progress) const {
    const std::scoped_lock lock(caches_->mesh_quality_mutex);
    auto& quality = caches_->mesh_quality;
    if (!quality) {
        const WrappedSides sides = wrapped_sides(true);
        const Positions ends = wrapped(1.0, progress);
        const ThreadCount threads(options_.threads);
        progress.enter("mesh quality");
        quality = measure_mesh_quality(
            {source_, sides.source.mesh.mesh(), ends, sides.source.leaves_missing},
            {target_, sides.target.mesh ? &sides.target.mesh->mesh() : nullptr}, features_,
            progress);
        progress.finish();
    }
    return *quality;
}

}  // namespace pointmorph
