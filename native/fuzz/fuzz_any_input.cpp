// What libFuzzer calls; see native/tests/long_runs/fuzzing.py.
#include <cstddef>
#include <cstdint>

#include "fuzzing/any_input.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    pointmorph::fuzzing::try_bytes({data, size});  // a broken promise ends the run
    return 0;
}

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

/// What an input is about stays: cheap and dear questions are tried apart.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned) {
    if (size < 2 || most < 2) return LLVMFuzzerMutate(data, size, most);
    return 1 + LLVMFuzzerMutate(data + 1, size - 1, most - 1);
}
