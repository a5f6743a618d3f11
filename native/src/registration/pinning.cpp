#include "registration/pinning.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

namespace {

/// How a point is moved by the places around it.
struct Pull {
    Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
    double weights = 0.0, fade = 0.0;
};

/// Where images have a place of a surface, from those of the nearest points on its side; nothing
/// where there are none. `place` is a row of `own`.
class PlaceImage {
public:
    PlaceImage(const Positions& images, const ImagedSurface& surface, const OrientedView& own)
        : images_(images), surface_(surface), own_(own) {}

    /// Writes the image, or returns false.
    bool operator()(Eigen::Index place, Vector3& image) const {
        constexpr std::size_t kAround = 4;
        constexpr double kFloor = 1e-3;  // of a squared spacing
        const auto& [tree, normals, spacing, linear] = surface_;
        std::array<Index, kAround> near;
        std::array<double, kAround> squared;
        const Index found = tree.nearest(own_.positions.row(place).data(), near, squared);
        Vector3 sum = Vector3::Zero();
        double weights = 0.0;
        for (std::size_t n = 0; n < to_size(found); ++n) {
            const Index i = near[n];
            if (normals.row(i).dot(own_.normals.row(place)) <= 0.0) continue;
            const double weight = 1.0 / (squared[n] + kFloor * spacing * spacing);
            sum += weight *
                   (images_.row(i).transpose() +
                    linear(i) * (own_.positions.row(place) - tree.points().row(i)).transpose());
            weights += weight;
        }
        if (!(weights > 0.0)) return false;
        image = sum / weights;
        return true;
    }

private:
    const Positions& images_;
    const ImagedSurface& surface_;
    OrientedView own_;
};

}  // namespace

double largest_offset(const Positions& images, const Positions& other, const MarkedRows& marks) {
    double largest = 0.0;
    for (const IndexPair& f : marks.pairs)
        largest = std::max(largest, (images.row(f.*marks.here) - other.row(f.*marks.there)).norm());
    return largest;
}

Positions pulled_to_marks(Positions images, const CoarseShape& shape, const CoarseShape& other,
                          const MarkedRows& features) {
    constexpr double kReach = 0.15;  // of √area
    std::vector<Eigen::RowVector3d> centers, offsets;
    for (const IndexPair& f : features.pairs) {
        centers.emplace_back(shape.positions.row(f.*features.here));
        offsets.emplace_back(other.positions.row(f.*features.there) - images.row(f.*features.here));
    }
    for (Index k = 0; k < shape.guides.size(); ++k) {
        if (!(shape.guides.weights[k] > 0.0)) continue;
        centers.emplace_back(shape.guides.places.row(k));
        offsets.emplace_back(other.guides.places.row(k) -
                             images.row(shape.guides.coarse_rows[to_size(k)]));
    }
    for (Eigen::Index i = 0; i < images.rows(); ++i) {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        double weights = 0.0;
        for (std::size_t k = 0; k < centers.size(); ++k) {
            const double squared = (shape.positions.row(i) - centers[k]).squaredNorm();
            const double weight = std::exp(-0.5 * squared / (kReach * kReach));
            sum += weight * offsets[k];
            weights += weight;
        }
        images.row(i) += sum / std::max(weights, 1.0);
    }
    return images;
}

Positions pinned_to_marks(Positions images, const Positions& positions, const Positions& other,
                          const MarkedRows& marks, double spacing) {
    constexpr double kReach = 6.0;
    const double squared_reach = kReach * kReach * spacing * spacing;
    for (const IndexPair& f : marks.pairs) {
        const Eigen::RowVector3d offset = other.row(f.*marks.there) - images.row(f.*marks.here);
        const Eigen::RowVector3d center = positions.row(f.*marks.here);
        for (Eigen::Index i = 0; i < images.rows(); ++i) {
            const double ratio = (positions.row(i) - center).squaredNorm() / squared_reach;
            if (ratio < 1.0) images.row(i) += (1.0 - ratio) * (1.0 - ratio) * offset;
        }
    }
    // Marks close to each other have pulled at one another.
    for (const IndexPair& f : marks.pairs) images.row(f.*marks.here) = other.row(f.*marks.there);
    return images;
}

Positions pinned_to_curve(Positions images, const ImagedSurface& surface, const OrientedView& own,
                          const Positions& other, Progress& progress) {
    constexpr Eigen::Index kPoll = 64;
    std::vector<std::pair<Index, double>> ball;
    const PlaceImage image_of(images, surface, own);
    for (const double reach : {6.0, 3.0, 1.5, 1.5}) {
        std::map<Index, Pull> pulls;
        const double radius = reach * surface.spacing;
        for (Eigen::Index k = 0; k < own.positions.rows(); ++k) {
            if (k % kPoll == 0 && !progress.poll()) progress.throw_if_cancelled();
            Vector3 image;
            if (!image_of(k, image)) continue;
            const Eigen::RowVector3d offset = other.row(k) - image.transpose();
            surface.tree.within(own.positions.row(k).data(), radius, ball);
            for (const auto& [i, squared_distance] : ball) {
                if (surface.normals.row(i).dot(own.normals.row(k)) <= 0.0) continue;
                const double fade = std::pow(1.0 - squared_distance / (radius * radius), 2);
                Pull& pull = pulls[i];
                pull.sum += fade * fade * offset;
                pull.weights += fade * fade;
                pull.fade = std::max(pull.fade, fade);
            }
        }
        for (const auto& [i, pull] : pulls)
            if (pull.weights > 0.0) images.row(i) += pull.fade * pull.sum / pull.weights;
    }
    return images;
}

Positions clamped_to_region(Positions images, const Values& members, const KdTree<3>& other,
                            const Values& other_members) {
    constexpr double kMember = 0.5;
    std::vector<Index> inside;
    const double least = kMember * members.maxCoeff();
    const double other_least = kMember * other_members.maxCoeff();
    for (Index j = 0; j < other.size(); ++j)
        if (other_members[j] >= other_least) inside.push_back(j);
    const Positions places = gather(other.points(), inside);
    const KdTree<3> tree(places);
    for (Eigen::Index i = 0; i < images.rows(); ++i) {
        if (members[i] < least) continue;
        Index nearest;
        double squared;
        other.nearest(images.row(i).data(), {&nearest, 1}, {&squared, 1});
        if (other_members[nearest] >= other_least) continue;
        tree.nearest(images.row(i).data(), {&nearest, 1}, {&squared, 1});
        images.row(i) = places.row(nearest);
    }
    return images;
}

}  // namespace pointmorph
