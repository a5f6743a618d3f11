#include "pointmorph/cloud/covariance.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>

#include "base/angle.hpp"
#include "base/grouped.hpp"
#include "cloud/moments.hpp"
#include "cloud/winding_normals.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

/// Whether columns 0 and 2 of `axes` are what they should be, to almost all digits. NaN is not.
bool are_eigenvectors(const Matrix3& matrix, const Matrix3& axes, const Vector3& eigenvalues) {
    constexpr double kTolerance = 1e-12;
    const auto residual = [&](int i) {
        return (matrix * axes.col(i) - eigenvalues[i] * axes.col(i)).norm();
    };
    return residual(0) <= kTolerance * eigenvalues[2] &&
           residual(2) <= kTolerance * eigenvalues[2] &&
           std::abs(axes.col(0).dot(axes.col(2))) <= kTolerance;
}

struct Eigensystem {
    Vector3 values;
    Matrix3 vectors;
};

/// A unit vector that a symmetric matrix of rank 2 takes to zero, and a column, at right angles.
std::pair<Vector3, Vector3> kernel(const Matrix3& matrix) {
    Eigen::Index largest = 0;
    matrix.diagonal().cwiseAbs().maxCoeff(&largest);
    const Vector3 column = matrix.col(largest);
    const Vector3 one = column.cross(matrix.col((largest + 1) % 3));
    const Vector3 other = column.cross(matrix.col((largest + 2) % 3));
    const bool is_longer = one.squaredNorm() > other.squaredNorm();
    return {(is_longer ? one : other).normalized(), column};
}

/// Eigenvalues, ascending, and the vectors of the first and last, in closed form (Smith,
/// Eigenvalues of a symmetric 3 × 3 matrix, 1961). Eigen's own asks the system's library for an
/// arctangent, whose bits differ between systems.
Eigensystem closed_form(const Matrix3& matrix) {
    Eigensystem result{Vector3::Constant(matrix.trace() / 3.0), Matrix3::Identity()};
    Matrix3 rest = matrix;
    rest.diagonal() -= result.values;
    const double scale = rest.cwiseAbs().maxCoeff();
    if (!(scale > 0.0)) return result;
    rest /= scale;
    const double third = rest.squaredNorm() / 6.0, half = 0.5 * rest.determinant();
    const double sine = std::sqrt(std::max(0.0, third * third * third - half * half));
    const double angle = angle_of(sine, half) / 3.0, radius = std::sqrt(third);
    const double along = radius * std::cos(angle);
    const double across = std::sqrt(3.0) * radius * std::sin(angle);
    const Vector3 values(-along - across, across - along, 2.0 * along);
    result.values += scale * values;

    // First the vector of the value that is farther from the middle one.
    const double to_first = values[1] - values[0], to_last = values[2] - values[1];
    const int far = to_last > to_first ? 2 : 0, near = 2 - far;
    const auto without = [&](int i) -> Matrix3 { return rest - values[i] * Matrix3::Identity(); };
    const auto [axis, at_right_angles] = kernel(without(far));
    result.vectors.col(far) = axis;
    constexpr double kSame = 2.0 * std::numeric_limits<double>::epsilon();
    const bool is_double = std::min(to_first, to_last) <= kSame * std::max(to_first, to_last);
    result.vectors.col(near) =
        is_double ? Vector3((at_right_angles - axis * axis.dot(at_right_angles)).normalized())
                  : kernel(without(near)).first;
    return result;
}

}  // namespace

PrincipalAxes principal_axes(const Matrix3& covariance) {
    PrincipalAxes result{Vector3::Zero(), Matrix3::Identity()};
    const double scale = covariance.diagonal().maxCoeff();
    if (!(scale > 0.0)) return result;
    const Matrix3 unit = covariance / scale;  // residuals of tiny matrices would underflow
    // The closed form is several times faster, but loses half of the digits where two eigenvalues
    // almost agree.
    const Eigensystem found = closed_form(unit);
    result.axes = are_eigenvectors(unit, found.vectors, found.values)
                      ? found.vectors
                      : Matrix3(Eigen::SelfAdjointEigenSolver<Matrix3>(unit).eigenvectors());
    result.axes.col(1) = result.axes.col(2).cross(result.axes.col(0));
    // Rayleigh quotients have twice the digits of the vectors.
    for (int i = 0; i < 3; ++i)
        result.eigenvalues[i] =
            scale * std::max(0.0, result.axes.col(i).dot(unit * result.axes.col(i)));
    std::ranges::sort(result.eigenvalues);  // equal ones may differ by rounding
    return result;
}

LocalFrame local_frame(const Positions& positions, std::span<const Index> rows) {
    if (rows.empty()) return {Vector3::Zero(), Vector3::Zero(), Matrix3::Identity()};
    Moments moments(positions.row(rows.front()).transpose());
    for (const Index row : rows) moments.add(positions.row(row).transpose());
    const PrincipalAxes axes = principal_axes(moments.covariance());
    return {moments.mean(), axes.eigenvalues, axes.axes};
}

Covariance covariance_analysis(const Positions& positions, const Neighborhoods& neighborhoods,
                               Progress& progress) {
    const Index count = neighborhoods.size();
    Covariance result{Normals(count, 3), Values(count)};
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) {
            const Vector3 point = positions.row(i);
            Moments moments(point);
            moments.add(point);
            for (const Index j : neighborhoods[i]) moments.add(positions.row(j).transpose());
            const PrincipalAxes axes = principal_axes(moments.covariance());
            const double total = axes.eigenvalues.sum();
            result.normals.row(i) = axes.axes.col(0);
            result.variation[i] = total > 0.0 ? axes.eigenvalues[0] / total : 0.0;
        }
    });
    return result;
}

namespace {

/// What an edge between two points says about their normals.
struct Agreement {
    /// Of n' with what n becomes along the arc of a circle from p to p': n mirrored in the plane
    /// half-way. Along flat edges that is n·n' (Hoppe et al. 1992); round a corner it turns with
    /// the surface, and from one side of a thin sheet to the other it asks for opposite normals.
    double cosine;
    double doubt;  ///< 0 (certain) to 1; edges that leave the tangent planes are doubtful
};
Agreement agreement(const Vector3& p, const Vector3& n, const Vector3& p2, const Vector3& n2) {
    const Vector3 edge = p2 - p;
    const double squared_length = edge.squaredNorm();
    double cosine = n.dot(n2), along = 1.0;
    if (squared_length > std::numeric_limits<double>::min()) {  // else they coincide
        const double rise = edge.dot(n), rise2 = edge.dot(n2);
        cosine -= 2.0 * rise * rise2 / squared_length;
        along = (1.0 - rise * rise / squared_length) * (1.0 - rise2 * rise2 / squared_length);
    }
    return {cosine, std::sqrt(std::clamp(1.0 - cosine * cosine * along, 0.0, 1.0))};
}

/// Trees over rows, in which each row knows whether its sign is the same as its root's.
class SignedForest {
public:
    explicit SignedForest(Index count) : links_(to_size(count)) {
        for (std::size_t i = 0; i < links_.size(); ++i) links_[i] = static_cast<Link>(2 * i);
    }

    struct Root {
        Index row;
        bool flipped;  ///< against the row that was asked for
    };

    Root root(Index row) {
        auto i = to_size(row);
        Link flipped = 0;
        for (Link up = links_[i]; (up >> 1) != i; up = links_[i]) {
            links_[i] = links_[up >> 1] ^ (up & 1);  // halves the path for the next time
            flipped ^= links_[i] & 1;
            i = links_[i] >> 1;
        }
        return {to_index(i), flipped != 0};
    }

    /// Hangs the higher root below the lower one.
    void join(const Root& a, const Root& b, bool flipped) {
        const Link parent = static_cast<Link>(std::min(a.row, b.row));
        links_[to_size(std::max(a.row, b.row))] =
            2 * parent + static_cast<Link>(a.flipped ^ b.flipped ^ flipped);
    }

private:
    using Link = std::uint32_t;  // 2 · parent, + 1 where the sign differs from the parent's
    std::vector<Link> links_;
};

/// Makes the signs of `normals` agree over each component by a minimum spanning tree (Kruskal,
/// edges sorted by counting). Returns the component of every row.
std::vector<Index> make_consistent(const Positions& positions, const Neighborhoods& neighborhoods,
                                   Normals& normals, Progress& progress) {
    using Key = std::uint16_t;
    constexpr double kKeys = 4096;
    constexpr Key kTwin = kKeys;  // an edge whose other direction is a neighbor too
    const auto edge_agreement = [&](Index i, Index j) {
        return agreement(positions.row(i), normals.row(i), positions.row(j), normals.row(j));
    };
    const Index count = neighborhoods.size();
    std::vector<Key> keys(neighborhoods.indices.size());
    parallel_for(
        count, progress,
        [&](Index begin, Index end) {
            auto key = keys.begin() + neighborhoods.offsets[to_size(begin)];
            for (Index i = begin; i < end; ++i)
                for (const Index j : neighborhoods[i]) {
                    const auto back = neighborhoods[j];
                    const bool twin = j < i && std::ranges::find(back, i) != back.end();
                    *key++ =
                        twin ? kTwin : static_cast<Key>(edge_agreement(i, j).doubt * (kKeys - 1));
                }
        },
        0.0, 0.3);

    std::vector<std::size_t> next(to_size(kTwin) + 1, 0);
    for (const Key key : keys)
        if (key != kTwin) ++next[key + 1u];
    std::partial_sum(next.begin(), next.end(), next.begin());
    std::vector<std::pair<Index, Index>> edges(next.back());
    auto key = keys.begin();
    for (Index i = 0; i < count; ++i)
        for (const Index j : neighborhoods[i])
            if (const Key k = *key++; k != kTwin) edges[next[k]++] = {i, j};
    keys = {};

    SignedForest forest(count);
    Index trees = count;
    for (std::size_t e = 0; e < edges.size() && trees > 1; ++e) {
        const auto [i, j] = edges[e];
        const auto a = forest.root(i), b = forest.root(j);
        if (a.row != b.row) {
            forest.join(a, b, edge_agreement(i, j).cosine < 0.0);
            --trees;
        }
        if (e % 65536 == 0)
            progress.report(0.3 + 0.6 * static_cast<double>(e) / static_cast<double>(edges.size()));
    }

    std::vector<Index> component(to_size(count));
    for (Index i = 0; i < count; ++i) {
        const auto root = forest.root(i);
        component[to_size(i)] = root.row;
        if (root.flipped) normals.row(i) *= -1.0;
    }
    return component;
}

/// Sums over one component with consistent normals.
struct Shape {
    double area = 0.0;
    Vector3 centroid = Vector3::Zero();
    Vector3 vector_area = Vector3::Zero();  ///< ∫ n dA; 0 for a closed surface
    double flux = 0.0;                      ///< ∫ (p − centroid)·n dA; 3 × volume if closed
    double size = 0.0;                      ///< ∫ ‖p − centroid‖ dA

    bool faces_inwards() const {
        // An open patch that bulges less than this says nothing about its outside.
        constexpr double kFlat = 0.01;
        if (std::abs(flux) * area >= kFlat * size * vector_area.norm()) return flux < 0.0;
        // Upward, else to the back, else to the right: the first that is clearly so.
        for (const int axis : {2, 1, 0})
            if (std::abs(vector_area[axis]) > 0.99 * vector_area.cwiseAbs().maxCoeff())
                return vector_area[axis] < 0.0;
        return false;
    }
};

}  // namespace

void orient_normals(const Positions& positions, const Neighborhoods& neighborhoods,
                    Normals& normals, Progress& progress) {
    Normals oriented = normals;
    const std::vector<Index> component =
        make_consistent(positions, neighborhoods, oriented, progress);

    const Index count = neighborhoods.size();
    std::vector<Shape> shapes(component.size());  // at the component's root
    const auto shape_of = [&](Index i) -> Shape& { return shapes[to_size(component[to_size(i)])]; };
    Values areas = Values::Zero(count);
    for (Index i = 0; i < count; ++i) {
        const auto near = neighborhoods[i];
        for (const Index j : near)
            areas[i] = std::max(areas[i], (positions.row(j) - positions.row(i)).squaredNorm());
        if (!near.empty()) areas[i] /= static_cast<double>(near.size());
        auto& shape = shape_of(i);
        shape.area += areas[i];
        shape.centroid += areas[i] * positions.row(i).transpose();
        shape.vector_area += areas[i] * oriented.row(i).transpose();
    }
    for (auto& shape : shapes)
        if (shape.area > 0.0) shape.centroid /= shape.area;
    for (Index i = 0; i < count; ++i) {
        auto& shape = shape_of(i);
        const Vector3 arm = positions.row(i).transpose() - shape.centroid;
        shape.flux += areas[i] * arm.dot(oriented.row(i).transpose());
        shape.size += areas[i] * arm.norm();
    }
    for (Index i = 0; i < count; ++i)
        if (shape_of(i).faces_inwards()) oriented.row(i) *= -1.0;
    {
        const Progress::Part part(progress, 0.9, 1.0);
        const Grouped<Index> rows(count, [&](auto&& take) {
            for (Index i = 0; i < count; ++i) take(component[to_size(i)], i);
        });
        constexpr double kOpen = 0.5;  // a half sphere: no inside to be told
        Index done = 0;
        for (Index root = 0; root < count; ++root) {
            const auto& shape = shapes[to_size(root)];
            const auto end = done + to_index(rows[root].size());
            if (shape.vector_area.norm() < kOpen * shape.area) {
                const Progress::Part its(progress, static_cast<double>(done) / count,
                                         static_cast<double>(end) / count);
                orient_by_winding(positions, rows[root], oriented, progress);
            }
            done = end;
        }
    }
    progress.report(1.0);
    normals = std::move(oriented);
}

}  // namespace pointmorph
