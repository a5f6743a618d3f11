#include "registration/likeness.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "pointmorph/cloud/kd_tree.hpp"

namespace pointmorph {

namespace {

/// Sums over the surface in a ball around a point.
struct Ball {
    double area = 0.0, behind = 0.0, cosine = 0.0;

    /// As they are in LocalForms.
    Vector3 form(double radius) const {
        if (!(area > 0.0)) return {0.0, 0.0, 1.0};
        return {area / (radius * radius), behind / (area * radius), cosine / area};
    }
};

}  // namespace

FormRadii form_radii(const CoarseShape& source, const CoarseShape& target) {
    const auto fewest = static_cast<double>(std::min(source.size(), target.size()));
    const double least = 2.0 / std::sqrt(fewest);
    return {std::max(0.05, least), std::max(0.1, least), std::max(0.2, least)};
}

LocalForms local_forms(const CoarseShape& shape, std::span<const Index> rows,
                       const FormRadii& radii) {
    const KdTree<3> tree(shape.positions);
    LocalForms forms(static_cast<Eigen::Index>(rows.size()), 9);
    std::vector<std::pair<Index, double>> near;
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const Vector3 at = shape.positions.row(rows[i]), normal = shape.normals.row(rows[i]);
        std::array<Ball, std::tuple_size_v<FormRadii>> balls;
        tree.within_unsorted(at.data(), radii.back(), near);
        for (const auto& [row, squared] : near) {
            const double area = shape.areas[row];
            const double behind = area * (at - shape.positions.row(row).transpose()).dot(normal);
            const double cosine = area * normal.dot(shape.normals.row(row));
            for (std::size_t k = 0; k < radii.size(); ++k)
                if (squared < radii[k] * radii[k]) {
                    balls[k].area += area;
                    balls[k].behind += behind;
                    balls[k].cosine += cosine;
                }
        }
        for (std::size_t k = 0; k < radii.size(); ++k)
            forms.row(static_cast<Eigen::Index>(i)).segment<3>(static_cast<Eigen::Index>(3 * k)) =
                balls[k].form(radii[k]).transpose();
    }
    return forms;
}

void make_comparable(LocalForms& source, LocalForms& target) {
    constexpr double kLeast = 0.05;
    const auto count = static_cast<double>(source.rows() + target.rows());
    for (Eigen::Index k = 0; k < source.cols(); ++k) {
        const double mean = (source.col(k).sum() + target.col(k).sum()) / count;
        const double deviation = std::sqrt(((source.col(k).array() - mean).square().sum() +
                                            (target.col(k).array() - mean).square().sum()) /
                                           count);
        source.col(k) /= std::max(deviation, kLeast);
        target.col(k) /= std::max(deviation, kLeast);
    }
}

double unlikeness(const LocalForms& here, const LocalForms& there, std::span<const Index> partners,
                  std::span<const char> ends) {
    double sum = 0.0, count = 0.0;
    for (std::size_t i = 0; i < partners.size(); ++i) {
        if (!ends.empty() && ends[to_size(partners[i])] != 0) continue;
        sum += (here.row(static_cast<Eigen::Index>(i)) - there.row(partners[i])).cwiseAbs().sum();
        count += static_cast<double>(here.cols());
    }
    return count > 0.0 ? sum / count : 0.0;
}

}  // namespace pointmorph
