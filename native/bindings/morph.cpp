#include "pointmorph/morph/morph.hpp"

#include "bindings.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "pointmorph/morph/live_morph.hpp"
#include "pointmorph/morph/loop_suggestion.hpp"
#include "pointmorph/morph/network_preview.hpp"
#include "pointmorph/morph/options.hpp"

namespace pointmorph::bindings {

Polygons polygons_of(const py::object& faces) {
    Polygons result;
    if (faces.is_none()) return result;
    const auto given = faces.cast<std::pair<py::array_t<std::int64_t, py::array::c_style>,
                                            py::array_t<std::int32_t, py::array::c_style>>>();
    result.offsets.assign(given.first.data(), given.first.data() + given.first.size());
    result.corners.assign(given.second.data(), given.second.data() + given.second.size());
    return result;
}

Cloud cloud_of(const py::dict& fields) {
    return {fields["name"].cast<std::string>(),     from_numpy<Positions>(fields["positions"]),
            from_numpy<Normals>(fields["normals"]), from_numpy<Colors>(fields["colors"]),
            from_numpy<Values>(fields["radii"]),    polygons_of(fields["faces"])};
}

namespace {

/// From the dictionary that pointmorph.features makes of a feature.
Feature feature_of(const py::dict& fields) {
    const auto marked = [&](const char* side) {
        const py::dict given = fields[side];
        return Marked{given["rows"].cast<std::vector<Index>>(),
                      given["weights"].cast<std::vector<double>>()};
    };
    const auto kind = fields["kind"].cast<std::string>();
    return {fields["name"].cast<std::string>(),
            kind == "point"   ? FeatureKind::kPoint
            : kind == "curve" ? FeatureKind::kCurve
                              : FeatureKind::kRegion,
            marked("source"),
            marked("target"),
            fields["closed"].cast<bool>(),
            fields["hard"].cast<bool>(),
            fields["weight"].cast<double>()};
}

std::vector<Feature> features_of(const py::list& given) {
    std::vector<Feature> features;
    for (const py::handle& feature : given)
        features.push_back(feature_of(feature.cast<py::dict>()));
    return features;
}

py::array_t<std::int64_t> array_of(const Pairing& pairs) {
    py::array_t<std::int64_t> rows({static_cast<py::ssize_t>(pairs.size()), py::ssize_t{2}});
    auto view = rows.mutable_unchecked<2>();
    for (py::ssize_t i = 0; i < view.shape(0); ++i) {
        view(i, 0) = pairs[to_size(i)].source;
        view(i, 1) = pairs[to_size(i)].target;
    }
    return rows;
}

py::array_t<std::int64_t> array_of(const std::vector<std::array<Index, 2>>& rows) {
    py::array_t<std::int64_t> result({static_cast<py::ssize_t>(rows.size()), py::ssize_t{2}});
    auto view = result.mutable_unchecked<2>();
    for (py::ssize_t i = 0; i < view.shape(0); ++i)
        for (py::ssize_t k = 0; k < 2; ++k) view(i, k) = rows[to_size(i)][to_size(k)];
    return result;
}

py::array_t<std::int64_t> array_of(const BoundaryLoop& loop) {
    py::array_t<std::int64_t> rows(static_cast<py::ssize_t>(loop.size()));
    std::copy(loop.begin(), loop.end(), rows.mutable_data());
    return rows;
}

py::dict dict_of(const ParameterizationReport& report) {
    return py::dict(py::arg("unknowns") = report.unknowns,
                    py::arg("boundary_points") = report.boundary_points,
                    py::arg("iterations") = report.iterations,
                    py::arg("relative_residual") = report.relative_residual,
                    py::arg("solve_seconds") = report.solve_seconds);
}

py::list list_of(const std::vector<Rival>& rivals) {
    py::list rows;
    for (const Rival& rival : rivals)
        rows.append(py::dict(py::arg("ratio") = rival.ratio, py::arg("swap") = name_of(rival.swap),
                             py::arg("distance") = rival.distance, py::arg("places") = rival.places,
                             py::arg("source") = rival.source, py::arg("target") = rival.target,
                             py::arg("rival_target") = rival.rival_target));
    return rows;
}

py::list list_of(const std::vector<Proposal>& proposals) {
    py::list rows;
    for (const Proposal& proposal : proposals)
        rows.append(py::dict(py::arg("source") = proposal.source,
                             py::arg("target") = proposal.target,
                             py::arg("confidence") = proposal.confidence,
                             py::arg("is_tip") = proposal.is_extremity));
    return rows;
}

py::list list_of(const std::vector<Restart>& starts, std::size_t taken) {
    py::list list;
    for (std::size_t k = 0; k < starts.size(); ++k)
        list.append(py::dict(py::arg("start") = starts[k].start, py::arg("torn") = starts[k].torn,
                             py::arg("energy") = starts[k].energy, py::arg("taken") = k == taken));
    return list;
}

py::dict dict_of(const Diagnostics& found) {
    return py::dict(
        py::arg("margin") = std::isfinite(found.margin) ? py::object(py::float_(found.margin))
                                                        : py::object(py::none()),
        py::arg("confidence") = std::isfinite(found.confidence)
                                    ? py::object(py::float_(found.confidence))
                                    : py::object(py::none()),
        py::arg("rivals") = list_of(found.rivals), py::arg("proposals") = list_of(found.proposals),
        py::arg("starts") = list_of(found.starts, found.start_taken));
}

py::dict dict_of(const Topology& topology) {
    py::list pieces;
    for (const Component& piece : topology.components)
        pieces.append(py::dict(py::arg("points") = piece.points, py::arg("borders") = piece.borders,
                               py::arg("open") = piece.is_open, py::arg("genus") = piece.genus));
    return py::dict(py::arg("words") = in_words(topology), py::arg("pieces") = pieces,
                    py::arg("specks") = topology.strays);
}

py::dict dict_of(const MorphReport& report, const MorphOptions& options) {
    py::dict stages, chosen;
    for (const StageTime& time : report.stages) stages[py::str(time.stage)] = time.seconds;
    for (const Option& option : option_table()) chosen[py::str(option.name)] = option.get(options);
    py::dict result(
        py::arg("method") = report.method, py::arg("domain") = report.domain,
        py::arg("choice") = report.choice,
        py::arg("topology") = py::dict(py::arg("source") = dict_of(report.source_topology),
                                       py::arg("target") = dict_of(report.target_topology)),
        py::arg("stages") = stages, py::arg("seconds") = report.seconds,
        py::arg("pairs") = report.pairs, py::arg("feature_residual") = report.feature_residual,
        py::arg("alignment_rotation") = report.alignment_rotation,
        py::arg("alignment_sweeps") = report.alignment_sweeps,
        py::arg("source_parameterization") = dict_of(report.source_parameterization),
        py::arg("target_parameterization") = dict_of(report.target_parameterization),
        py::arg("loop") = report.loop, py::arg("curves") = report.curves,
        py::arg("patches") = report.patches,
        py::arg("tips") = array_of(report.extremities).attr("tolist")(),
        py::arg("update") = report.update, py::arg("warnings") = report.warnings,
        py::arg("options") = chosen);
    for (const auto& [name, figure] : dict_of(report.diagnostics)) result[name] = figure;
    return result;
}

py::array_t<bool> array_of(const std::vector<std::uint8_t>& flags) {
    py::array_t<bool> rows(static_cast<py::ssize_t>(flags.size()));
    std::copy(flags.begin(), flags.end(), rows.mutable_data());
    return rows;
}

py::dict dict_of(const PointQuality& points) {
    return py::dict(py::arg("stretch") = to_numpy(SingularValues(points.stretch)),
                    py::arg("measured") = array_of(points.measured),
                    py::arg("flipped") = array_of(points.flipped),
                    py::arg("reached") = array_of(points.reached),
                    py::arg("round_trip") = to_numpy(Values(points.round_trip)),
                    py::arg("distortion") = to_numpy(Values(points.distortion)));
}

py::dict dict_of(const MapFigures& figures) {
    return py::dict(
        py::arg("dirichlet") = figures.dirichlet, py::arg("stretch_p99") = figures.stretch_p99,
        py::arg("conformal_median") = figures.conformal_median,
        py::arg("flipped") = figures.flipped, py::arg("collapsed") = figures.collapsed,
        py::arg("round_trip_mean") = figures.round_trip_mean,
        py::arg("round_trip_p99") = figures.round_trip_p99, py::arg("coverage") = figures.coverage);
}

/// With what is measured at each point where that is wanted.
py::dict dict_of(const Quality& quality, bool by_point) {
    py::list worst;
    for (const Place& place : quality.worst)
        worst.append(py::dict(
            py::arg("source") = place.source, py::arg("target") = place.target,
            py::arg("flaw") = name_of(place.flaw), py::arg("distortion") = place.distortion,
            py::arg("share") = place.share, py::arg("side") = place.on_source ? "source" : "target",
            py::arg("where") = place.where, py::arg("advice") = place.advice));
    py::list features;
    for (const FeatureResidual& kept : quality.features)
        features.append(py::dict(py::arg("name") = kept.name, py::arg("kind") = name_of(kept.kind),
                                 py::arg("hard") = kept.hard, py::arg("weight") = kept.weight,
                                 py::arg("residual") = kept.residual,
                                 py::arg("inside") = kept.inside));
    py::dict result(py::arg("features") = features,
                    py::arg("source_to_target") = dict_of(quality.source_to_target),
                    py::arg("target_to_source") = dict_of(quality.target_to_source),
                    py::arg("worst") = worst);
    if (by_point) {
        result["source"] = dict_of(quality.source);
        result["target"] = dict_of(quality.target);
    }
    return result;
}

py::dict dict_of(const LocalConfidence& confidence) {
    py::list doubtful;
    for (const DoubtfulPlace& place : confidence.doubtful)
        doubtful.append(py::dict(py::arg("source") = place.source, py::arg("target") = place.target,
                                 py::arg("confidence") = place.confidence,
                                 py::arg("share") = place.share,
                                 py::arg("unreached") = place.unreached,
                                 py::arg("side") = place.on_source ? "source" : "target",
                                 py::arg("where") = place.where, py::arg("advice") = place.advice));
    return py::dict(py::arg("source") = to_numpy(Values(confidence.source)),
                    py::arg("target") = to_numpy(Values(confidence.target)),
                    py::arg("doubtful") = doubtful, py::arg("right") = confidence.right,
                    py::arg("warning") = confidence.warning);
}

py::dict dict_of(const MeshQuality& quality) {
    const MeshFigures& figures = quality.figures;
    py::list worst;
    for (const MeshPlace& place : quality.worst)
        worst.append(py::dict(py::arg("flaw") = name_of(place.flaw),
                              py::arg("source") = place.source, py::arg("target") = place.target,
                              py::arg("position") = py::make_tuple(
                                  place.position[0], place.position[1], place.position[2]),
                              py::arg("share") = place.share, py::arg("distance") = place.distance,
                              py::arg("where") = place.where, py::arg("advice") = place.advice));
    return py::dict(py::arg("folded") = figures.folded, py::arg("creased") = figures.creased,
                    py::arg("uncovered") = figures.uncovered, py::arg("off") = figures.off,
                    py::arg("grade") = name_of(quality.grade), py::arg("verdict") = quality.verdict,
                    py::arg("worst") = worst);
}

/// Writes into the caller's arrays, which the Python side has checked.
template <class Scalar>
void frame_into(const Morph& morph, double t, const py::array_t<Scalar>& positions,
                const py::array_t<Scalar>& normals, const py::array_t<Scalar>& colors,
                const py::array_t<Scalar>& radii) {
    const auto span = [](const py::array_t<Scalar>& rows) -> std::span<Scalar> {
        return {const_cast<Scalar*>(rows.data()), to_size(rows.size())};
    };
    const FrameView<Scalar> view{span(positions), span(normals), span(colors), span(radii)};
    const py::gil_scoped_release release;
    morph.frame<Scalar>(t, view);
}

template <class Scalar>
py::dict dict_of(ResampledFrame<Scalar> frame) {
    const auto rows = [](auto values, py::ssize_t columns) {
        using Number = typename decltype(values)::value_type;
        auto* owned = new std::vector<Number>(std::move(values));
        const py::capsule owner(owned,
                                [](void* p) { delete static_cast<std::vector<Number>*>(p); });
        std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(owned->size()) / columns};
        if (columns > 1) shape.push_back(columns);
        return py::array_t<Number>(shape, owned->data(), owner);
    };
    return py::dict(py::arg("positions") = rows(std::move(frame.positions), 3),
                    py::arg("normals") = rows(std::move(frame.normals), 3),
                    py::arg("colors") = rows(std::move(frame.colors), 4),
                    py::arg("radii") = rows(std::move(frame.radii), 1),
                    py::arg("velocities") = rows(std::move(frame.velocities), 3),
                    py::arg("ids") = rows(std::move(frame.ids), 1));
}

/// Calls a member of Morph that takes a Progress, without the GIL.
template <class Call>
decltype(auto) without_gil(const py::object& callback, Call&& call) {
    const auto progress = make_progress(callback);
    const py::gil_scoped_release release;
    return call(*progress);
}

template <class Scalar>
py::dict resampled_frame(const Morph& morph, double t, const py::object& callback) {
    return dict_of(without_gil(
        callback, [&](Progress& progress) { return morph.resampled_frame<Scalar>(t, progress); }));
}

VertexHolds holds_of(const py::dict& cloud) {
    return {from_numpy<Values>(cloud["rigid"]), from_numpy<Values>(cloud["fixed"])};
}

MorphInput input_of(const py::dict& source, const py::dict& target, const py::list& features,
                    std::vector<std::vector<std::string>> loops = {}) {
    const auto given = [](const py::dict& cloud, const char* rows) {
        return cloud[rows].cast<std::vector<Index>>();
    };
    MorphInput input{.source = cloud_of(source),
                     .target = cloud_of(target),
                     .features = features_of(features),
                     .source_boundary = given(source, "boundary"),
                     .target_boundary = given(target, "boundary"),
                     .source_parts = given(source, "parts"),
                     .target_parts = given(target, "parts"),
                     .source_holds = holds_of(source),
                     .target_holds = holds_of(target),
                     .delays = from_numpy<Values>(source["delay"])};
    if (!loops.empty()) {
        input.loop = std::move(loops.front());
        input.more_loops.assign(loops.begin() + 1, loops.end());
    }
    return input;
}

// Shared with the chains that it is part of.
using MorphClass = py::class_<Morph, std::shared_ptr<Morph>>;

std::shared_ptr<Morph> make_morph(const py::dict& source, const py::dict& target,
                                  const py::list& features,
                                  std::vector<std::vector<std::string>> loops,
                                  const MorphOptions& options, const py::object& source_start,
                                  const py::object& target_start, const py::object& callback) {
    const ThreadCount threads(options.threads);
    MorphInput input = input_of(source, target, features, std::move(loops));
    input.start = {from_numpy<Positions>(source_start), from_numpy<Positions>(target_start)};
    return without_gil(callback, [&](Progress& progress) {
        return std::make_shared<Morph>(std::move(input), options, progress);
    });
}

std::shared_ptr<Morph> restore_morph(const py::dict& source, const py::dict& target,
                                     const py::array_t<std::int64_t, py::array::c_style>& rows,
                                     const py::dict& kept, const MorphOptions& options) {
    const ThreadCount threads(options.threads);
    Pairing pairs(to_size(rows.shape(0)));
    const auto view = rows.unchecked<2>();
    for (py::ssize_t i = 0; i < view.shape(0); ++i)
        pairs[to_size(i)] = {to_index(view(i, 0)), to_index(view(i, 1))};
    const auto positions = [&](const char* name) { return from_numpy<Positions>(kept[name]); };
    KeptMorph remains{.source = cloud_of(source),
                      .target = cloud_of(target),
                      .pairs = std::move(pairs),
                      .images = {positions("source_images"), positions("target_images")},
                      .delays = from_numpy<Values>(source["delay"]),
                      .source_ends = positions("source_ends"),
                      .target_ends = positions("target_ends")};
    if (!kept["resampling"].is_none())
        remains.resampling = resampling_plan_of(kept["resampling"].cast<py::dict>());
    const py::gil_scoped_release release;
    return std::make_shared<Morph>(std::move(remains), options);
}

std::unique_ptr<LiveMorph> make_live(const py::dict& source, const py::dict& target,
                                     const py::list& features, const MorphOptions& options,
                                     const py::tuple& maps, const py::object& callback) {
    const ThreadCount threads(options.threads);
    MorphInput input = input_of(source, target, features);
    input.start = {from_numpy<Positions>(maps[0]), from_numpy<Positions>(maps[1])};
    return without_gil(callback, [&](Progress& progress) {
        return std::make_unique<LiveMorph>(std::move(input), options, progress);
    });
}

std::shared_ptr<Morph> chained_morph(const std::vector<std::shared_ptr<Morph>>& legs,
                                     const MorphOptions& options, const py::object& delays) {
    return std::make_shared<Morph>(
        std::vector<std::shared_ptr<const Morph>>(legs.begin(), legs.end()), options,
        from_numpy<Values>(delays));
}

std::shared_ptr<Morph> updated(const LiveMorph& live, const py::list& features,
                               const py::object& callback) {
    std::vector<Feature> changed = features_of(features);
    return without_gil(callback, [&](Progress& progress) {
        return std::shared_ptr<Morph>(new Morph(live.updated(std::move(changed), progress)));
    });
}

std::vector<std::string> proposed_loop(const py::dict& source, const py::dict& target,
                                       const py::list& features, const MorphOptions& options,
                                       const py::object& callback) {
    const ThreadCount threads(options.threads);
    const MorphInput input = input_of(source, target, features, {});
    return without_gil(callback,
                       [&](Progress& progress) { return suggest_loop(input, options, progress); });
}

py::tuple traced_network(const py::dict& source, const py::dict& target, const py::list& features,
                         std::vector<std::vector<std::string>> loops, const MorphOptions& options,
                         const py::object& callback) {
    const ThreadCount threads(options.threads);
    const MorphInput input = input_of(source, target, features, std::move(loops));
    NamedNetwork found = without_gil(
        callback, [&](Progress& progress) { return preview_network(input, options, progress); });
    py::list curves;
    for (NetworkCurve& curve : found.network.curves)
        curves.append(py::make_tuple(
            found.corners[to_size(curve.from)], found.corners[to_size(curve.to)],
            to_numpy(std::move(curve.on[0].points)), to_numpy(std::move(curve.on[1].points))));
    return py::make_tuple(curves, found.network.patches, array_of(found.network.labels[0]),
                          array_of(found.network.labels[1]));
}

/// What a morph is asked for: arrays of its whole, and figures.
void define_queries(MorphClass& morph) {
    morph.def("pairs", [](const Morph& m) { return array_of(m.pairs()); })
        .def("source_domain",
             [](const Morph& m) { return to_numpy(DomainPoints(m.source_domain())); })
        .def("target_domain",
             [](const Morph& m) { return to_numpy(DomainPoints(m.target_domain())); })
        .def("source_boundary", [](const Morph& m) { return array_of(m.source_boundary()); })
        .def("target_boundary", [](const Morph& m) { return array_of(m.target_boundary()); })
        .def("report", [](const Morph& m) { return dict_of(m.report(), m.options()); })
        .def("source_to_target",
             [](const Morph& m, const py::object& callback) {
                 return to_numpy(without_gil(
                     callback, [&](Progress& progress) { return m.source_to_target(progress); }));
             })
        .def("target_to_source",
             [](const Morph& m, const py::object& callback) {
                 return to_numpy(without_gil(
                     callback, [&](Progress& progress) { return m.target_to_source(progress); }));
             })
        .def("has_mesh", &Morph::has_mesh)
        .def("wrapped",
             [](const Morph& m, double t, const py::object& callback) {
                 return to_numpy(without_gil(
                     callback, [&](Progress& progress) { return m.wrapped(t, progress); }));
             })
        .def("has_target_mesh", &Morph::has_target_mesh)
        .def("vertex_times", [](const Morph& m, bool of_source,
                                double t) { return to_numpy(m.vertex_times(of_source, t)); })
        .def("denser",
             [](const Morph& m, bool of_source, double tolerance, Index most_vertices,
                const py::object& callback) {
                 const DensityOptions options{.tolerance = tolerance,
                                              .most_vertices = most_vertices};
                 DenserMesh mesh = without_gil(callback, [&](Progress& progress) {
                     return m.denser(of_source, options, progress);
                 });
                 return py::make_tuple(to_numpy(std::move(mesh.faces)), array_of(mesh.polygons),
                                       array_of(mesh.ends), to_numpy(std::move(mesh.positions)));
             })
        .def("wrapped_target",
             [](const Morph& m, double t, const py::object& callback) {
                 return to_numpy(without_gil(
                     callback, [&](Progress& progress) { return m.wrapped_target(t, progress); }));
             })
        .def("cracks",
             [](const Morph& m, const std::vector<double>& times, const py::object& callback) {
                 const auto cracks = without_gil(
                     callback, [&](Progress& progress) { return m.cracks(times, progress); });
                 std::vector<std::pair<double, double>> result;
                 for (const Cracks& at : cracks) result.emplace_back(at.t, at.share);
                 return result;
             })
        .def("quality",
             [](const Morph& m, bool by_point, const py::object& callback) {
                 return dict_of(without_gil(callback,
                                            [&](Progress& progress) -> const Quality& {
                                                return m.quality(progress);
                                            }),
                                by_point);
             })
        .def("local_confidence",
             [](const Morph& m, const py::object& callback) {
                 return dict_of(
                     without_gil(callback, [&](Progress& progress) -> const LocalConfidence& {
                         return m.local_confidence(progress);
                     }));
             })
        .def("mesh_quality", [](const Morph& m, const py::object& callback) {
            return dict_of(without_gil(callback, [&](Progress& progress) -> const MeshQuality& {
                return m.mesh_quality(progress);
            }));
        });
}

py::dict arrays_of(const Cloud& cloud) {
    return py::dict(py::arg("positions") = to_numpy(Positions(cloud.positions)),
                    py::arg("normals") = to_numpy(Normals(cloud.normals)),
                    py::arg("colors") = to_numpy(Colors(cloud.colors)),
                    py::arg("radii") = to_numpy(Values(cloud.radii)));
}

void define_frames(MorphClass& morph) {
    morph.def("completed_source", [](const Morph& m) { return arrays_of(m.source()); })
        .def("completed_target", [](const Morph& m) { return arrays_of(m.target()); })
        .def("resampling_plan",
             [](const Morph& m, const py::object& callback) {
                 return bindings::arrays_of(
                     without_gil(callback, [&](Progress& progress) -> const ResamplingPlan& {
                         return m.resampling(progress).plan();
                     }));
             })
        .def("inserted",
             [](const Morph& m, const py::object& callback) {
                 return without_gil(callback, [&](Progress& progress) {
                     return m.resampling(progress).points().size();
                 });
             })
        .def("lay_out_paths",
             [](const Morph& m, const py::object& callback) {
                 without_gil(callback, [&](Progress& progress) { m.lay_out_paths(progress); });
             })
        .def("source_at",
             [](const Morph& m, double t, const py::object& callback) {
                 return to_numpy(without_gil(
                     callback, [&](Progress& progress) { return m.source_at(t, progress); }));
             })
        .def("resampled_frame_float32", &resampled_frame<float>)
        .def("resampled_frame_float64", &resampled_frame<double>)
        .def("frame_float32", &frame_into<float>, py::arg("t"), py::arg("positions").noconvert(),
             py::arg("normals").noconvert(), py::arg("colors").noconvert(),
             py::arg("radii").noconvert())
        .def("frame_float64", &frame_into<double>, py::arg("t"), py::arg("positions").noconvert(),
             py::arg("normals").noconvert(), py::arg("colors").noconvert(),
             py::arg("radii").noconvert());
}

void define_live(py::module_& module) {
    py::class_<LiveMorph>(module, "LiveMorph")
        .def(py::init(&make_live))
        .def_static("of",
                    [](const Morph& morph, const py::object& callback) {
                        return without_gil(callback, [&](Progress& progress) {
                            return std::make_unique<LiveMorph>(morph, progress);
                        });
                    })
        .def("source_to_target",
             [](const LiveMorph& live, const py::list& features, const py::object& callback) {
                 const std::vector<Feature> changed = features_of(features);
                 return to_numpy(without_gil(callback, [&](Progress& progress) {
                     return live.source_to_target(changed, progress);
                 }));
             })
        .def("updated", &updated);
}

}  // namespace

void bind_morph(py::module_& module) {
    module.def("propose_loop", &proposed_loop, "Names of features for a loop, in order.",
               py::arg("source"), py::arg("target"), py::arg("features"), py::arg("options"),
               py::arg("progress"));
    module.def("trace_network", &traced_network,
               "Ends and points of the curves on both, the curves around each patch, and the patch "
               "of each point.",
               py::arg("source"), py::arg("target"), py::arg("features"), py::arg("loops"),
               py::arg("options"), py::arg("progress"));
    module.def(
        "mesh_grade",
        [](double folded, double creased, double uncovered, double off) {
            return name_of(grade_of(MeshFigures{folded, creased, uncovered, off}));
        },
        "How good a wrapped mesh with these figures is.", py::arg("folded"), py::arg("creased"),
        py::arg("uncovered"), py::arg("off"));
    MorphClass morph(module, "Morph");
    morph.def(py::init(&make_morph))
        .def_static("restore", &restore_morph)
        .def_static("chained", &chained_morph);
    define_queries(morph);
    define_frames(morph);
    define_live(module);
}

}  // namespace pointmorph::bindings
