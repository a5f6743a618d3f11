#include "pointmorph/morph/report.hpp"

#include <algorithm>

namespace pointmorph {

void ParameterizationReport::add(const ParameterizationReport& patch) {
    unknowns += patch.unknowns;
    iterations = std::max(iterations, patch.iterations);
    relative_residual = std::max(relative_residual, patch.relative_residual);
    solve_seconds += patch.solve_seconds;
}

}  // namespace pointmorph
