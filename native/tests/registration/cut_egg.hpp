// An egg that lacks one of its ends, for the tests of shapes that end where others go on.
#pragma once

#include <vector>

#include "pointmorph/cloud/subset.hpp"
#include "registration/eggs.hpp"

namespace pointmorph {

struct CutEgg {
    Eggs eggs;
    CoarseShape whole = eggs.coarse_target;
    CoarseShape part;     ///< without what lies beyond `kCut`
    CoarseShape endless;  ///< the part, without its ends

    static constexpr double kCut = 0.2, kBorder = 0.03;

    CutEgg() {
        std::vector<Index> kept;
        for (Index i = 0; i < to_index(eggs.source.positions.rows()); ++i)
            if (eggs.source.positions(i, 0) < kCut) kept.push_back(i);
        const Positions positions = gather(eggs.source.positions, kept);
        Progress progress;
        part = coarse_shape(KdTree<3>(positions), gather(eggs.source.normals, kept), {},
                            {600, {40, 150}, {}}, progress);
        endless = part;
        for (Index i = 0; i < part.size(); ++i)
            part.ends.push_back(part.positions(i, 0) > kCut - kBorder);
    }
};

}  // namespace pointmorph
