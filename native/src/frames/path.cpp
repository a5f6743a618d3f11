#include "pointmorph/frames/path.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>

#if defined(__SSE2__) || defined(_M_X64)
#include <emmintrin.h>
#define POINTMORPH_STREAMING_STORES
#endif

#include "base/compiler.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

struct Attribute {
    const char* name;
    std::size_t width;  ///< numbers a pair
};
constexpr Attribute kPositions{"positions", 3};
constexpr Attribute kNormals{"normals", 3};
constexpr Attribute kColors{"colors", 4};
constexpr Attribute kRadii{"radii", 1};
/// What a point has where neither cloud has colors.
template <class Scalar>
constexpr Scalar kWhite = 1;

/// One attribute of both ends and of the result.
template <class Scalar>
struct Way {
    const Attribute& attribute;
    std::span<const Scalar> from, to;
    std::span<Scalar> out;
};

/// Does something with every attribute; `normals` with those.
template <class Scalar>
void for_each(const FrameView<const Scalar>& from, const FrameView<const Scalar>& to,
              const FrameView<Scalar>& out, auto&& plain, auto&& normals) {
    plain(Way<Scalar>{kPositions, from.positions, to.positions, out.positions});
    normals(Way<Scalar>{kNormals, from.normals, to.normals, out.normals});
    plain(Way<Scalar>{kColors, from.colors, to.colors, out.colors});
    plain(Way<Scalar>{kRadii, from.radii, to.radii, out.radii});
}

/// Pairs that a thread takes at once: large enough to be worth it, small enough for the caches.
constexpr Index kChunk = 4096;
/// Rows of a block: both ends' and the result's parts stay in the first-level cache.
constexpr std::size_t kBlock = 256;

/// Writes a block to the frame. Past the caches where the processor can: a frame is larger than
/// they are, and so its memory needn't be read before it is written over, a quarter of all
/// traffic.
template <class Scalar>
void write(const Scalar* block, Scalar* out, std::size_t count) {
    std::size_t i = 0;
#ifdef POINTMORPH_STREAMING_STORES
    constexpr std::size_t kPerRegister = 16 / sizeof(Scalar);
    while (i < count && reinterpret_cast<std::uintptr_t>(out + i) % 16 != 0) {
        out[i] = block[i];
        ++i;
    }
    for (; i + kPerRegister <= count; i += kPerRegister)
        _mm_stream_si128(reinterpret_cast<__m128i*>(out + i),
                         _mm_loadu_si128(reinterpret_cast<const __m128i*>(block + i)));
#endif
    std::copy(block + i, block + count, out + i);
}

/// Makes what was written visible to other threads.
inline void finish_writing() {
#ifdef POINTMORPH_STREAMING_STORES
    _mm_sfence();
#endif
}

template <class Scalar>
void fill_white(std::array<Scalar, 4 * kBlock>& block, Scalar* out, std::size_t count) {
    block.fill(kWhite<Scalar>);
    for (std::size_t i = 0; i < count; i += block.size())
        write(block.data(), out + i, std::min(block.size(), count - i));
}

/// One end of an interval at the share of the way from it to the other: base + share (other −
/// base). Written so that equal ends give that very number back, −0 too. The compiler vectorizes
/// it.
template <class Scalar>
void blend(const Scalar* POINTMORPH_RESTRICT base, const Scalar* POINTMORPH_RESTRICT other,
           Scalar share, Scalar* POINTMORPH_RESTRICT out, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) out[i] = base[i] - share * (base[i] - other[i]);
}

/// One blended and renormalized normal where the quick way may fail: the ends are nearly
/// opposite, or so short or long that squares leave Scalar's range.
template <class Scalar>
void blend_normal_carefully(const Scalar* base, const Scalar* other, Scalar share, Scalar* out) {
    const auto load = [](const Scalar* v) { return Vector3(v[0], v[1], v[2]); };
    Vector3 a = load(base), b = load(other);
    const double largest = std::max(a.cwiseAbs().maxCoeff(), b.cwiseAbs().maxCoeff());
    if (largest > 0.0) {
        a /= largest;
        b /= largest;
    }
    Vector3 normal = a - share * (a - b);
    // What is left of two ends that cancel is their rounding.
    if (!(normal.norm() > 8.0 * std::numeric_limits<Scalar>::epsilon())) {
        normal = a.squaredNorm() > 0.0 ? a : b;
        const double length = normal.cwiseAbs().maxCoeff();
        if (length > 0.0) normal /= length;
    }
    if (normal.squaredNorm() > 0.0) normal.normalize();
    for (int d = 0; d < 3; ++d) out[d] = static_cast<Scalar>(normal[d]);
}

/// `count` ≤ kBlock normals. Step by step over the block, each of which the compiler (or Eigen, for
/// the square root) vectorizes; floats eight at a time where registers are wide, with the same
/// bits.
template <class Scalar>
void blend_normals(const Scalar* POINTMORPH_RESTRICT base, const Scalar* POINTMORPH_RESTRICT other,
                   Scalar share, Scalar* POINTMORPH_RESTRICT out, std::size_t count) {
    constexpr std::array<Scalar, 2> kLimits{Scalar(1e-4), Scalar(1e4)};
    if constexpr (std::is_same_v<Scalar, float>)
        if (count % 8 == 0 && has_wide_registers() &&
            blend_units_wide(base, other, share, kLimits, out, count))
            return;
    alignas(16) std::array<Scalar, 3 * kBlock> n;
    alignas(16) std::array<Scalar, kBlock> factor;
    blend(base, other, share, n.data(), 3 * count);
    for (std::size_t i = 0; i < count; ++i)
        factor[i] = n[3 * i] * n[3 * i] + n[3 * i + 1] * n[3 * i + 1] + n[3 * i + 2] * n[3 * i + 2];
    auto factors = Eigen::Array<Scalar, Eigen::Dynamic, 1>::MapAligned(
        factor.data(), static_cast<Eigen::Index>(count));
    const bool in_range = factors.minCoeff() > kLimits[0] && factors.maxCoeff() < kLimits[1];
    factors = factors.sqrt().inverse();
    for (std::size_t i = 0; i < count; ++i) {
        out[3 * i] = n[3 * i] * factor[i];
        out[3 * i + 1] = n[3 * i + 1] * factor[i];
        out[3 * i + 2] = n[3 * i + 2] * factor[i];
    }
    if (in_range) return;
    for (std::size_t i = 0; i < count; ++i)
        if (!(factor[i] < Scalar(1e2) && factor[i] > Scalar(1e-2)))
            blend_normal_carefully(base + 3 * i, other + 3 * i, share, out + 3 * i);
}

/// All positions, then all normals, radii and, if there are any, colors.
template <class Scalar>
FrameView<Scalar> laid_out(std::span<Scalar> numbers, std::size_t count) {
    return {numbers.subspan(0, 3 * count), numbers.subspan(3 * count, 3 * count),
            numbers.subspan(7 * count), numbers.subspan(6 * count, count)};
}

template <class Scalar>
void fill(const Cloud& cloud, std::span<const IndexPair> pairs, Index IndexPair::*side,
          const FrameView<Scalar>& ends) {
    const std::size_t count = pairs.size();
    std::atomic<bool> too_large{false};
    Progress silent;
    parallel_for(to_index(count), silent, [&](Index begin, Index end) {
        bool fits = true;
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            const Index row = pairs[i].*side;
            assert(row >= 0 && row < cloud.size());
            const auto put = [&](Scalar& number, double value) {
                fits = fits && std::abs(value) <= std::numeric_limits<Scalar>::max() / 2;
                number = static_cast<Scalar>(value);
            };
            for (std::size_t d = 0; d < 3; ++d) {
                put(ends.positions[3 * i + d], cloud.positions(row, static_cast<int>(d)));
                put(ends.normals[3 * i + d], cloud.normals(row, static_cast<int>(d)));
            }
            for (std::size_t d = 0; d < 4 && !ends.colors.empty(); ++d)
                put(ends.colors[4 * i + d], cloud.colors.rows() > 0
                                                ? cloud.colors(row, static_cast<int>(d))
                                                : kWhite<float>);
            put(ends.radii[i], cloud.radii[row]);
        }
        if (!fits) too_large = true;
    });
    if (too_large) {
        const double largest = std::numeric_limits<Scalar>::max() / 2;
        throw CloudError(cloud.name, "numbers up to " + in_short(largest), "larger ones",
                         "Scale the object.");
    }
}

void check_complete(const Cloud& cloud) {
    const auto check = [&](Eigen::Index rows, const char* what) {
        if (rows != cloud.positions.rows())
            throw CloudError(
                cloud.name, std::string(what) + " for every point",
                std::to_string(rows) + " for " + std::to_string(cloud.positions.rows()) + " points",
                "Estimate them first.");
    };
    check(cloud.normals.rows(), "normals");
    check(cloud.radii.rows(), "radii");
    if (cloud.colors.rows() > 0) check(cloud.colors.rows(), "colors");
}

}  // namespace

template <class Scalar>
StraightPath<Scalar>::StraightPath(const Cloud& source, const Cloud& target,
                                   std::span<const IndexPair> pairs)
    : size_(to_index(pairs.size())) {
    check_complete(source);
    check_complete(target);
    const bool has_colors = source.colors.rows() > 0 || target.colors.rows() > 0;
    const std::size_t count = pairs.size(), numbers = (has_colors ? 11 : 7) * count;
    own_ = std::make_unique_for_overwrite<Scalar[]>(2 * numbers);
    const auto from = laid_out(std::span(own_.get(), numbers), count);
    const auto to = laid_out(std::span(own_.get() + numbers, numbers), count);
    fill(source, pairs, &IndexPair::source, from);
    fill(target, pairs, &IndexPair::target, to);
    source_ = {from.positions, from.normals, from.colors, from.radii};
    target_ = {to.positions, to.normals, to.colors, to.radii};
}

template <class Scalar>
StraightPath<Scalar>::StraightPath(const FrameView<const Scalar>& source,
                                   const FrameView<const Scalar>& target)
    : size_(to_index(source.radii.size())), source_(source), target_(target) {
    const auto check = [this](const Attribute& attribute, std::span<const Scalar> span) {
        if (span.size() != attribute.width * to_size(size_))
            throw OptionError(std::string("path ") + attribute.name,
                              std::to_string(attribute.width * to_size(size_)) + " numbers",
                              std::to_string(span.size()), "Give both ends of every pair.");
    };
    for (const FrameView<const Scalar>* end : {&source_, &target_}) {
        check(kPositions, end->positions);
        check(kNormals, end->normals);
        check(kRadii, end->radii);
        if (!source_.colors.empty() || !target_.colors.empty()) check(kColors, end->colors);
    }
}

template <class Scalar>
void check_frame(Index pairs, const FrameView<Scalar>& out) {
    const auto count = to_size(pairs);
    const auto check = [&](const Attribute& attribute, std::span<Scalar> span) {
        if (!span.empty() && span.size() != attribute.width * count)
            throw OptionError(std::string("frame ") + attribute.name,
                              std::to_string(attribute.width * count) + " numbers or none",
                              std::to_string(span.size()),
                              "Give " + std::to_string(attribute.width) + " per pair.");
    };
    check(kPositions, out.positions);
    check(kNormals, out.normals);
    check(kColors, out.colors);
    check(kRadii, out.radii);
}

template <class Scalar>
void StraightPath<Scalar>::frame(std::span<const double> times,
                                 const FrameView<Scalar>& out) const {
    check_frame(size_, out);
    Progress silent;
    parallel_for(size_, silent, [&](Index begin, Index end) {
        for (auto i = to_size(begin); i < to_size(end); ++i) {
            const bool near_source = times[i] < 0.5;
            const auto share = static_cast<Scalar>(near_source ? times[i] : 1.0 - times[i]);
            const auto row = [&](const Way<Scalar>& way, auto&& form) {
                if (way.out.empty()) return;
                const std::size_t at = way.attribute.width * i;
                if (way.from.empty()) {
                    std::fill_n(way.out.data() + at, way.attribute.width, kWhite<Scalar>);
                    return;
                }
                form(way.from.data() + at, way.to.data() + at, way.out.data() + at,
                     way.attribute.width);
            };
            for_each(
                near_source ? source_ : target_, near_source ? target_ : source_, out,
                [&](const Way<Scalar>& way) {
                    row(way,
                        [&](const Scalar* base, const Scalar* other, Scalar* result,
                            std::size_t numbers) { blend(base, other, share, result, numbers); });
                },
                [&](const Way<Scalar>& way) {
                    row(way,
                        [&](const Scalar* base, const Scalar* other, Scalar* result, std::size_t) {
                            if (share == Scalar(0))
                                std::copy_n(base, 3, result);
                            else
                                blend_normal_carefully(base, other, share, result);
                        });
                });
        }
    });
}

template <class Scalar>
void StraightPath<Scalar>::frame(double t, const FrameView<Scalar>& out) const {
    if (!(t >= 0.0 && t <= 1.0))
        throw OptionError("t", "a number from 0 to 1", std::to_string(t),
                          "Choose a value from that range.");
    check_frame(size_, out);

    // From the nearer end: the error is that of one rounding at either end, and the two halves
    // mirror one another.
    const bool near_source = t < 0.5;
    const FrameView<const Scalar>& base = near_source ? source_ : target_;
    const FrameView<const Scalar>& other = near_source ? target_ : source_;
    const auto share = static_cast<Scalar>(near_source ? t : 1.0 - t);
    const bool at_end = t == 0.0 || t == 1.0;

    Progress silent;
    parallel_for(
        size_, silent,
        [&](Index first, Index last) {
            const auto begin = to_size(first);
            const auto rows = to_size(last - first);
            alignas(64) std::array<Scalar, 4 * kBlock> block;
            const auto in_blocks = [&](const Way<Scalar>& way, auto&& form) {
                if (way.out.empty()) return;
                const std::size_t width = way.attribute.width, start = width * begin;
                const Scalar *from = way.from.data() + start, *to = way.to.data() + start;
                Scalar* out_rows = way.out.data() + start;
                if (way.from.empty())
                    fill_white(block, out_rows, width * rows);
                else if (at_end)
                    std::copy_n(from, width * rows, out_rows);
                else
                    for (std::size_t i = 0; i < width * rows; i += width * kBlock) {
                        const std::size_t numbers = std::min(width * kBlock, width * rows - i);
                        form(from + i, to + i, block.data(), numbers);
                        write(block.data(), out_rows + i, numbers);
                    }
            };
            for_each(
                base, other, out,
                [&](const Way<Scalar>& way) {
                    in_blocks(
                        way, [&](const Scalar* from, const Scalar* to, Scalar* result,
                                 std::size_t numbers) { blend(from, to, share, result, numbers); });
                },
                [&](const Way<Scalar>& way) {
                    in_blocks(way, [&](const Scalar* from, const Scalar* to, Scalar* result,
                                       std::size_t numbers) {
                        blend_normals(from, to, share, result, numbers / 3);
                    });
                });
            finish_writing();
        },
        0.0, 1.0, kChunk);
}

template void check_frame<float>(Index, const FrameView<float>&);
template void check_frame<double>(Index, const FrameView<double>&);
template class StraightPath<float>;
template class StraightPath<double>;

}  // namespace pointmorph
