#include "pointmorph/neighborhoods.hpp"

#include "bindings.hpp"

namespace pointmorph::bindings {

void bind_neighborhoods(py::module_& module) {
    module.def(
        "nearest_neighbors",
        [](const py::array& rows, Index k) {
            const auto positions = from_numpy<Positions>(rows);
            using Rows = Eigen::Matrix<Index, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
            Rows result;
            {
                const auto progress = make_progress(py::none());
                const py::gil_scoped_release release;
                const auto near = nearest_neighbors(KdTree<3>(positions), k, *progress);
                const Index width = near.size() > 0 ? static_cast<Index>(near[0].size()) : 0;
                result = Eigen::Map<const Rows>(near.indices.data(), near.size(), width);
            }
            return to_numpy(std::move(result));
        },
        "(N, k) int32: the rows of the k nearest other points, ascending by distance; all others\n"
        "where there are fewer. `positions` is (N, 3).",
        py::arg("positions"), py::arg("k"));
}

}  // namespace pointmorph::bindings
