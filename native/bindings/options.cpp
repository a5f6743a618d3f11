#include "pointmorph/morph/options.hpp"

#include "bindings.hpp"

namespace pointmorph::bindings {

namespace {

/// The method that uses an option, in the word that the option `method` takes for it; None: both.
py::object method_of(const Option& option) {
    if (!option.method) return py::none();
    MorphOptions options;
    options.method = *option.method;
    return py::cast(find_option("method").get(options));
}

}  // namespace

void bind_options(py::module_& module) {
    py::class_<MorphOptions>(module, "MorphOptions")
        .def(py::init<>())
        .def("propose_features", [](MorphOptions& options) { options.refinement.propose = true; })
        .def("expect_frames", [](MorphOptions& options) { options.expects_frames = true; })
        .def("set", [](MorphOptions& options, const std::string& name,
                       const OptionValue& value) { set_option(options, name, value); })
        .def("is_straight",
             [](const MorphOptions& options) { return options.path_kind() == PathKind::kLinear; });

    module.def("option_table", [] {
        py::list rows;
        const MorphOptions defaults;
        constexpr const char* kKinds[] = {"int", "float", "choice"};
        constexpr const char* kAffects[] = {"map", "path", "frames", "nothing"};
        for (const Option& option : option_table())
            rows.append(py::dict(py::arg("name") = option.name,
                                 py::arg("kind") = kKinds[static_cast<int>(option.kind)],
                                 py::arg("default") = option.get(defaults),
                                 py::arg("minimum") = option.minimum,
                                 py::arg("maximum") = option.maximum,
                                 py::arg("choices") = py::tuple(py::cast(option.choices)),
                                 py::arg("unit") = option.unit, py::arg("help") = option.help,
                                 py::arg("affects") = kAffects[static_cast<int>(option.affects)],
                                 py::arg("method") = method_of(option)));
        return rows;
    });
}

}  // namespace pointmorph::bindings
