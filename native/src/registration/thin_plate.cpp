#include "pointmorph/registration/thin_plate.hpp"

#include <Eigen/LU>
#include <span>
#include <vector>

namespace pointmorph {

ThinPlate::ThinPlate(const Positions& from, const Positions& to) : from_(from) {
    constexpr double kRegularization = 1e-2;
    const auto n = from.rows();
    Eigen::MatrixXd system = Eigen::MatrixXd::Zero(n + 4, n + 4);
    for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j < n; ++j) system(i, j) = -(from.row(i) - from.row(j)).norm();
        system(i, i) -= kRegularization;
        system(i, n) = system(n, i) = 1.0;
        system.block<1, 3>(i, n + 1) = from.row(i);
        system.block<3, 1>(n + 1, i) = from.row(i).transpose();
    }
    Eigen::MatrixXd right = Eigen::MatrixXd::Zero(n + 4, 3);
    // Displacements: what the places leave open (all in one plane) stays as it is.
    right.topRows(n) = to - from;
    coefficients_ = system.fullPivLu().solve(right);
}

Eigen::RowVector3d ThinPlate::operator()(const Eigen::RowVector3d& place) const {
    const auto n = from_.rows();
    Eigen::RowVector3d image = place + coefficients_.row(n) + place * coefficients_.bottomRows<3>();
    for (Eigen::Index i = 0; i < n; ++i)
        image -= (place - from_.row(i)).norm() * coefficients_.row(i);
    return image;
}

MarkedPlaces marked_places(const CoarsePair& shapes) {
    constexpr Index kMostGuides = 60;
    const Guides &source = shapes.source.guides, &target = shapes.target.guides;
    const Index step = (source.size() + kMostGuides - 1) / kMostGuides;
    const Index guides = step > 0 ? (source.size() + step - 1) / step : 0;
    const auto count = static_cast<Eigen::Index>(shapes.features.size());
    MarkedPlaces places{Positions(count + guides, 3), Positions(count + guides, 3)};
    for (Eigen::Index k = 0; k < count; ++k) {
        const IndexPair& f = shapes.features[to_size(k)];
        places.source.row(k) = shapes.source.positions.row(f.source);
        places.target.row(k) = shapes.target.positions.row(f.target);
    }
    for (Index k = 0; k < guides; ++k) {
        places.source.row(count + k) = source.places.row(k * step);
        places.target.row(count + k) = target.places.row(k * step);
    }
    return places;
}

namespace {

/// Of very many features some, evenly through their order: a plate through 500 is bent by all that
/// can matter to a start, and what it costs grows with the cube of their number.
std::vector<IndexPair> thinned(std::span<const IndexPair> features) {
    constexpr std::size_t kMost = 500;
    if (features.size() <= kMost) return {features.begin(), features.end()};
    std::vector<IndexPair> some;
    for (std::size_t k = 0; k < kMost; ++k) some.push_back(features[k * features.size() / kMost]);
    return some;
}

}  // namespace

RegistrationStart thin_plate_start(const CoarsePair& shapes) {
    RegistrationStart start{shapes.source.positions, shapes.target.positions};
    constexpr Eigen::Index kFewest = 5;
    const std::vector<IndexPair> features = thinned(shapes.features);
    const auto [s, t] = marked_places({shapes.source, shapes.target, features});
    if (s.rows() < kFewest) return start;
    const ThinPlate forward(s, t), backward(t, s);
    for (Eigen::Index k = 0; k < start.source.rows(); ++k)
        start.source.row(k) = forward(start.source.row(k));
    for (Eigen::Index k = 0; k < start.target.rows(); ++k)
        start.target.row(k) = backward(start.target.row(k));
    return start;
}

}  // namespace pointmorph
