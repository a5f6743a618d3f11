#include "pointmorph/morph/cut_preview.hpp"

#include <algorithm>

#include "bindings.hpp"

namespace pointmorph::bindings {

void bind_decomposition(py::module_& module) {
    module.def(
        "decompose",
        [](const py::dict& fields, const std::vector<Index>& loop,
           const std::vector<std::string>& names, const MorphOptions& options,
           const py::object& callback) {
            const Cloud cloud = cloud_of(fields);
            const auto progress = make_progress(callback);
            CutPreview cut;
            {
                const py::gil_scoped_release release;
                cut = preview_cut(cloud, loop, names, options, *progress);
            }
            py::array_t<std::int8_t> sides(static_cast<py::ssize_t>(cut.patches.size()));
            std::ranges::transform(cut.patches, sides.mutable_data(), [](Patch patch) {
                return static_cast<std::int8_t>(patch == Patch::kLeft    ? 1
                                                : patch == Patch::kRight ? -1
                                                                         : 0);
            });
            return py::make_tuple(to_numpy(std::move(cut.curve.points)),
                                  to_numpy(std::move(cut.curve.normals)), cut.corners, sides);
        },
        "Points and normals of the closed curve through the rows `loop`, their places in it, and "
        "for each point 1 on its left, -1 on its right, 0 on it.",
        py::arg("cloud"), py::arg("loop"), py::arg("names"), py::arg("options"),
        py::arg("progress"));
}

}  // namespace pointmorph::bindings
