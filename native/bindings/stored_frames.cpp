// What is stored of a morph for its frames: the plan of new points, and straight ways.
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "bindings.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/frames/path.hpp"
#include "pointmorph/frames/resampling.hpp"

namespace pointmorph::bindings {

namespace {

// Of new points and of hidden pairs: three rows or one, and when they are there.
using PlanRows = Eigen::Matrix<Index, Eigen::Dynamic, 3, Eigen::RowMajor>;
using PlanTimes = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
using AtBothEnds = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

AtBothEnds side_by_side(const Values& source, const Values& target) {
    AtBothEnds both(source.rows(), 2);
    both << source, target;
    return both;
}

template <class Scalar>
struct BorrowedPath {
    py::tuple arrays;  ///< that `path` refers to
    StraightPath<Scalar> path;
};

/// Straight ways between ends that numpy arrays hold, such as those of a file; nothing is copied.
template <class Scalar>
void define_straight_path(py::module_& module, const char* name) {
    using Rows = py::array_t<Scalar, py::array::c_style>;
    using Path = BorrowedPath<Scalar>;
    const auto make = [](const Rows& p, const Rows& n, const Rows& c, const Rows& r, const Rows& q,
                         const Rows& m, const Rows& d, const Rows& s) {
        const auto span = [](const Rows& rows) -> std::span<const Scalar> {
            return {rows.data(), to_size(rows.size())};
        };
        return std::make_unique<Path>(
            Path{py::make_tuple(p, n, c, r, q, m, d, s),
                 StraightPath<Scalar>({span(p), span(n), span(c), span(r)},
                                      {span(q), span(m), span(d), span(s)})});
    };
    py::class_<Path> straight(module, name);
    straight.def(py::init(make), py::arg("positions").noconvert(), py::arg("normals").noconvert(),
                 py::arg("colors").noconvert(), py::arg("radii").noconvert(),
                 py::arg("end_positions").noconvert(), py::arg("end_normals").noconvert(),
                 py::arg("end_colors").noconvert(), py::arg("end_radii").noconvert());
    straight.def(
        "frame",
        [](const Path& ways, double t, std::optional<int> threads, const Rows& positions,
           const Rows& normals, const Rows& colors, const Rows& radii) {
            const auto span = [](const Rows& rows) -> std::span<Scalar> {
                return {const_cast<Scalar*>(rows.data()), to_size(rows.size())};
            };
            const FrameView<Scalar> view{span(positions), span(normals), span(colors), span(radii)};
            const ThreadCount limit(threads.value_or(0));
            const py::gil_scoped_release release;
            ways.path.frame(t, view);
        },
        py::arg("t"), py::arg("threads"), py::arg("positions").noconvert(),
        py::arg("normals").noconvert(), py::arg("colors").noconvert(),
        py::arg("radii").noconvert());
}

}  // namespace

py::dict arrays_of(const ResamplingPlan& plan) {
    const auto inserted = static_cast<Eigen::Index>(plan.points.size());
    const auto hidden = static_cast<Eigen::Index>(plan.hidden.size());
    PlanRows rows(inserted, 3);
    Positions weights(inserted, 3);
    PlanTimes times(inserted, 4), hidden_times(hidden, 4);
    Eigen::Matrix<Index, Eigen::Dynamic, 1> hidden_rows(hidden);
    const auto put = [](PlanTimes& to, Eigen::Index row, const Lifetime& life) {
        to.row(row) << life.appears, life.complete, life.fades, life.vanishes;
    };
    for (Eigen::Index i = 0; i < inserted; ++i) {
        const InsertedPoint& point = plan.points[to_size(i)];
        for (std::size_t k = 0; k < 3; ++k) {
            rows(i, static_cast<Eigen::Index>(k)) = point.pairs[k];
            weights(i, static_cast<Eigen::Index>(k)) = point.weights[k];
        }
        put(times, i, point.lifetime);
    }
    for (Eigen::Index i = 0; i < hidden; ++i) {
        hidden_rows[i] = plan.hidden[to_size(i)].pair;
        put(hidden_times, i, plan.hidden[to_size(i)].lifetime);
    }
    const Values sizes{{plan.source_size, plan.target_size}};
    return py::dict(
        py::arg("pairs") = to_numpy(std::move(rows)),
        py::arg("weights") = to_numpy(std::move(weights)),
        py::arg("times") = to_numpy(std::move(times)),
        py::arg("hidden") = to_numpy(std::move(hidden_rows)),
        py::arg("hidden_times") = to_numpy(std::move(hidden_times)),
        py::arg("spacing") = to_numpy(side_by_side(plan.source_spacing, plan.target_spacing)),
        py::arg("density") = to_numpy(side_by_side(plan.source_density, plan.target_density)),
        py::arg("sizes") = to_numpy(Values(sizes)));
}

ResamplingPlan resampling_plan_of(const py::dict& fields) {
    const auto rows = from_numpy<PlanRows>(fields["pairs"]);
    const auto weights = from_numpy<Positions>(fields["weights"]);
    const auto times = from_numpy<PlanTimes>(fields["times"]);
    const auto hidden = from_numpy<Eigen::Matrix<Index, Eigen::Dynamic, 1>>(fields["hidden"]);
    const auto hidden_times = from_numpy<PlanTimes>(fields["hidden_times"]);
    const auto spacing = from_numpy<AtBothEnds>(fields["spacing"]);
    const auto density = from_numpy<AtBothEnds>(fields["density"]);
    const auto sizes = from_numpy<Values>(fields["sizes"]);
    const auto life = [](const PlanTimes& from, Eigen::Index i) {
        return Lifetime{from(i, 0), from(i, 1), from(i, 2), from(i, 3)};
    };
    ResamplingPlan plan;
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
        plan.points.push_back({{rows(i, 0), rows(i, 1), rows(i, 2)},
                               {weights(i, 0), weights(i, 1), weights(i, 2)},
                               life(times, i)});
    for (Eigen::Index i = 0; i < hidden.rows(); ++i)
        plan.hidden.push_back({hidden[i], life(hidden_times, i)});
    plan.source_spacing = spacing.col(0);
    plan.target_spacing = spacing.col(1);
    plan.source_density = density.col(0);
    plan.target_density = density.col(1);
    plan.source_size = sizes[0];
    plan.target_size = sizes[1];
    return plan;
}

void bind_stored_frames(py::module_& module) {
    define_straight_path<float>(module, "StraightPathSingle");
    define_straight_path<double>(module, "StraightPathDouble");
}

}  // namespace pointmorph::bindings
