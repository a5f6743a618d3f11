#include "pointmorph/frames/motion.hpp"

#include "bindings.hpp"
#include "pointmorph/frames/mesh_motion.hpp"
#include "pointmorph/frames/stagger.hpp"
#include "pointmorph/morph/options.hpp"

namespace pointmorph::bindings {

namespace {

/// A motion with the mesh that it refers to.
struct MovingMesh {
    Mesh mesh;
    MeshMotion motion;

    MovingMesh(const Cloud& cloud, const Positions& ends, PathKind path, Progress& progress)
        : mesh(make_mesh(cloud)), motion(make(cloud, ends, path, progress)) {}
    MovingMesh(const MovingMesh&) = delete;

private:
    MeshMotion make(const Cloud& cloud, const Positions& ends, PathKind path,
                    Progress& progress) const {
        const Positions& p = cloud.positions;
        const Normals normals = gather(mesh.place_normals, mesh.places);
        const GradualSimilarity similarity{fit_similarity(p, ends), p.colwise().mean().transpose()};
        return {mesh, {p, normals}, ends, similarity, path, progress};
    }
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
        const GradualSimilarity similarity{fit_similarity(p, q), p.colwise().mean().transpose()};
        return std::make_unique<Motion>(p, n, q, similarity, options.path_kind(), *progress);
    };
    const auto make_of_mesh = [](const py::array& positions, const py::array& images,
                                 const py::object& faces, const std::string& path,
                                 const py::object& callback) {
        MorphOptions options;
        set_option(options, "path", path);
        Cloud cloud;
        cloud.positions = from_numpy<Positions>(positions);
        cloud.faces = polygons_of(faces);
        const auto ends = from_numpy<Positions>(images);
        const auto progress = make_progress(callback);
        const py::gil_scoped_release release;
        return std::make_unique<MovingMesh>(cloud, ends, options.path_kind(), *progress);
    };
    py::class_<MovingMesh>(module, "MeshMotion")
        .def(py::init(make_of_mesh))
        .def("at", [](const MovingMesh& m, double t, const py::object& callback) {
            const auto progress = make_progress(callback);
            Positions positions;
            {
                const py::gil_scoped_release release;
                positions = m.motion.at(t, *progress);
            }
            return to_numpy(std::move(positions));
        });
    py::class_<PointwisePath>(module, "PointwisePath")
        .def(py::init([](const py::array& start, const py::array& end, const py::function& at) {
            return std::make_unique<PointwisePath>(
                OrientedPoints{from_numpy<Positions>(start), {}},
                OrientedPoints{from_numpy<Positions>(end), {}}, [&](double t) {
                    return OrientedPoints{from_numpy<Positions>(at(t)), {}};
                });
        }))
        .def("at", [](const PointwisePath& path, const py::array& times) {
            const auto own = from_numpy<Values>(times);
            OrientedPoints cloud;
            {
                const py::gil_scoped_release release;
                cloud = path.at(own);
            }
            return to_numpy(std::move(cloud.positions));
        });
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
