// The project's unit of time: what any method that looks at neighborhoods has to do, by nanoflann.
#pragma once

#include <cstdint>

/// Finds the nearest other points of every point on all threads. `positions`: `count` × 3, row by
/// row. `found`: `count` × `neighbors`, more than that many points being there.
extern "C" void pointmorph_unit(const double* positions, std::int32_t count, std::int32_t neighbors,
                                std::int32_t* found);
