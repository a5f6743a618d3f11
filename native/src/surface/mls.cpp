#include "pointmorph/surface/mls.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "base/branchless_exponential.hpp"
#include "base/compiler.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/cloud/covariance.hpp"

namespace pointmorph {

namespace {

constexpr Index kHighestDegree = 4;
constexpr int kMostCoefficients = (kHighestDegree + 1) * (kHighestDegree + 2) / 2;

/// In h: beyond, the kernel is below 1e-3.
constexpr double kReach = 2.65;
/// Cosine between normals from which a point counts in full.
constexpr double kAgreement = 0.5;
/// Second variance over the first below which points lie on a line.
constexpr double kOnALine = 1e-3;

/// Points are filled up to a multiple of so many, so that loops have no rest.
constexpr Index kPacket = 8;

// Powell's method, in radians and in h.
constexpr double kFirstStep = 0.05, kLastStep = 1e-3, kFarthest = 1.0;
constexpr int kMostSweeps = 8;

/// Added to the diagonal of the normal equations, as a share of the weights: nothing where the
/// points determine the coefficient, and where they don't, none of it.
constexpr double kRidge = 1e-6;

double smooth_step(double x) {
    const double s = std::clamp(x, 0.0, 1.0);
    return s * s * (3.0 - 2.0 * s);
}

/// The points around a place, as arrays of `count` numbers, and the plane {x : ⟨n, x⟩ = t}.
struct PlaneFit {
    const double *x, *y, *z, *weights;
    double* terms;  ///< room for what is summed
    Index count;
    Vector3 normal;
    double t;
};

/// Eq. (8): Σ (⟨n, p⟩ − t)² exp(−|p − t n|²), where |p − t n|² = |p|² − 2 t ⟨n, p⟩ + t². Added up
/// in the order that Eigen adds packets of two.
POINTMORPH_INLINE double sum_of_squares(const PlaneFit& fit) {
    const double* POINTMORPH_RESTRICT x = fit.x;
    const double* POINTMORPH_RESTRICT y = fit.y;
    const double* POINTMORPH_RESTRICT z = fit.z;
    const double* POINTMORPH_RESTRICT weights = fit.weights;
    double* POINTMORPH_RESTRICT terms = fit.terms;
    const double nx = fit.normal.x(), ny = fit.normal.y(), nz = fit.normal.z(), t = fit.t;
    const double twice = 2.0 * t, square = t * t;
    for (Index i = 0; i < fit.count; ++i) {
        const double height = nx * x[i] + ny * y[i] + nz * z[i], off = height - t;
        terms[i] = weights[i] * (off * off) * branchless_exponential(twice * height - square);
    }
    std::array<double, 4> sums{};
    for (Index i = 0; i < fit.count; i += 4)
        for (Index k = 0; k < 4; ++k) sums[to_size(k)] += terms[i + k];
    return (sums[0] + sums[2]) + (sums[1] + sums[3]);
}

POINTMORPH_WIDE double wide_sum_of_squares(const PlaneFit& fit) {
    return sum_of_squares(fit);
}

double narrow_sum_of_squares(const PlaneFit& fit) {
    return sum_of_squares(fit);
}

/// Takes e^exponent times each weight.
void multiply_by_exponentials(const double* POINTMORPH_RESTRICT exponents,
                              double* POINTMORPH_RESTRICT weights, Index count) {
    for (Index i = 0; i < count; ++i) weights[i] *= branchless_exponential(exponents[i]);
}

/// 1, u, v, u², uv, v² … up to the degree; returns how many.
int monomials(double u, double v, Index degree, std::array<double, kMostCoefficients>& result) {
    int count = 0;
    for (Index order = 0; order <= degree; ++order)
        for (Index k = 0; k <= order; ++k) {
            double term = 1.0;
            for (Index i = 0; i < order - k; ++i) term *= u;
            for (Index i = 0; i < k; ++i) term *= v;
            result[to_size(count++)] = term;
        }
    return count;
}

}  // namespace

double MlsOptions::kernel(double spacing) const {
    if (width) return *width;
    return scale.value_or(0.9 + 0.2 * degree) * spacing;
}

MlsProjection::MlsProjection(const KdTree<3>& tree, const Normals& normals,
                             const MlsOptions& options, bool wide)
    : tree_(tree), normals_(normals), options_(options), wide_(wide && has_wide_registers()) {
    if (options.degree < 1 || options.degree > kHighestDegree)
        throw OptionError("mls_degree", "a whole number from 1 to 4",
                          std::to_string(options.degree), "The default is 2.");
    const auto check = [](const std::optional<double>& length, const char* name) {
        if (length && !(*length > 0.0 && std::isfinite(*length)))
            throw OptionError(name, "a number above 0", std::to_string(*length),
                              "Leave it out to have it chosen.");
    };
    check(options.scale, "mls_scale");
    check(options.width, "mls_width");
}

bool MlsProjection::gather(const Vector3& place, const Vector3& normal, double h) {
    tree_.within(place.data(), kReach * h, near_);
    padded_ = (to_index(near_.size()) + kPacket - 1) / kPacket * kPacket;
    if (x_.size() < padded_)
        for (Eigen::ArrayXd* array : {&x_, &y_, &z_, &weight_, &height_, &terms_})
            array->resize(padded_);
    Index count = 0;
    for (const auto& [row, squared] : near_) {
        const double agreement = smooth_step(normals_.row(row).dot(normal) / kAgreement);
        if (!(agreement > 0.0)) continue;
        const Vector3 d = (tree_.points().row(row).transpose() - place) / h;
        x_[count] = d.x();
        y_[count] = d.y();
        z_[count] = d.z();
        weight_[count] = agreement;
        height_[count++] = -squared / (h * h);
    }
    padded_ = (count + kPacket - 1) / kPacket * kPacket;
    for (Index i = count; i < padded_; ++i) x_[i] = y_[i] = z_[i] = weight_[i] = height_[i] = 0.0;
    multiply_by_exponentials(height_.data(), weight_.data(), padded_);
    constexpr Index kFewest = 3;
    return count >= kFewest;
}

std::optional<Vector3> MlsProjection::covariance_normal(const Vector3& normal) const {
    const auto x = x_.head(padded_), y = y_.head(padded_), z = z_.head(padded_),
               w = weight_.head(padded_);
    const double sum = w.sum();
    if (!(sum > 0.0)) return std::nullopt;
    const Vector3 mean = Vector3((w * x).sum(), (w * y).sum(), (w * z).sum()) / sum;
    Matrix3 covariance;
    covariance << (w * x * x).sum(), (w * x * y).sum(), (w * x * z).sum(),  //
        (w * x * y).sum(), (w * y * y).sum(), (w * y * z).sum(),            //
        (w * x * z).sum(), (w * y * z).sum(), (w * z * z).sum();
    const PrincipalAxes axes = principal_axes(covariance - sum * mean * mean.transpose());
    if (!(axes.eigenvalues[1] > kOnALine * axes.eigenvalues[2])) return std::nullopt;
    const Vector3 v0 = axes.axes.col(0);
    return v0.dot(normal) < 0.0 ? Vector3(-v0) : v0;
}

double MlsProjection::badness(const Vector3& normal, double t) {
    const PlaneFit fit{x_.data(),     y_.data(), z_.data(), weight_.data(),
                       terms_.data(), padded_,   normal,    t};
    return wide_ ? wide_sum_of_squares(fit) : narrow_sum_of_squares(fit);
}

MlsProjection::Plane MlsProjection::plane(const Vector3& start) {
    const Vector3 u = start.unitOrthogonal(), v = start.cross(u);
    const auto normal_of = [&](const Vector3& at) {
        return (start + at.x() * u + at.y() * v).normalized();
    };
    const auto value = [&](const Vector3& at) {
        if (!(at.cwiseAbs().maxCoeff() <= kFarthest))
            return std::numeric_limits<double>::infinity();
        return badness(normal_of(at), at.z());
    };

    // One step along a line, to the minimum of the parabola through three points of it.
    Vector3 at = Vector3::Zero();
    double least = value(at), step = kFirstStep;
    const auto go_along = [&](const Vector3& direction) {
        const double before = least;
        const Vector3 from = at;
        const double ahead = value(from + step * direction);
        const double behind = value(from - step * direction);
        const auto take = [&](double distance, double there) {
            if (!(there < least)) return;
            least = there;
            at = from + distance * direction;
        };
        take(step, ahead);
        take(-step, behind);
        const double bend = ahead - 2.0 * before + behind;
        if (bend > 0.0 && std::isfinite(bend)) {
            constexpr double kFarthestSteps = 10.0;
            const double best =
                step * std::clamp((behind - ahead) / (2.0 * bend), -kFarthestSteps, kFarthestSteps);
            take(best, value(from + best * direction));
        }
        return before - least;
    };

    Matrix3 directions = Matrix3::Identity();
    for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
        const Vector3 from = at;
        const double before = least;
        int steepest = 0;
        double largest = 0.0;
        for (int d = 0; d < 3; ++d)
            if (const double gain = go_along(directions.col(d)); gain > largest) {
                largest = gain;
                steepest = d;
            }
        const Vector3 way = at - from;
        const double length = way.norm();
        if (length < kLastStep) break;
        step = std::clamp(length, kLastStep, kFirstStep);
        // Powell's criterion: the way gone replaces a direction unless that would make them
        // dependent.
        const double beyond = value(at + way);
        const double rest = before - least - largest;
        if (beyond < before && 2.0 * (before - 2.0 * least + beyond) * rest * rest <
                                   largest * (before - beyond) * (before - beyond)) {
            directions.col(steepest) = directions.col(2);
            directions.col(2) = way / length;
            go_along(directions.col(2));
        }
    }
    return {normal_of(at), at.z()};
}

MlsFoot MlsProjection::operator()(const Vector3& place, const Vector3& normal, double spacing) {
    const MlsFoot none{place, normal, false};
    const double h = options_.kernel(spacing);
    if (!(h > 0.0) || !gather(place, normal, h)) return none;
    const auto start = covariance_normal(normal);
    if (!start) return none;
    const Plane reference = plane(*start);
    const Vector3& n = reference.normal;
    const double t = reference.t;
    const Vector3 u = n.unitOrthogonal(), v = n.cross(u);

    auto height = height_.head(padded_);
    height = n.x() * x_.head(padded_) + n.y() * y_.head(padded_) + n.z() * z_.head(padded_);
    terms_.head(padded_) = 2.0 * t * height - t * t;
    multiply_by_exponentials(terms_.data(), weight_.data(), padded_);

    using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostCoefficients,
                                 kMostCoefficients>;
    using Column = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostCoefficients, 1>;
    std::array<double, kMostCoefficients> terms;
    const int count = monomials(0.0, 0.0, options_.degree, terms);
    Square squares = Square::Zero(count, count);
    Column right = Column::Zero(count);
    for (Index i = 0; i < padded_; ++i) {
        const Vector3 d(x_[i], y_[i], z_[i]);
        monomials(d.dot(u), d.dot(v), options_.degree, terms);
        const Eigen::Map<const Column> term(terms.data(), count);
        squares.selfadjointView<Eigen::Lower>().rankUpdate(term, weight_[i]);
        right += weight_[i] * (height_[i] - t) * term;
    }
    const double sum = squares(0, 0);
    if (!(sum > 0.0)) return none;
    squares.diagonal().tail(count - 1).array() += kRidge * sum;
    const Column g = squares.selfadjointView<Eigen::Lower>().ldlt().solve(right);

    const Vector3 foot = (t + g[0]) * n;
    const Vector3 gradient = n - g[1] * u - g[2] * v;
    if (!(foot.norm() <= kFarthest) || !gradient.allFinite()) return none;
    const Vector3 direction = gradient.normalized();
    return {place + h * foot, direction.dot(normal) < 0.0 ? Vector3(-direction) : direction, true};
}

}  // namespace pointmorph
