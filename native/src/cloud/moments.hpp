// Sums over points, from which their mean and covariance follow.
#pragma once

#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Mean and Σ (p − p̄)(p − p̄)ᵀ, one point at a time.
class Moments {
public:
    /// Sums are taken relative to `origin`, a place near the points, so that little cancels.
    explicit Moments(const Vector3& origin) : origin_(origin) {}

    void add(const Vector3& point) {
        const Vector3 d = point - origin_;
        ++count_;
        sum_ += d;
        xx_ += d.x() * d.x();
        xy_ += d.x() * d.y();
        xz_ += d.x() * d.z();
        yy_ += d.y() * d.y();
        yz_ += d.y() * d.z();
        zz_ += d.z() * d.z();
    }

    Vector3 mean() const { return origin_ + sum_ / count_; }

    Matrix3 covariance() const {
        Matrix3 squares;
        squares << xx_, xy_, xz_, xy_, yy_, yz_, xz_, yz_, zz_;
        return squares - sum_ * sum_.transpose() / count_;
    }

private:
    Vector3 origin_;
    double count_ = 0.0;
    Vector3 sum_ = Vector3::Zero();
    double xx_ = 0.0, xy_ = 0.0, xz_ = 0.0, yy_ = 0.0, yz_ = 0.0, zz_ = 0.0;
};

}  // namespace pointmorph
