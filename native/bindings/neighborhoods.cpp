#include "pointmorph/cloud/neighborhoods.hpp"

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "bindings.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/kd_tree.hpp"
#include "pointmorph/mesh/closest_point.hpp"

namespace pointmorph::bindings {

namespace {

/// Triangles with the tree that refers to them.
class ClosestPlaces {
public:
    ClosestPlaces(Positions positions, Triangles triangles, Progress& progress)
        : positions_(std::move(positions)),
          triangles_(std::move(triangles)),
          tree_(positions_, triangles_, progress) {}
    ClosestPlaces(const ClosestPlaces&) = delete;

    /// The triangle for each place, and the shares of its corners.
    std::pair<std::vector<Index>, Positions> of(const Positions& places, Progress& progress) const {
        progress.enter("closest places");
        const auto count = to_index(places.rows());
        std::pair<std::vector<Index>, Positions> found{to_size(count), Positions(count, 3)};
        parallel_for(count, progress, [&](Index begin, Index end) {
            Index beside = -1;
            for (Index i = begin; i < end; ++i) {
                constexpr double kAnywhere = std::numeric_limits<double>::infinity();
                const SurfacePoint point =
                    tree_.closest(places.row(i).transpose(), kAnywhere, beside);
                found.first[to_size(i)] = beside = point.triangle;
                found.second.row(i) = point.weights.transpose();
            }
        });
        progress.finish();
        return found;
    }

private:
    Positions positions_;
    Triangles triangles_;
    TriangleTree tree_;
};

void bind_closest_places(py::module_& module) {
    const auto make = [](const py::array& positions, const py::array& triangles) {
        auto p = from_numpy<Positions>(positions);
        auto corners = from_numpy<Triangles>(triangles);
        const py::gil_scoped_release release;
        Progress silent;
        return std::make_unique<ClosestPlaces>(std::move(p), std::move(corners), silent);
    };
    const auto of = [](const ClosestPlaces& self, const py::array& places,
                       const py::object& callback) {
        const auto queries = from_numpy<Positions>(places);
        const auto progress = make_progress(callback);
        std::pair<std::vector<Index>, Positions> found;
        {
            const py::gil_scoped_release release;
            found = self.of(queries, *progress);
        }
        const auto rows = static_cast<py::ssize_t>(found.first.size());
        py::array_t<std::int64_t> triangles(rows);
        std::copy(found.first.begin(), found.first.end(), triangles.mutable_data());
        return py::make_tuple(triangles, to_numpy(std::move(found.second)));
    };
    py::class_<ClosestPlaces>(module, "ClosestPlaces")
        .def(py::init(make), py::arg("positions"), py::arg("triangles"))
        .def("of", of,
             "(M,) int64 and (M, 3): the nearest triangle of each place, and the shares of its\n"
             "corners in the nearest point. Places are finite, triangles rows of the positions.",
             py::arg("places"), py::arg("progress"));
}

}  // namespace

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
                const Index width = near.size() > 0 ? to_index(near[0].size()) : 0;
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
            const Index width = std::clamp<Index>(k, 0, to_index(positions.rows()));
            Rows result(queries.rows(), width);
            {
                const auto progress = make_progress(py::none());
                const py::gil_scoped_release release;
                const KdTree<3> tree(positions);
                const auto count = to_index(queries.rows());
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

    bind_closest_places(module);
}

}  // namespace pointmorph::bindings
