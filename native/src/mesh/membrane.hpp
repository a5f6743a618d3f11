// Vertices that span what lies between others as a soap film does. Not for callers of the library.
#pragma once

#include <span>

#include "mesh/block_system.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Puts some vertices, ascending, where the weights balance between those around them. Those
/// that nothing holds, as all around them are among them, stay. The
/// same bits for any number of threads. Throws Cancelled where there are many.
void span_membrane(const Laplacian& laplacian, std::span<const Index> vertices, Positions& x,
                   Progress& progress);

}  // namespace pointmorph
