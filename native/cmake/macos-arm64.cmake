# macOS on ARM, from Linux: zig, as its package on PyPI has it, with Apple's headers and symbols.
set(CMAKE_SYSTEM_NAME Darwin)
set(CMAKE_SYSTEM_PROCESSOR arm64)
set(CMAKE_OSX_DEPLOYMENT_TARGET 11.0 CACHE STRING "")
set(CMAKE_OSX_SYSROOT "" CACHE STRING "")
find_program(POINTMORPH_ZIG zig REQUIRED
  HINTS ${CMAKE_CURRENT_LIST_DIR}/../../build/zig/ziglang NO_CMAKE_FIND_ROOT_PATH)
# Without the checks of undefined behaviour that zig adds by itself.
set(zig_options -target aarch64-macos.11.0 -fno-sanitize=undefined)
set(CMAKE_C_COMPILER ${POINTMORPH_ZIG} cc ${zig_options})
set(CMAKE_CXX_COMPILER ${POINTMORPH_ZIG} c++ ${zig_options})
# zig is all programs in one; these rules name which.
set(CMAKE_AR ${POINTMORPH_ZIG} CACHE FILEPATH "")
set(CMAKE_CXX_ARCHIVE_CREATE "<CMAKE_AR> ar qc <TARGET> <OBJECTS>")
set(CMAKE_CXX_ARCHIVE_FINISH "<CMAKE_AR> ranlib <TARGET>")
set(CMAKE_INSTALL_NAME_TOOL ${POINTMORPH_ZIG} CACHE FILEPATH "")
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
list(APPEND CMAKE_PREFIX_PATH /usr /usr/local)
