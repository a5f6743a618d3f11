#include "pointmorph/cloud/neighborhoods.hpp"

#include <algorithm>
#include <vector>

#include "bindings.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"

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

    module.def(
        "nearest_rows",
        [](const py::array& rows, const py::array& places, Index k) {
            const auto positions = from_numpy<Positions>(rows);
            const auto queries = from_numpy<Positions>(places);
            using Rows = Eigen::Matrix<Index, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
            const Index width = std::clamp<Index>(k, 0, static_cast<Index>(positions.rows()));
            Rows result(queries.rows(), width);
            {
                const auto progress = make_progress(py::none());
                const py::gil_scoped_release release;
                const KdTree<3> tree(positions);
                const auto count = static_cast<Index>(queries.rows());
                parallel_for(count, *progress, [&](Index begin, Index end) {
                    const auto size = to_size(width);
                    std::vector<double> squared(size);
                    for (Index i = begin; i < end; ++i)
                        tree.nearest(queries.row(i).data(), {result.row(i).data(), size}, squared);
                });
            }
            return to_numpy(std::move(result));
        },
        "(Q, k) int32: for each of the `places`, (Q, 3), the rows of the k nearest of the\n"
        "`positions`, (N, 3), ascending by distance; of all where there are fewer.",
        py::arg("positions"), py::arg("places"), py::arg("k"));
}

}  // namespace pointmorph::bindings
