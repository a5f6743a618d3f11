// Open borders of a mesh that slide along those of the surface it is wrapped onto. Not for callers
// of the library.
#pragma once

#include <memory>
#include <vector>

#include "mesh/block_system.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph {

class WrapBorders {
public:
    /// A border of the mesh goes with the border of the target (`borders`, closed polygons in the
    /// lengths of `start`) that lies nearest to where it starts, if most of it lies near.
    WrapBorders(const Mesh& mesh, const Positions& start, const std::vector<Positions>& borders,
                Progress& progress);

    /// Draws places on borders to the lines that they go with, not along them, over `length`.
    void draw(const Positions& x, double length, std::vector<SymmetricBlock>& blocks,
              Positions& right) const;

    /// Puts places on borders onto their lines.
    void land(Positions& x) const;

private:
    struct Line;
    /// The line that most of a border's places lie near to, or null.
    const Line* nearest_line(const Positions& places) const;

    struct Matched {
        std::vector<Index> places;  ///< in order
        const Line* line;
    };

    std::vector<std::shared_ptr<const Line>> lines_;
    std::vector<Matched> matched_;
};

}  // namespace pointmorph
