// Tests that needn't run where sanitizers watch every access.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>

/// Whether sanitizers watch: where a test may try fewer combinations of what it tries.
inline bool is_watched() {
    return std::getenv("POINTMORPH_WATCHED") != nullptr;
}

/// First in a test that repeats, on other shapes or with other options, code that another test runs
/// as well: watched, it would take ten times as long and find nothing that the other doesn't.
/// build_addon.py sets the variable; without it, everything runs.
#define SKIP_WHERE_WATCHED() \
    if (is_watched()) GTEST_SKIP() << "other tests run the same code"
