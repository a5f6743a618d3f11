#include "pointmorph/frames/motion.hpp"

#include "bindings.hpp"
#include "pointmorph/morph/options.hpp"

namespace pointmorph::bindings {

void bind_motion(py::module_& module) {
    const auto make = [](const py::array& positions, const py::array& normals,
                         const py::array& images, const std::string& path,
                         const py::object& callback) {
        MorphOptions options;
        set_option(options, "path", path);
        const auto p = from_numpy<Positions>(positions);
        const auto n = from_numpy<Normals>(normals);
        const auto q = from_numpy<Positions>(images);
        const auto progress = make_progress(callback);
        const py::gil_scoped_release release;
        const GradualSimilarity similarity{fit_similarity(p, q), p.colwise().mean().transpose()};
        return std::make_unique<Motion>(p, n, q, similarity, options.path, *progress);
    };
    py::class_<Motion>(module, "Motion")
        .def(py::init(make))
        .def("at", [](const Motion& m, double t) {
            OrientedPoints cloud;
            {
                const py::gil_scoped_release release;
                cloud = m.at(t);
            }
            return std::pair(to_numpy(std::move(cloud.positions)),
                             to_numpy(std::move(cloud.normals)));
        });
}

}  // namespace pointmorph::bindings
