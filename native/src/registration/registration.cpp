#include "pointmorph/registration/registration.hpp"

#include <random>

#include "registration/annealing.hpp"

namespace pointmorph {

Registration register_level(const CoarsePair& shapes, Index level, const RegistrationStart& start,
                            const RegistrationLevel& schedule, const RegistrationOptions& options,
                            Progress& progress) {
    std::mt19937_64 random(1);
    return annealed({shapes, level, schedule, options}, start, random, progress);
}

Registration register_shapes(const CoarsePair& shapes, const RegistrationStart& start,
                             const RegistrationOptions& options, Progress& progress,
                             Index first_level) {
    std::mt19937_64 random(1);
    Registration result;
    result.source_points.positions = start.source;
    result.target_points.positions = start.target;
    const auto levels = to_index(shapes.source.levels.size());
    for (Index level = first_level; level < levels; ++level) {
        const Progress::Part part(progress, static_cast<double>(level) / levels,
                                  static_cast<double>(level + 1) / levels);
        const RegistrationStart from{std::move(result.source_points.positions),
                                     std::move(result.target_points.positions)};
        result = annealed({shapes, level, options.levels[to_size(level)], options}, from, random,
                          progress);
    }
    return result;
}

}  // namespace pointmorph
