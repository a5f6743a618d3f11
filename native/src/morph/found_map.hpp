// A map that was found by a LiveMorph, on its way to a Morph. Not for callers of the library.
#pragma once

#include <chrono>
#include <memory>

#include "morph/mesh_side.hpp"
#include "morph/routes.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/morph/morph_input.hpp"
#include "pointmorph/registration/refinement.hpp"

namespace pointmorph {

struct FoundMap {
    MorphInput input;      ///< rows are given rows
    Cloud source, target;  ///< on which it was found: samples of the faces, or the clouds
    Correspondence correspondence;
    std::shared_ptr<const MeshSides> sides;  ///< null where both clouds are bare
    RefinementStart offsets;  ///< of vertices from where samples carry them; see Morph::carry()
    RefinementStart images;   ///< the maps themselves, where they are known to the bit; or none
    std::chrono::steady_clock::time_point began;
};

}  // namespace pointmorph
