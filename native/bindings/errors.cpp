// C++ errors become those of pointmorph.errors; progress and signals.
#include "pointmorph/base/error.hpp"

#include "bindings.hpp"

namespace pointmorph::bindings {

namespace {

void raise(const char* type, const Error& error) {
    const py::object raised =
        py::module_::import("pointmorph.base.errors")
            .attr(type)(error.subject(), error.expected(), error.found(), error.advice());
    PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(raised.ptr())), raised.ptr());
}

}  // namespace

void bind_errors(py::module_&) {
    py::register_local_exception_translator([](std::exception_ptr pointer) {
        try {
            if (pointer) std::rethrow_exception(pointer);
        } catch (const CloudError& error) {
            raise("CloudError", error);
        } catch (const FeatureError& error) {
            raise("FeatureError", error);
        } catch (const OptionError& error) {
            raise("OptionError", error);
        } catch (const TopologyError& error) {
            raise("TopologyError", error);
        } catch (const ConvergenceError& error) {
            raise("ConvergenceError", error);
        } catch (const Cancelled& cancelled) {
            const py::object type = py::module_::import("pointmorph.base.errors").attr("Cancelled");
            PyErr_SetString(type.ptr(), cancelled.what());
        }
    });
}

std::unique_ptr<Progress> make_progress(const py::object& callback) {
    return std::make_unique<Progress>([callback](std::string_view stage, double fraction) {
        const py::gil_scoped_acquire gil;
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (callback.is_none()) return true;
        const py::object answer = callback(py::str(stage.data(), stage.size()), fraction);
        return answer.is_none() || answer.cast<bool>();
    });
}

}  // namespace pointmorph::bindings
