#include "pointmorph/cloud/similarity.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <vector>

#include "base/compiler.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr double kResidual = 1e-12;  // of a unit eigenvector

/// A trace of the identity: among rotations that do equally well, the least.
constexpr double kLeastTurn = 1e-12;

/// The unit eigenvector of the largest eigenvalue of `k`, which belongs to the covariance `c`, by
/// Newton's method on the characteristic polynomial (Horn 1987, section 4.C) and a column of the
/// adjugate. Nothing where the two largest eigenvalues lie too close for that.
std::optional<Eigen::Vector4d> clear_eigenvector(const Eigen::Matrix4d& k, const Matrix3& c,
                                                 double& eigenvalue) {
    const double square = c.squaredNorm(), size = std::sqrt(square);
    if (!(square > 1e-280 && square < 1e280)) return std::nullopt;
    // λ⁴ − 2 |C|² λ² − 8 det(C) λ + det(K), in units of |C|; from above, where it is convex.
    const Eigen::Matrix4d unit = k / size;
    const double linear = -8.0 * (c / size).determinant(), constant = unit.determinant();
    double x = std::sqrt(3.0);
    constexpr int kMostSteps = 12;
    for (int step = 0; step < kMostSteps; ++step) {
        const double slope = (4.0 * x * x - 4.0) * x + linear;
        if (!(slope > 1e-3)) return std::nullopt;  // a double root is near
        const double down = (((x * x - 2.0) * x + linear) * x + constant) / slope;
        x -= down;
        if (std::abs(down) < 1e-13) break;
    }
    const Eigen::Matrix4d m = unit - x * Eigen::Matrix4d::Identity();
    // Rows of the adjugate from the 2 × 2 minors of the upper and of the lower two rows.
    const auto minor2 = [&m](int row, int i, int j) {
        return m(row, i) * m(row + 1, j) - m(row, j) * m(row + 1, i);
    };
    const double s0 = minor2(0, 0, 1), s1 = minor2(0, 0, 2), s2 = minor2(0, 0, 3),
                 s3 = minor2(0, 1, 2), s4 = minor2(0, 1, 3), s5 = minor2(0, 2, 3);
    const double c0 = minor2(2, 0, 1), c1 = minor2(2, 0, 2), c2 = minor2(2, 0, 3),
                 c3 = minor2(2, 1, 2), c4 = minor2(2, 1, 3), c5 = minor2(2, 2, 3);
    Eigen::Matrix4d adjugate;
    adjugate << m(1, 1) * c5 - m(1, 2) * c4 + m(1, 3) * c3,
        -m(0, 1) * c5 + m(0, 2) * c4 - m(0, 3) * c3, m(3, 1) * s5 - m(3, 2) * s4 + m(3, 3) * s3,
        -m(2, 1) * s5 + m(2, 2) * s4 - m(2, 3) * s3,  //
        -m(1, 0) * c5 + m(1, 2) * c2 - m(1, 3) * c1, m(0, 0) * c5 - m(0, 2) * c2 + m(0, 3) * c1,
        -m(3, 0) * s5 + m(3, 2) * s2 - m(3, 3) * s1, m(2, 0) * s5 - m(2, 2) * s2 + m(2, 3) * s1,  //
        m(1, 0) * c4 - m(1, 1) * c2 + m(1, 3) * c0, -m(0, 0) * c4 + m(0, 1) * c2 - m(0, 3) * c0,
        m(3, 0) * s4 - m(3, 1) * s2 + m(3, 3) * s0, -m(2, 0) * s4 + m(2, 1) * s2 - m(2, 3) * s0,  //
        -m(1, 0) * c3 + m(1, 1) * c1 - m(1, 2) * c0, m(0, 0) * c3 - m(0, 1) * c1 + m(0, 2) * c0,
        -m(3, 0) * s3 + m(3, 1) * s1 - m(3, 2) * s0, m(2, 0) * s3 - m(2, 1) * s1 + m(2, 2) * s0;
    int column;
    adjugate.diagonal().cwiseAbs().maxCoeff(&column);
    Eigen::Vector4d q = adjugate.col(column);
    q.normalize();
    if (!((m * q).squaredNorm() < kResidual * kResidual)) return std::nullopt;
    eigenvalue = x * size;
    return q;
}

/// Entries of several matrices side by side, row by row.
template <std::size_t kCount>
using NineOf = std::array<std::array<double, kCount>, 9>;

/// Rotations, and whether they were found.
template <std::size_t kCount>
struct Rotations {
    NineOf<kCount> rotation;
    std::array<double, kCount> trace;
    std::array<bool, kCount> is_clear;
};

template <class Numbers>
constexpr std::size_t kCountOf = sizeof(Numbers) / sizeof(double);

template <class Numbers>
POINTMORPH_INLINE void take_roots(Numbers& numbers) {
    std::array<double, kCountOf<Numbers>> each;
    std::memcpy(each.data(), &numbers, sizeof numbers);
    for (double& number : each) number = std::sqrt(number);
    std::memcpy(&numbers, each.data(), sizeof numbers);
}

template <class Mask>
POINTMORPH_INLINE std::array<bool, kCountOf<Mask>> each_of(const Mask& mask) {
    std::array<std::int64_t, kCountOf<Mask>> numbers;
    std::memcpy(numbers.data(), &mask, sizeof mask);
    std::array<bool, kCountOf<Mask>> result;
    for (std::size_t k = 0; k < result.size(); ++k) result[k] = numbers[k] != 0;
    return result;
}

/// A symmetric 4 × 4 matrix with its 2 × 2 minors of the upper and of the lower two rows.
template <class Numbers>
struct WithMinors {
    Numbers m[4][4], upper[6], lower[6];

    POINTMORPH_INLINE void find_minors() {
        constexpr int kColumns[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
        for (int k = 0; k < 6; ++k) {
            const auto [i, j] = kColumns[k];
            upper[k] = m[0][i] * m[1][j] - m[0][j] * m[1][i];
            lower[k] = m[2][i] * m[3][j] - m[2][j] * m[3][i];
        }
    }
    /// Of the adjugate, the column of the largest diagonal.
    POINTMORPH_INLINE void largest_column(Numbers (&q)[4]) const {
        const auto &s = upper, &c = lower;
        Numbers a[4][4];
        a[0][0] = m[1][1] * c[5] - m[1][2] * c[4] + m[1][3] * c[3];
        a[0][1] = -m[0][1] * c[5] + m[0][2] * c[4] - m[0][3] * c[3];
        a[0][2] = m[3][1] * s[5] - m[3][2] * s[4] + m[3][3] * s[3];
        a[0][3] = -m[2][1] * s[5] + m[2][2] * s[4] - m[2][3] * s[3];
        a[1][1] = m[0][0] * c[5] - m[0][2] * c[2] + m[0][3] * c[1];
        a[1][2] = -m[3][0] * s[5] + m[3][2] * s[2] - m[3][3] * s[1];
        a[1][3] = m[2][0] * s[5] - m[2][2] * s[2] + m[2][3] * s[1];
        a[2][2] = m[3][0] * s[4] - m[3][1] * s[2] + m[3][3] * s[0];
        a[2][3] = -m[2][0] * s[4] + m[2][1] * s[2] - m[2][3] * s[0];
        a[3][3] = m[2][0] * s[3] - m[2][1] * s[1] + m[2][2] * s[0];
        for (int i = 1; i < 4; ++i)
            for (int j = 0; j < i; ++j) a[i][j] = a[j][i];
        Numbers most = a[0][0] < Numbers{} ? -a[0][0] : a[0][0];
        for (int i = 0; i < 4; ++i) q[i] = a[0][i];
        for (int k = 1; k < 4; ++k) {
            const Numbers size = a[k][k] < Numbers{} ? -a[k][k] : a[k][k];
            const auto is_more = size > most;
            most = is_more ? size : most;
            for (int i = 0; i < 4; ++i) q[i] = is_more ? a[k][i] : q[i];
        }
    }
};

/// Unit quaternions as rotations.
template <class Numbers>
POINTMORPH_INLINE void turn_by(const Numbers (&q)[4], NineOf<kCountOf<Numbers>>& rotation) {
    const Numbers one = Numbers{} + 1.0;
    const Numbers x = 2.0 * q[1], y = 2.0 * q[2], z = 2.0 * q[3];
    const Numbers wx = x * q[0], wy = y * q[0], wz = z * q[0], xx = x * q[1], xy = y * q[1],
                  xz = z * q[1], yy = y * q[2], yz = z * q[2], zz = z * q[3];
    const Numbers entries[9] = {one - (yy + zz), xy - wz, xz + wy, xy + wz,        one - (xx + zz),
                                yz - wx,         xz - wy, yz + wx, one - (xx + yy)};
    for (std::size_t k = 0; k < 9; ++k)
        std::memcpy(rotation[k].data(), &entries[k], sizeof entries[k]);
}

/// clear_eigenvector() of several covariances side by side.
template <class Numbers>
POINTMORPH_INLINE void fit_several(const NineOf<kCountOf<Numbers>>& covariances,
                                   Rotations<kCountOf<Numbers>>& found) {
    const Numbers one = Numbers{} + 1.0;
    Numbers u[9], square{};
    for (std::size_t k = 0; k < 9; ++k) {
        std::memcpy(&u[k], covariances[k].data(), sizeof u[k]);
        square += u[k] * u[k];
    }
    auto is_clear = (square > Numbers{} + 1e-280) & (square < Numbers{} + 1e280);
    Numbers size = is_clear ? square : one;
    take_roots(size);
    const Numbers over = one / size;
    for (Numbers& entry : u) entry *= over;
    const Numbers linear =
        -8.0 * (u[0] * (u[4] * u[8] - u[5] * u[7]) - u[1] * (u[3] * u[8] - u[5] * u[6]) +
                u[2] * (u[3] * u[7] - u[4] * u[6]));
    WithMinors<Numbers> k;
    const Numbers diagonal[4] = {u[0] + u[4] + u[8], u[0] - u[4] - u[8], u[4] - u[0] - u[8],
                                 u[8] - u[0] - u[4]};
    for (int i = 0; i < 4; ++i) k.m[i][i] = diagonal[i];
    k.m[0][1] = k.m[1][0] = u[7] - u[5];
    k.m[0][2] = k.m[2][0] = u[2] - u[6];
    k.m[0][3] = k.m[3][0] = u[3] - u[1];
    k.m[1][2] = k.m[2][1] = u[1] + u[3];
    k.m[1][3] = k.m[3][1] = u[2] + u[6];
    k.m[2][3] = k.m[3][2] = u[5] + u[7];
    k.find_minors();
    const auto &s = k.upper, &c = k.lower;
    const Numbers constant =
        s[0] * c[5] - s[1] * c[4] + s[2] * c[3] + s[3] * c[2] - s[4] * c[1] + s[5] * c[0];
    Numbers x = Numbers{} + std::sqrt(3.0);
    auto goes_on = is_clear;
    constexpr int kMostSteps = 12;
    for (int step = 0; step < kMostSteps; ++step) {
        const Numbers slope = (4.0 * x * x - 4.0) * x + linear;
        const auto is_steep = slope > Numbers{} + 1e-3;  // else a double root is near
        is_clear &= is_steep | ~goes_on;
        goes_on &= is_steep;
        const Numbers down =
            (((x * x - 2.0) * x + linear) * x + constant) / (is_steep ? slope : one);
        x -= goes_on ? down : Numbers{};
        goes_on &= (down > Numbers{} + 1e-13) | (down < Numbers{} - 1e-13);
        if (each_of(goes_on) == std::array<bool, kCountOf<Numbers>>{}) break;
    }
    for (int i = 0; i < 4; ++i) k.m[i][i] = diagonal[i] - x;
    k.find_minors();
    Numbers q[4], left{};
    k.largest_column(q);
    Numbers length = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    is_clear &= length > Numbers{} + 1e-300;
    length = is_clear ? length : one;
    take_roots(length);
    for (Numbers& part : q) part /= length;
    for (int i = 0; i < 4; ++i) {
        const Numbers off =
            k.m[i][0] * q[0] + k.m[i][1] * q[1] + k.m[i][2] * q[2] + k.m[i][3] * q[3];
        left += off * off;
    }
    is_clear &= left < Numbers{} + kResidual * kResidual;
    turn_by(q, found.rotation);
    const Numbers trace = x * size;
    std::memcpy(found.trace.data(), &trace, sizeof trace);
    found.is_clear = each_of(is_clear);
}

void fit_plainly(const NineOf<4>& covariances, Rotations<4>& found) {
    fit_several<Four>(covariances, found);
}

POINTMORPH_WIDE void fit_wide(const NineOf<4>& covariances, Rotations<4>& found) {
    fit_several<Four>(covariances, found);
}

POINTMORPH_WIDEST void fit_widest(const NineOf<kCountOf<Eight>>& covariances,
                                  Rotations<kCountOf<Eight>>& found) {
    fit_several<Eight>(covariances, found);
}

template <std::size_t kCount>
void fit_by(void (*fit)(const NineOf<kCount>&, Rotations<kCount>&),
            std::span<const Matrix3> covariances, std::span<BestRotation> best) {
    NineOf<kCount> some;
    Rotations<kCount> found;
    for (std::size_t first = 0; first < covariances.size(); first += kCount) {
        const std::size_t count = std::min(kCount, covariances.size() - first);
        for (std::size_t n = 0; n < kCount; ++n) {
            const Matrix3& c = covariances[first + std::min(n, count - 1)];
            for (std::size_t k = 0; k < 9; ++k)
                some[k][n] = c(static_cast<Eigen::Index>(k / 3), static_cast<Eigen::Index>(k % 3));
        }
        fit(some, found);
        for (std::size_t n = 0; n < count; ++n) {
            BestRotation& its = best[first + n];
            if (!found.is_clear[n]) {
                its = best_rotation(covariances[first + n]);
                continue;
            }
            for (std::size_t k = 0; k < 9; ++k)
                its.rotation(static_cast<Eigen::Index>(k / 3), static_cast<Eigen::Index>(k % 3)) =
                    found.rotation[k][n];
            its.trace = found.trace[n];
        }
    }
}

}  // namespace

BestRotation best_rotation(const Matrix3& covariance) {
    // tr(R(q)ᵀ C) = qᵀ K q for a unit quaternion q = (w, x, y, z).
    const Matrix3& c = covariance;
    Eigen::Matrix4d k;
    k << c(0, 0) + c(1, 1) + c(2, 2), c(2, 1) - c(1, 2), c(0, 2) - c(2, 0), c(1, 0) - c(0, 1),  //
        0, c(0, 0) - c(1, 1) - c(2, 2), c(0, 1) + c(1, 0), c(0, 2) + c(2, 0),                   //
        0, 0, c(1, 1) - c(0, 0) - c(2, 2), c(1, 2) + c(2, 1),                                   //
        0, 0, 0, c(2, 2) - c(0, 0) - c(1, 1);
    k.triangularView<Eigen::StrictlyLower>() = k.transpose();
    const auto rotation = [](const Eigen::Vector4d& q) {
        return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
    };
    double trace;
    if (const auto q = clear_eigenvector(k, c, trace)) return {rotation(*q), trace};
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(k);
    return {rotation(solver.eigenvectors().col(3)), solver.eigenvalues()[3]};
}

void best_rotations(std::span<const Matrix3> covariances, std::span<BestRotation> best) {
    if (has_widest_registers())
        fit_by(fit_widest, covariances, best);
    else
        fit_by(has_wide_registers() ? fit_wide : fit_plainly, covariances, best);
}

Positions Similarity::apply(const Positions& positions) const {
    return (positions * (scale * rotation).transpose()).rowwise() + translation.transpose();
}

Normals Similarity::rotated(const Normals& normals) const {
    return normals * rotation.transpose();
}

Similarity Similarity::inverse() const {
    return {1.0 / scale, rotation.transpose(), -(rotation.transpose() * translation) / scale};
}

Similarity fit_similarity(const Positions& from, const Positions& to) {
    Similarity result;
    if (from.rows() == 0) return result;
    const Eigen::RowVector3d from_mean = from.colwise().mean(), to_mean = to.colwise().mean();
    const Positions x = from.rowwise() - from_mean, y = to.rowwise() - to_mean;
    const double from_size = x.squaredNorm(), to_size = y.squaredNorm();
    if (from_size > 0.0 && to_size > 0.0) {
        const double size = std::sqrt(from_size * to_size);
        const Matrix3 covariance = y.transpose() * x;
        const auto best = best_rotation(covariance + kLeastTurn * size * Matrix3::Identity());
        const double trace = (best.rotation.transpose() * covariance).trace();
        result.rotation = best.rotation;
        if (trace > 0.0) result.scale = trace / from_size;
    }
    result.translation =
        to_mean.transpose() - result.scale * result.rotation * from_mean.transpose();
    return result;
}

Similarity fit_rigid_motion(const Positions& from, const Positions& to) {
    Similarity result;
    if (from.rows() == 0) return result;
    result.rotation = fit_similarity(from, to).rotation;
    const Vector3 from_mean = from.colwise().mean().transpose();
    result.translation = to.colwise().mean().transpose() - result.rotation * from_mean;
    return result;
}

double JointSpread::from_size() const {
    return std::sqrt(from);
}

double JointSpread::to_size() const {
    return std::sqrt(to);
}

double JointSpread::half_way() const {
    return 0.5 * std::sqrt(std::max(0.0, from + to + 2.0 * covariance.trace()));
}

Matrix3 JointSpread::rotation() const {
    const double size = from_size() * to_size();
    if (!(size > 0.0)) return Matrix3::Identity();
    return best_rotation(covariance + kLeastTurn * size * Matrix3::Identity()).rotation;
}

JointSpread joint_spread(const Positions& from, const Positions& to,
                         std::span<const IndexPair> pairs) {
    // Relative to some pair, which keeps the cancellation harmless.
    const Vector3 from_origin = from.row(pairs.front().source).transpose(),
                  to_origin = to.row(pairs.front().target).transpose();
    constexpr Index kPart = 16384;  // added up by itself, whatever the number of threads
    struct Sums {
        Vector3 from = Vector3::Zero(), to = Vector3::Zero();
        JointSpread spread;
    };
    std::vector<Sums> parts(pairs.size() / to_size(kPart) + 1);
    Progress silent;
    const auto add_up = [&](Index begin, Index end) {
        Sums& sums = parts[to_size(begin / kPart)];
        for (const IndexPair& pair : pairs.subspan(to_size(begin), to_size(end - begin))) {
            const Vector3 x = from.row(pair.source).transpose() - from_origin,
                          y = to.row(pair.target).transpose() - to_origin;
            sums.from += x;
            sums.to += y;
            sums.spread.from += x.squaredNorm();
            sums.spread.to += y.squaredNorm();
            sums.spread.covariance += y * x.transpose();
        }
    };
    parallel_for(to_index(pairs.size()), silent, add_up, 0.0, 1.0, kPart);
    Vector3 from_sum = Vector3::Zero(), to_sum = Vector3::Zero();
    JointSpread spread;
    for (const Sums& sums : parts) {
        from_sum += sums.from;
        to_sum += sums.to;
        spread.from += sums.spread.from;
        spread.to += sums.spread.to;
        spread.covariance += sums.spread.covariance;
    }
    const auto count = static_cast<double>(pairs.size());
    spread.from = std::max(0.0, spread.from - from_sum.squaredNorm() / count);
    spread.to = std::max(0.0, spread.to - to_sum.squaredNorm() / count);
    spread.covariance -= to_sum * from_sum.transpose() / count;
    return spread;
}

Similarity composed(const Similarity& after, const Similarity& before) {
    return {after.scale * before.scale, after.rotation * before.rotation,
            after.scale * (after.rotation * before.translation) + after.translation};
}

bool fits_better_mirrored(const Positions& from, const Positions& to) {
    const auto misfit = [&](const Positions& p) {
        return (fit_similarity(p, to).apply(p) - to).squaredNorm();
    };
    Positions mirrored = from;
    mirrored.col(0) *= -1.0;
    constexpr double kMuchBetter = 0.25;  // squared
    return misfit(mirrored) < kMuchBetter * misfit(from);
}

}  // namespace pointmorph
