#include "registration/unfolding.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "pointmorph/base/parallel.hpp"
#include "pointmorph/cloud/cloud.hpp"
#include "pointmorph/surface/projection.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kAround = 16;    // points that a Jacobian is fitted to
constexpr std::size_t kRing = 8;       // points that one step outward reaches
constexpr Index kFewestAround = 6;     // of these on the point's side
constexpr double kOneSide = 0.5;       // cosine between normals
constexpr double kNearlyALine = 1e-4;  // determinant over squared trace
constexpr double kMostFolded = 0.1;    // share of the points; more is no fold
constexpr int kTries = 4, kFirstRings = 2, kSweeps = 24;
constexpr double kSweep = 0.8;  // of the way to where a point belongs
constexpr double kNeighborsDone = 0.5;

/// What a map does around a point.
struct Around {
    Vector3 normal = Vector3::Zero();  ///< of the image, along the map's turn; 0: unknown
    double energy = 0.0;               ///< mean squared stretch of edges
    double longest = 0.0;              ///< largest squared stretch
};

/// A group of points that is moved as a whole or not at all, before and after.
struct Group {
    Index folded_before = 0, folded = 0, points = 0;
    double energy_before = 0.0, energy = 0.0;
    double longest_before = 0.0, longest = 0.0;

    bool is_better() const {
        constexpr double kNoTear = 4.0;  // times the mean squared stretch
        return folded < folded_before && energy <= energy_before &&
               longest <= std::max(longest_before, kNoTear * energy_before / points);
    }
};

/// The steps from a point to its neighbors on its side of the surface, in its tangent plane.
struct Steps {
    std::array<Index, kAround> rows;
    std::array<Eigen::Vector2d, kAround> flat;
    std::array<double, kAround> lengths;  ///< squared, of the straight step
    std::size_t count = 0;
};

class Unfolding {
public:
    Unfolding(LandedImages& images, const UnfoldingCloud& here, const UnfoldingCloud& there,
              std::span<const std::uint8_t> held, double normal_weight, Progress& progress)
        : images_(images),
          here_(here),
          there_(there),
          held_(held),
          normal_weight_(normal_weight),
          progress_(progress) {
        if (!here_.nearest || here_.nearest->size() != here_.tree.size() ||
            (here_.tree.size() > 0 && (*here_.nearest)[0].size() < kAround)) {
            const Progress::Part part(progress_, 0.0, kNeighborsDone);
            here_.nearest = &own_.emplace(
                nearest_neighbors(here_.tree, static_cast<Index>(kAround), progress_));
        }
    }

    std::vector<Index> run();

private:
    Steps steps(Index i) const;
    Around around(Index i, const Positions& positions) const;
    bool is_folded(const Around& around, Index anchor) const {
        return around.normal.dot(there_.normals.row(anchor)) < 0.0;
    }
    std::vector<Index> grown(std::vector<Index> rows, int rings) const;
    void find_folded(std::span<const Index> rows);
    void smooth(std::span<const Index> rows);
    Index anchor_of(Index i) const;
    LandedImages landed(std::span<const Index> rows) const;
    LandedImages images_of(std::span<const Index> rows) const;
    void put(std::span<const Index> rows, const LandedImages& images);
    ConnectedComponents groups_of(std::span<const Index> judged) const;
    void move(std::span<const Index> folded, int rings, std::vector<std::uint8_t>& moved);

    LandedImages& images_;
    UnfoldingCloud here_;
    const UnfoldingCloud& there_;
    std::span<const std::uint8_t> held_;
    double normal_weight_;
    Progress& progress_;
    std::optional<Neighborhoods> own_;
    std::vector<std::uint8_t> folded_;
};

Steps Unfolding::steps(Index i) const {
    const Positions& places = here_.tree.points();
    const Vector3 normal = here_.normals.row(i).transpose();
    const Vector3 right = normal.unitOrthogonal(), up = normal.cross(right);
    Steps found;
    const auto near = (*here_.nearest)[i];
    for (const Index j : near.first(std::min(near.size(), kAround))) {
        if (!(here_.normals.row(j).dot(here_.normals.row(i)) > kOneSide)) continue;
        const Vector3 step = (places.row(j) - places.row(i)).transpose();
        const double squared = step.squaredNorm();
        if (!(squared > 0.0)) continue;
        found.rows[found.count] = j;
        found.flat[found.count] = {step.dot(right), step.dot(up)};
        found.lengths[found.count++] = squared;
    }
    return found;
}

Around Unfolding::around(Index i, const Positions& positions) const {
    Around found;
    const Steps near = steps(i);
    double aa = 0.0, ab = 0.0, bb = 0.0;
    Vector3 along_a = Vector3::Zero(), along_b = Vector3::Zero();
    for (std::size_t k = 0; k < near.count; ++k) {
        const Vector3 there = (positions.row(near.rows[k]) - positions.row(i)).transpose();
        const double x = near.flat[k].x(), y = near.flat[k].y();
        const double stretch = there.squaredNorm() / near.lengths[k];
        found.energy += stretch / static_cast<double>(near.count);
        found.longest = std::max(found.longest, stretch);
        aa += x * x;
        ab += x * y;
        bb += y * y;
        along_a += x * there;
        along_b += y * there;
    }
    const double determinant = aa * bb - ab * ab;
    if (to_index(near.count) < kFewestAround ||
        !(determinant > kNearlyALine * (aa + bb) * (aa + bb)))
        return found;
    const Vector3 to_a = (bb * along_a - ab * along_b) / determinant;
    const Vector3 to_b = (aa * along_b - ab * along_a) / determinant;
    const Vector3 normal = to_a.cross(to_b);
    const double length = normal.norm();
    if (length > 0.0) found.normal = normal / length;
    return found;
}

/// The rows, and those that they reach along their side of the surface; ascending.
std::vector<Index> Unfolding::grown(std::vector<Index> rows, int rings) const {
    for (int ring = 0; ring < rings; ++ring) {
        const std::size_t count = rows.size();
        for (std::size_t k = 0; k < count; ++k) {
            const Index i = rows[k];
            const auto near = (*here_.nearest)[i];
            for (const Index j : near.first(std::min(near.size(), kRing)))
                if (here_.normals.row(j).dot(here_.normals.row(i)) > kOneSide) rows.push_back(j);
        }
        std::ranges::sort(rows);
        rows.erase(std::ranges::unique(rows).begin(), rows.end());
    }
    return rows;
}

void Unfolding::find_folded(std::span<const Index> rows) {
    parallel_for(to_index(rows.size()), progress_, [&](Index begin, Index end) {
        for (Index k = begin; k < end; ++k) {
            const auto i = to_size(rows[to_size(k)]);
            folded_[i] = is_folded(around(rows[to_size(k)], images_.positions), images_.anchors[i]);
        }
    });
}

/// A point's image as shares of its neighbors' images: an affine fit, evaluated at the point.
struct Shares {
    std::array<Index, kAround> rows;
    std::array<double, kAround> shares;
    std::size_t count = 0;

    explicit Shares(const Steps& near);
    Eigen::RowVector3d of(const Positions& positions) const {
        Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
        for (std::size_t n = 0; n < count; ++n) sum += shares[n] * positions.row(rows[n]);
        return sum;
    }
};

/// None where there are too few.
Shares::Shares(const Steps& near) {
    constexpr double kFloor = 0.05, kRidge = 1e-3;
    if (to_index(near.count) < kFewestAround) return;
    const double reach = *std::max_element(
        near.lengths.begin(), near.lengths.begin() + static_cast<std::ptrdiff_t>(near.count));
    const double unit = 1.0 / std::sqrt(reach);
    std::array<double, kAround> weights;
    std::array<Vector3, kAround> terms;
    Matrix3 normal = Matrix3::Zero();
    double sum = 0.0, total = 0.0;
    for (std::size_t n = 0; n < near.count; ++n) {
        weights[n] = 1.0 / (near.lengths[n] + kFloor * reach);
        terms[n] = {1.0, unit * near.flat[n].x(), unit * near.flat[n].y()};
        normal += weights[n] * terms[n] * terms[n].transpose();
        sum += weights[n];
    }
    // Slopes are damped where there is no width to tell them.
    normal(1, 1) += kRidge * sum;
    normal(2, 2) += kRidge * sum;
    const Vector3 at_point = normal.inverse().row(0).transpose();
    for (std::size_t n = 0; n < near.count; ++n) {
        shares[n] = weights[n] * at_point.dot(terms[n]);
        total += shares[n];
    }
    if (!(total > 0.0)) return;
    rows = near.rows;
    count = near.count;
    for (std::size_t n = 0; n < count; ++n) shares[n] /= total;
}

/// Moves the rows' images to where their neighbors' say that they belong, again and again; every
/// sweep starts from where all were after the one before.
void Unfolding::smooth(std::span<const Index> rows) {
    std::vector<Shares> shares;
    shares.reserve(rows.size());
    for (const Index i : rows) shares.emplace_back(steps(i));
    Positions& now = images_.positions;
    Positions next(static_cast<Eigen::Index>(rows.size()), 3);
    for (int sweep = 0; sweep < kSweeps; ++sweep) {
        progress_.throw_if_cancelled();
        for (std::size_t k = 0; k < rows.size(); ++k) {
            const auto before = now.row(rows[k]);
            auto after = next.row(static_cast<Eigen::Index>(k));
            after = before;
            if (shares[k].count > 0) after += kSweep * (shares[k].of(now) - before);
        }
        for (std::size_t k = 0; k < rows.size(); ++k)
            now.row(rows[k]) = next.row(static_cast<Eigen::Index>(k));
    }
}

/// The sample near a row's image that faces most like it.
Index Unfolding::anchor_of(Index i) const {
    std::array<Index, kRing> near;
    std::array<double, kRing> squared;
    const Vector3 normal = around(i, images_.positions).normal;
    Index best = images_.anchors[to_size(i)];
    if (!(normal.squaredNorm() > 0.0)) return best;
    const auto found = to_size(there_.tree.nearest(images_.positions.row(i).data(), near, squared));
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < found; ++k) {
        const double away =
            squared[k] + normal_weight_ * normal_weight_ *
                             (there_.normals.row(near[k]).transpose() - normal).squaredNorm();
        if (away >= least) continue;
        least = away;
        best = near[k];
    }
    return best;
}

/// The rows' images, put onto the surface again.
LandedImages Unfolding::landed(std::span<const Index> rows) const {
    std::vector<Index> anchors(rows.size());
    parallel_for(to_index(rows.size()), progress_, [&](Index begin, Index end) {
        for (Index k = begin; k < end; ++k) anchors[to_size(k)] = anchor_of(rows[to_size(k)]);
    });
    Positions positions =
        project_onto_surface(gather(images_.positions, rows), anchors, there_.tree, there_.normals,
                             progress_, there_.nearest);
    return {std::move(positions), std::move(anchors)};
}

LandedImages Unfolding::images_of(std::span<const Index> rows) const {
    return {gather(images_.positions, rows), gather(images_.anchors, rows)};
}

void Unfolding::put(std::span<const Index> rows, const LandedImages& images) {
    for (std::size_t k = 0; k < rows.size(); ++k) {
        images_.positions.row(rows[k]) = images.positions.row(static_cast<Eigen::Index>(k));
        images_.anchors[to_size(rows[k])] = images.anchors[k];
    }
}

/// Of ascending rows, those that are neighbors of each other's.
ConnectedComponents Unfolding::groups_of(std::span<const Index> judged) const {
    GrowingComponents joined(to_index(judged.size()));
    for (std::size_t k = 0; k < judged.size(); ++k) {
        const auto near = (*here_.nearest)[judged[k]];
        for (const Index j : near.first(std::min(near.size(), kRing))) {
            const auto found = std::ranges::lower_bound(judged, j);
            if (found != judged.end() && *found == j)
                joined.join(to_index(k), to_index(found - judged.begin()));
        }
    }
    return joined.components();
}

/// Moves what is around folded rows, each group where that makes it better.
void Unfolding::move(std::span<const Index> folded, int rings, std::vector<std::uint8_t>& moved) {
    std::vector<Index> rows = grown({folded.begin(), folded.end()}, rings);
    const std::vector<Index> judged = grown(rows, 1);
    std::erase_if(rows, [&](Index i) { return held_[to_size(i)] != 0; });
    const ConnectedComponents groups = groups_of(judged);
    std::vector<Group> judgment(to_size(groups.count()));
    const auto judge = [&](Index Group::*count, double Group::*energy, double Group::*longest) {
        for (std::size_t k = 0; k < judged.size(); ++k) {
            const Index i = judged[k];
            Group& group = judgment[to_size(groups.label[k])];
            const Around its = around(i, images_.positions);
            group.*count += is_folded(its, images_.anchors[to_size(i)]);
            group.*energy += its.energy;
            group.*longest = std::max(group.*longest, its.longest);
        }
    };
    judge(&Group::folded_before, &Group::energy_before, &Group::longest_before);
    for (const Index label : groups.label) ++judgment[to_size(label)].points;

    const LandedImages before = images_of(rows);
    smooth(rows);
    put(rows, landed(rows));
    judge(&Group::folded, &Group::energy, &Group::longest);
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const auto place = to_size(std::ranges::lower_bound(judged, rows[k]) - judged.begin());
        if (judgment[to_size(groups.label[place])].is_better()) {
            moved[to_size(rows[k])] = 1;
        } else {
            images_.positions.row(rows[k]) = before.positions.row(static_cast<Eigen::Index>(k));
            images_.anchors[to_size(rows[k])] = before.anchors[k];
        }
    }
    find_folded(judged);
}

std::vector<Index> Unfolding::run() {
    const Index count = here_.tree.size();
    std::vector<Index> rows(to_size(count));
    std::iota(rows.begin(), rows.end(), 0);
    folded_.assign(rows.size(), 0);
    {
        const Progress::Part part(progress_, kNeighborsDone, 1.0);
        find_folded(rows);
    }
    std::vector<std::uint8_t> moved(rows.size(), 0);
    const auto marked = [](const std::vector<std::uint8_t>& marks) {
        std::vector<Index> found;
        for (std::size_t i = 0; i < marks.size(); ++i)
            if (marks[i]) found.push_back(to_index(i));
        return found;
    };
    const Progress::Part end(progress_, 1.0, 1.0);  // few points, for an unknown number of times
    for (int attempt = 0; attempt < kTries; ++attempt) {
        const std::vector<Index> folded = marked(folded_);
        if (folded.empty() || static_cast<double>(folded.size()) > kMostFolded * count) break;
        move(folded, kFirstRings + attempt, moved);
    }
    return marked(moved);
}

}  // namespace

std::vector<Index> unfold(LandedImages& images, const UnfoldingCloud& here,
                          const UnfoldingCloud& there, std::span<const std::uint8_t> held,
                          double normal_weight, Progress& progress) {
    if (here.tree.size() <= static_cast<Index>(kAround)) return {};
    return Unfolding(images, here, there, held, normal_weight, progress).run();
}

}  // namespace pointmorph
