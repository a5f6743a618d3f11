// Shapes made of several: clouds joined into one, and two sheets that lie close to each other.
#pragma once

#include <vector>

#include "pointmorph/base/types.hpp"
#include "shapes.hpp"

namespace pointmorph::shapes {

/// The rows of all clouds, one after the other.
inline Positions together(const std::vector<Positions>& clouds) {
    Eigen::Index rows = 0;
    for (const Positions& cloud : clouds) rows += cloud.rows();
    Positions all(rows, 3);
    rows = 0;
    for (const Positions& cloud : clouds) {
        all.middleRows(rows, cloud.rows()) = cloud;
        rows += cloud.rows();
    }
    return all;
}

/// Both sides of a thin part: grid(side) facing up, and the same .001 below facing down.
struct TwoSheets {
    Positions top, positions;
    Normals normals;

    explicit TwoSheets(Index side) : top(grid(side)), positions(together({top, top})) {
        positions.bottomRows(top.rows()).col(2).array() -= 1e-3;
        normals = Normals::Zero(positions.rows(), 3);
        normals.col(2).head(top.rows()).setOnes();
        normals.col(2).tail(top.rows()).setConstant(-1.0);
    }
};

}  // namespace pointmorph::shapes
