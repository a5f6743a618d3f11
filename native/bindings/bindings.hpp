// What the binding files share.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/frames/resampling.hpp"

namespace pointmorph::bindings {

namespace py = pybind11;

void bind_errors(py::module_& module);
void bind_options(py::module_& module);
void bind_neighborhoods(py::module_& module);
void bind_sampling(py::module_& module);
void bind_morph(py::module_& module);
void bind_decomposition(py::module_& module);
void bind_motion(py::module_& module);
void bind_stored_frames(py::module_& module);

/// From the dictionary that pointmorph.Cloud makes of itself.
Cloud cloud_of(const py::dict& fields);

/// From the pair (offsets, corners), or None.
Polygons polygons_of(const py::object& faces);

/// As arrays, for files.
py::dict arrays_of(const ResamplingPlan& plan);
/// From what that made of it. The Python side has checked the shapes.
ResamplingPlan resampling_plan_of(const py::dict& fields);

/// A progress whose callback takes the GIL, lets Python handle signals (Ctrl-C) and then calls
/// `callback(stage, fraction)`, which returns False to ask for the end; None is silent.
std::unique_ptr<Progress> make_progress(const py::object& callback);

/// Moves an Eigen array or vector into a numpy array that owns it; nothing is copied.
template <class Array>
py::array_t<typename Array::Scalar> to_numpy(Array rows) {
    auto* owned = new Array(std::move(rows));
    const py::capsule owner(owned, [](void* p) { delete static_cast<Array*>(p); });
    std::vector<py::ssize_t> shape{owned->rows()};
    if constexpr (Array::ColsAtCompileTime != 1) shape.push_back(owned->cols());
    return py::array_t<typename Array::Scalar>(shape, owned->data(), owner);
}

/// Copies what lies row by row, on all threads.
template <class Array, class Dense>
Array copied(const Dense& dense) {
    if (!dense) throw py::error_already_set();
    constexpr Eigen::Index kColumns = Array::ColsAtCompileTime;
    Array result(dense.size() / kColumns, kColumns);
    const auto* from = dense.data();
    Progress quiet;
    parallel_for(to_index(result.rows()), quiet, [&](Index begin, Index end) {
        std::copy_n(from + begin * kColumns, (end - begin) * kColumns,
                    result.data() + begin * kColumns);
    });
    return result;
}

/// Copies a numpy array, whose shape the Python side has checked; 0 rows for None. What comes in
/// single precision, as from files and Blender, becomes double on the way.
template <class Array>
Array from_numpy(const py::object& rows) {
    if (rows.is_none()) return Array(0, Array::ColsAtCompileTime);
    if (py::isinstance<py::array_t<float>>(rows))
        return copied<Array>(py::array_t<float, py::array::c_style>::ensure(rows));
    using Scalar = typename Array::Scalar;
    return copied<Array>(
        py::array_t<Scalar, py::array::c_style | py::array::forcecast>::ensure(rows));
}

}  // namespace pointmorph::bindings
