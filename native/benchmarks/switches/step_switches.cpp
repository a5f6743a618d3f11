// What switches single steps of the default map off: fields of the options that users don't reach.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "pointmorph/morph/morph_options.hpp"

namespace pointmorph {
namespace {

using Switch = std::pair<std::string, std::function<void(MorphOptions&)>>;

std::vector<RegistrationLevel*> schedules(MorphOptions& options) {
    PoseOptions& pose = options.refinement.pose;
    std::vector<RegistrationLevel*> all{&pose.trial, &pose.longer, &pose.relaxation};
    for (RegistrationLevel& level : options.refinement.registration.levels) all.push_back(&level);
    return all;
}

std::vector<Switch> search_switches() {
    return {
        {"sides aren't compared", [](MorphOptions& o) { o.refinement.pose.symmetry.weight = 0.0; }},
        {"unlike points cost nothing", [](MorphOptions& o) { o.refinement.pose.likeness = 0.0; }},
        {"only like axes, one pose cluster",
         [](MorphOptions& o) {
             o.refinement.pose.spread_ratio = 1.0;
             o.refinement.pose.other_clusters = 0;
         }},
        {"no tilts", [](MorphOptions& o) { o.refinement.pose.tilt = 0.0; }},
        {"extremities lead nothing",
         [](MorphOptions& o) {
             o.refinement.pose.effort.variants = o.refinement.pose.second_effort.variants = 0;
         }},
        {"no second effort",
         [](MorphOptions& o) {
             o.refinement.pose.most_opposed = 2.0;
             o.refinement.registration.most_torn = 2.0;
         }},
        {"nothing registered for longer",
         [](MorphOptions& o) {
             o.refinement.pose.longer.rounds = 0;
             o.refinement.pose.semifinalists = o.refinement.pose.finalists;
         }},
        {"one finalist",
         [](MorphOptions& o) {
             o.refinement.pose.finalists = 1;
             o.refinement.pose.other_clusters = 0;
         }},
        {"tears cost nothing", [](MorphOptions& o) { o.refinement.pose.tear_weight = 0.0; }},
    };
}

std::vector<Switch> registration_switches() {
    return {
        {"no normals in the matching",
         [](MorphOptions& o) { o.refinement.registration.normal_weight = 0.0; }},
        {"far matches count fully",
         [](MorphOptions& o) { o.refinement.registration.outlier_distance = 1e6; }},
        {"parts that have jumped count",
         [](MorphOptions& o) { o.refinement.registration.torn_component = 0.0; }},
        {"nothing grows or shrinks",
         [](MorphOptions& o) { o.refinement.registration.largest_scale = 1.0; }},
        {"as soft at first as at last",
         [](MorphOptions& o) {
             for (RegistrationLevel* level : schedules(o))
                 level->first_stiffness = level->last_stiffness;
         }},
        {"the finest level hardly bends",
         [](MorphOptions& o) {
             RegistrationLevel& finest = o.refinement.registration.levels.back();
             finest.rounds = finest.full_rounds = 1;
             finest.solves = 1;
         }},
        {"no normals in the last matching",
         [](MorphOptions& o) { o.refinement.normal_weight = 0.0; }},
        {"half as many coarse points", [](MorphOptions& o) { o.refinement.coarse.points /= 2; }},
        {"half as many nodes",
         [](MorphOptions& o) {
             for (Index& nodes : o.refinement.coarse.nodes) nodes /= 2;
         }},
    };
}

std::vector<Switch> switches() {
    std::vector<Switch> all = search_switches();
    for (Switch& other : registration_switches()) all.push_back(std::move(other));
    return all;
}

std::vector<std::string> names() {
    std::vector<std::string> result;
    for (const Switch& one : switches()) result.push_back(one.first);
    return result;
}

void switch_off(MorphOptions& options, const std::string& name) {
    for (const Switch& one : switches())
        if (one.first == name) return one.second(options);
    throw pybind11::key_error("no such step: " + name);
}

}  // namespace
}  // namespace pointmorph

PYBIND11_MODULE(step_switches, module) {
    pybind11::module_::import("pointmorph");  // whose options they are
    module.def("names", &pointmorph::names);
    module.def("switch_off", &pointmorph::switch_off);
}
