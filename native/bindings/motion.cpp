#include "pointmorph/frames/motion.hpp"

#include "bindings.hpp"
#include "pointmorph/frames/mesh_motion.hpp"
#include "pointmorph/morph/options.hpp"

namespace pointmorph::bindings {

namespace {

GradualSimilarity similarity_of(const Positions& from, const Positions& to) {
    return {fit_similarity(from, to), from.colwise().mean().transpose()};
}

/// A MeshMotion, and the mesh that it refers to.
class MotionOfMesh {
public:
    MotionOfMesh(const Cloud& cloud, const Positions& ends, PathKind path, Progress& progress)
        : mesh_(make_mesh(cloud)),
          motion_(mesh_, {cloud.positions, cloud.normals}, ends,
                  similarity_of(cloud.positions, ends), path, progress) {}

    Positions at(double t) const { return motion_.at(t); }

private:
    Mesh mesh_;
    MeshMotion motion_;
};

}  // namespace

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
        return std::make_unique<Motion>(p, n, q, similarity_of(p, q), options.path, *progress);
    };
    const auto make_with_faces = [](const py::dict& fields, const py::array& images,
                                    const std::string& path, const py::object& callback) {
        MorphOptions options;
        set_option(options, "path", path);
        const Cloud cloud = cloud_of(fields);
        const auto q = from_numpy<Positions>(images);
        const auto progress = make_progress(callback);
        const py::gil_scoped_release release;
        return std::make_unique<MotionOfMesh>(cloud, q, options.path, *progress);
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
    py::class_<MotionOfMesh>(module, "MeshMotion")
        .def(py::init(make_with_faces))
        .def("at", [](const MotionOfMesh& m, double t) {
            Positions places;
            {
                const py::gil_scoped_release release;
                places = m.at(t);
            }
            return to_numpy(std::move(places));
        });
}

}  // namespace pointmorph::bindings
