#include "measures/place_words.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>

#include "pointmorph/measures/quality.hpp"

namespace pointmorph {

namespace {

std::string quoted(const std::string& name) {
    return "\"" + name + "\"";
}

}  // namespace

std::string percent(double share) {
    const double percents = 100.0 * share;
    if (percents > 0.0 && percents < 0.01) return "under 0.01 %";
    if (percents > 99.99 && percents < 100.0 - 1e-7) return "over 99.99 %";
    const bool is_nearly_all = percents >= 99.5 && percents < 100.0 - 1e-7;
    const char* nearly_all = percents < 99.95 ? "%.1f %%" : "%.2f %%";
    const char* others = percents < 9.95 ? "%.2g %%" : "%.0f %%";
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), is_nearly_all ? nearly_all : others, percents);
    return text.data();
}

std::string sentence(std::string text) {
    text.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
    return text + ".";
}

std::vector<MarkedPoint> marked_points(std::span<const Feature> features) {
    std::vector<MarkedPoint> points;
    for (const Feature& feature : features)
        if (feature.kind != FeatureKind::kRegion)
            for (const Index row : feature.source.rows) points.push_back({&feature.name, row});
    return points;
}

PlaceWords words_for(const DescribedShape& source, Index row, std::span<const MarkedPoint> marks) {
    const std::string mark = "mark a feature there on both models";
    const auto arm = [&](const MarkedPoint& feature) -> Vector3 {
        return (source.positions.row(feature.row) - source.positions.row(row)).transpose();
    };
    const auto by_distance = [&](const MarkedPoint& a, const MarkedPoint& b) {
        return arm(a).norm() < arm(b).norm();
    };
    const auto nearest = std::ranges::min_element(marks, by_distance);
    if (nearest == marks.end() || arm(*nearest).norm() > 0.5 * source.root_area)
        return {direction_in_words(source.positions, row) + " of " + source.name, mark, "it"};
    if (arm(*nearest).norm() < 0.05 * source.root_area)
        return {"at " + quoted(*nearest->name),
                "check that " + quoted(*nearest->name) +
                    " marks the same place on both models, or mark another feature beside it",
                source.name};
    std::vector<MarkedPoint> beyond;
    for (const MarkedPoint& feature : marks)
        if (feature.name != nearest->name && arm(feature).dot(arm(*nearest)) < 0.0 &&
            arm(feature).norm() < source.root_area)
            beyond.push_back(feature);
    const auto second = std::ranges::min_element(beyond, by_distance);
    if (second == beyond.end()) return {"near " + quoted(*nearest->name), mark, source.name};
    return {"between " + quoted(*nearest->name) + " and " + quoted(*second->name), mark,
            source.name};
}

}  // namespace pointmorph
