// Stage `path`: the in-between cloud at t (paper, Morphing Path, eq. (5)).
#pragma once

#include <memory>
#include <span>

#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/cloud.hpp"

namespace pointmorph {

/// Attributes of one in-between cloud, #pairs rows each, row-major; memory is the caller's.
/// An empty span leaves that attribute out.
template <class Scalar>
struct FrameView {
    std::span<Scalar> positions;  ///< 3 a pair
    std::span<Scalar> normals;    ///< 3 a pair
    std::span<Scalar> colors;     ///< 4 a pair
    std::span<Scalar> radii;      ///< 1 a pair
};

/// Throws OptionError for spans that are neither empty nor of the right size for so many pairs.
template <class Scalar>
void check_frame(Index pairs, const FrameView<Scalar>& out);

/// Both ends of every pair, laid out so that a frame is one pass over consecutive memory.
/// Scalar is the caller's type: float or double.
template <class Scalar>
class StraightPath {
public:
    /// `pairs` are rows of both clouds. Both clouds need normals and radii here; colors may be
    /// missing: white, opaque. Throws CloudError for missing attributes and for numbers beyond
    /// half of what Scalar can hold: their differences might not be finite.
    StraightPath(const Cloud& source, const Cloud& target, std::span<const IndexPair> pairs);
    /// From ends that are laid out already, in a file that is mapped into memory for instance: all
    /// spans of both, for as many pairs, or neither's colors: white. Refers to them. Throws
    /// OptionError for other sizes.
    StraightPath(const FrameView<const Scalar>& source, const FrameView<const Scalar>& target);
    StraightPath(StraightPath&&) noexcept = default;

    Index size() const noexcept { return size_; }

    /// The cloud at t in [0, 1]: (1 − t) s + t t' for positions, colors with alpha, and radii;
    /// normals likewise and renormalized (where both cancel, the source's for t < ½, else the
    /// target's). At t = 0 and t = 1 the inputs' own bits; between them, positions, colors and
    /// radii that are the same at both ends stay so to the bit, and no number leaves the interval
    /// between its ends. Spans that are neither empty nor of the right size, or t outside [0, 1],
    /// are an OptionError. Allocates nothing; runs on all threads; may be called from several
    /// threads at once.
    void frame(double t, const FrameView<Scalar>& out) const;
    /// The same with each pair at a time of its own: `times`, one a pair.
    void frame(std::span<const double> times, const FrameView<Scalar>& out) const;

private:
    Index size_;
    std::unique_ptr<Scalar[]> own_;  ///< what the spans refer to unless it is another's
    FrameView<const Scalar> source_, target_;
};

extern template void check_frame<float>(Index, const FrameView<float>&);
extern template void check_frame<double>(Index, const FrameView<double>&);
extern template class StraightPath<float>;
extern template class StraightPath<double>;

}  // namespace pointmorph
