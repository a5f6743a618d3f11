#include "bindings.hpp"

PYBIND11_MODULE(_pointmorph, module) {
    using namespace pointmorph::bindings;
    module.doc() = "The native library of the package pointmorph.";
    module.attr("__version__") = POINTMORPH_VERSION;
    bind_errors(module);
    bind_options(module);
    bind_neighborhoods(module);
    bind_sampling(module);
    bind_morph(module);
    bind_decomposition(module);
    bind_motion(module);
    bind_stored_frames(module);
}
