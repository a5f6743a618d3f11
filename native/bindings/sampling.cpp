#include "pointmorph/cloud/sampling.hpp"

#include "bindings.hpp"
#include "pointmorph/mesh/mesh.hpp"

namespace pointmorph::bindings {

void bind_sampling(py::module_& module) {
    module.def(
        "blue_noise",
        [](const py::array& positions, const py::object& normals, Index count,
           const std::vector<Index>& keep, const py::object& callback) {
            const auto p = from_numpy<Positions>(positions);
            const auto n = from_numpy<Normals>(normals);
            const auto progress = make_progress(callback);
            std::vector<Index> rows;
            {
                const py::gil_scoped_release release;
                rows = blue_noise(p, n, count, keep, *progress);
            }
            py::array_t<std::int64_t> result(static_cast<py::ssize_t>(rows.size()));
            std::copy(rows.begin(), rows.end(), result.mutable_data());
            return result;
        },
        "(count,) int64: rows of evenly spread points of `positions` (N, 3), those to `keep` "
        "first.",
        py::arg("positions"), py::arg("normals"), py::arg("count"), py::arg("keep"),
        py::arg("progress"));
    module.def(
        "triangulate",
        [](const py::array& positions, const py::object& faces, const py::object& callback) {
            const auto p = from_numpy<Positions>(positions);
            const Polygons polygons = polygons_of(faces);
            const auto progress = make_progress(callback);
            Triangles rows;
            {
                const py::gil_scoped_release release;
                rows = triangle_corners(p, polygons, *progress);
            }
            return to_numpy(std::move(rows));
        },
        "(T, 3) int32: triangles that cover the polygons (offsets, corners), as rows of corners.",
        py::arg("positions"), py::arg("faces"), py::arg("progress"));
}

}  // namespace pointmorph::bindings
