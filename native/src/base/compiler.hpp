// What compilers don't agree on. No other file asks for one.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#if defined(__GNUC__) && defined(__x86_64__) && !defined(_WIN32)
#include <immintrin.h>
#endif

/// The pointer is the only way to what it points to, so that loops can be vectorized.
#define POINTMORPH_RESTRICT __restrict  // of GCC, Clang and MSVC alike

/// What a function with POINTMORPH_WIDE calls has to become a part of it.
#if defined(__GNUC__)
#define POINTMORPH_INLINE inline __attribute__((always_inline))
#else
#define POINTMORPH_INLINE inline
#endif

/// Before a loop of four rounds or fewer: GCC keeps what it works on in registers only if it is
/// unrolled early.
#if defined(__GNUC__) && !defined(__clang__)
#define POINTMORPH_UNROLL _Pragma("GCC unroll 4")
#else
#define POINTMORPH_UNROLL
#endif

namespace pointmorph {

/// Two numbers side by side, for any compiler.
struct alignas(16) PlainTwo {
    std::array<double, 2> values;

    double& operator[](std::size_t k) { return values[k]; }
    double operator[](std::size_t k) const { return values[k]; }
    friend PlainTwo operator-(const PlainTwo& a, const PlainTwo& b) {
        return {{a[0] - b[0], a[1] - b[1]}};
    }
    friend PlainTwo operator*(const PlainTwo& a, const PlainTwo& b) {
        return {{a[0] * b[0], a[1] * b[1]}};
    }
    PlainTwo& operator+=(const PlainTwo& b) {
        values[0] += b[0];
        values[1] += b[1];
        return *this;
    }
};

/// Two numbers in one register.
#if defined(__GNUC__)  // Clang as well
using Two = double __attribute__((vector_size(16)));
#else
using Two = PlainTwo;
#endif

/// Of both numbers the smaller ones, and the larger ones; none may be a NaN.
inline PlainTwo smaller(const PlainTwo& a, const PlainTwo& b) {
    return {{a[0] < b[0] ? a[0] : b[0], a[1] < b[1] ? a[1] : b[1]}};
}
inline PlainTwo larger(const PlainTwo& a, const PlainTwo& b) {
    return {{a[0] > b[0] ? a[0] : b[0], a[1] > b[1] ? a[1] : b[1]}};
}

/// How many of many numbers are less than one.
class PlainCountBelow {
public:
    explicit PlainCountBelow(double limit) : limit_(limit) {}

    void look_at(const PlainTwo& numbers) {
        count_ += (numbers[0] < limit_ ? 1u : 0u) + (numbers[1] < limit_ ? 1u : 0u);
    }
    std::size_t count() const { return count_; }

private:
    double limit_;
    std::size_t count_ = 0;
};

#if defined(__GNUC__)
inline Two smaller(const Two& a, const Two& b) {
    return a < b ? a : b;
}
inline Two larger(const Two& a, const Two& b) {
    return a > b ? a : b;
}

class CountBelow {
public:
    explicit CountBelow(double limit) : limit_{limit, limit} {}

    void look_at(const Two& numbers) { counts_ -= numbers < limit_; }  // -1 where it is so
    std::size_t count() const { return static_cast<std::size_t>(counts_[0] + counts_[1]); }

private:
    Two limit_;
    decltype(Two{} < Two{}) counts_{};
};
#else
using CountBelow = PlainCountBelow;
#endif

/// Four numbers side by side, for any compiler.
struct alignas(16) PlainFour {
    std::array<double, 4> values;

    double operator[](int k) const { return values[static_cast<std::size_t>(k)]; }

    friend PlainFour operator*(double a, PlainFour b) {
        for (double& value : b.values) value *= a;
        return b;
    }
    PlainFour& operator+=(const PlainFour& b) {
        for (std::size_t k = 0; k < 4; ++k) values[k] += b.values[k];
        return *this;
    }
    PlainFour& operator-=(const PlainFour& b) {
        for (std::size_t k = 0; k < 4; ++k) values[k] -= b.values[k];
        return *this;
    }
};

/// Four numbers in one register where it is wide, else in two. Not for memory, where it depends on
/// how wide registers are whether compilers take it to be aligned: std::memcpy does it.
#if defined(__GNUC__)
using Four = double __attribute__((vector_size(32)));
#else
using Four = PlainFour;
#endif

/// Eight numbers in one register, where there are some as wide; no more than four elsewhere.
#if defined(__GNUC__) && defined(__x86_64__) && !defined(_WIN32)
using Eight = double __attribute__((vector_size(64)));
#else
using Eight = Four;
#endif

/// The same as two registers of two, for processors that have none as wide: compilers take Four to
/// pieces there that go through memory.
struct TwoTwos {
    Two low, high;

    friend TwoTwos operator*(double a, const TwoTwos& b) {
        const Two both = {a, a};
        return {both * b.low, both * b.high};
    }
    TwoTwos& operator+=(const TwoTwos& b) {
        low += b.low;
        high += b.high;
        return *this;
    }
    TwoTwos& operator-=(const TwoTwos& b) {
        for (std::size_t k = 0; k < 2; ++k) {
            low[k] -= b.low[k];
            high[k] -= b.high[k];
        }
        return *this;
    }
    double operator[](int k) const { return k < 2 ? low[k] : high[k - 2]; }
};

/// Puts the last two of others in the place of the last two numbers. (Compilers warn of Four as a
/// result, which another register would bring back where registers aren't wide.)
inline void take_upper_half(TwoTwos& numbers, const TwoTwos& others) {
    numbers.high = others.high;
}
inline void take_upper_half(PlainFour& numbers, const PlainFour& others) {
    numbers.values[2] = others.values[2];
    numbers.values[3] = others.values[3];
}
#if defined(__GNUC__)
inline __attribute__((always_inline)) void take_upper_half(Four& numbers, const Four& others) {
    numbers = Four{numbers[0], numbers[1], others[2], others[3]};
}
#endif

/// Four floats in one register. For other compilers a float is a register of one.
#if defined(__GNUC__)
using FourFloats = float __attribute__((vector_size(16)));
#else
using FourFloats = float;
#endif

/// Sums of products, of `kFactors` numbers of a row each with one of a column: row_starts[r] +
/// column_starts[c] + Σ factors[kFactors r + k] · columns[stride k + c].
struct ProductSums {
    const float *factors, *row_starts, *columns, *column_starts;
    std::size_t stride;  ///< number of columns, a multiple of 32
};

/// The least of each row, and of each column, which is that from before if that is less.
struct LeastSums {
    float *of_rows, *of_columns;
};

/// Tiles of 4 by 4 numbers, one column after the other. Each of `tiles` times the transpose of `by`
/// is taken from the one of `sums` that its place says.
struct TileProducts {
    const double *by, *tiles;
    const std::int32_t* places;
    std::size_t count;  ///< of tiles
    double* sums;
};

/// Sixteen points, axis by axis, and one whose squared distances from them are asked for where any
/// is less than a limit.
struct SixteenPoints {
    const double *coordinates, *from;
    double limit;
};

/// Functions with POINTMORPH_WIDE may only be called where has_wide_registers(), those with
/// POINTMORPH_FUSED where has_fused_products(), and those with POINTMORPH_WIDEST where
/// has_widest_registers(); each of them says that the ones before are true as well. Not on Windows:
/// what GCC spills there to the stack isn't aligned as wide registers need it (its bug 54412).
#if defined(__GNUC__) && defined(__x86_64__) && !defined(_WIN32)
#define POINTMORPH_WIDE __attribute__((target("avx2")))
inline bool has_wide_registers() {
    return __builtin_cpu_supports("avx2");
}
/// Takes the square roots of some numbers, a multiple of four: compilers don't do several at once,
/// as one of a number below 0 would have to be reported.
POINTMORPH_WIDE inline void take_roots_wide(double* numbers, std::size_t count) {
    for (std::size_t i = 0; i < count; i += 4)
        _mm256_storeu_pd(numbers + i, _mm256_sqrt_pd(_mm256_loadu_pd(numbers + i)));
}
/// Four numbers, and four that begin twelve later.
POINTMORPH_WIDE inline __m256 load_fours(const float* at) {
    const __m256 low = _mm256_castps128_ps256(_mm_loadu_ps(at));
    return _mm256_insertf128_ps(low, _mm_loadu_ps(at + 12), 1);
}
/// Writes rows of three floats, base − share (base − other), made as long as 1; a multiple of
/// eight. Whether all squares of their lengths were between the limits.
POINTMORPH_WIDE inline bool blend_units_wide(const float* base, const float* other, float share,
                                             const std::array<float, 2>& limits, float* out,
                                             std::size_t count) {
    const __m256 shares = _mm256_set1_ps(share), one = _mm256_set1_ps(1.0F);
    const __m256 least = _mm256_set1_ps(limits[0]), most = _mm256_set1_ps(limits[1]);
    int in_range = 0xff;
    for (std::size_t i = 0; i < 3 * count; i += 24) {
        // Four rows in the lower halves, four in the upper ones: xyzx yzxy zxyz.
        __m256 n[3], squares[3];
        for (std::size_t k = 0; k < 3; ++k) {
            const __m256 from = load_fours(base + i + 4 * k), to = load_fours(other + i + 4 * k);
            n[k] = _mm256_sub_ps(from, _mm256_mul_ps(shares, _mm256_sub_ps(from, to)));
            squares[k] = _mm256_mul_ps(n[k], n[k]);
        }
        const auto& [a, b, c] = squares;
        const __m256 xy = _mm256_shuffle_ps(b, c, 0x9e), yz = _mm256_shuffle_ps(a, b, 0x49);
        const __m256 x = _mm256_shuffle_ps(a, xy, 0x8c), y = _mm256_shuffle_ps(yz, xy, 0xd8),
                     z = _mm256_shuffle_ps(yz, c, 0xcd);
        const __m256 sums = _mm256_add_ps(_mm256_add_ps(x, y), z);
        in_range &= _mm256_movemask_ps(_mm256_and_ps(_mm256_cmp_ps(sums, least, _CMP_GT_OQ),
                                                     _mm256_cmp_ps(sums, most, _CMP_LT_OQ)));
        const __m256 factors = _mm256_div_ps(one, _mm256_sqrt_ps(sums));
        n[0] = _mm256_mul_ps(n[0], _mm256_permute_ps(factors, 0x40));
        n[1] = _mm256_mul_ps(n[1], _mm256_permute_ps(factors, 0xa5));
        n[2] = _mm256_mul_ps(n[2], _mm256_permute_ps(factors, 0xfe));
        for (std::size_t k = 0; k < 3; ++k) {
            _mm_storeu_ps(out + i + 4 * k, _mm256_castps256_ps128(n[k]));
            _mm_storeu_ps(out + i + 12 + 4 * k, _mm256_extractf128_ps(n[k], 1));
        }
    }
    return in_range == 0xff;
}
/// Writes rows of three floats, made as long as 1, of rows that have one more float after them; a
/// multiple of eight. Whether all were longer than `least`.
POINTMORPH_WIDE inline bool put_units_wide(const float* rows, float least, float* out,
                                           std::size_t count) {
    const __m256 one = _mm256_set1_ps(1.0F), shortest = _mm256_set1_ps(least);
    int are_longer = 0xff;
    for (std::size_t i = 0; i < count; i += 8, rows += 32, out += 24) {
        // Row k in the lower half, row 4 + k in the upper one.
        __m256 n[4];
        for (std::size_t k = 0; k < 4; ++k)
            n[k] = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(rows + 4 * k)),
                                        _mm_loadu_ps(rows + 4 * k + 16), 1);
        const __m256 a = _mm256_unpacklo_ps(n[0], n[1]), b = _mm256_unpacklo_ps(n[2], n[3]);
        const __m256 c = _mm256_unpackhi_ps(n[0], n[1]), d = _mm256_unpackhi_ps(n[2], n[3]);
        const __m256 x = _mm256_shuffle_ps(a, b, 0x44), y = _mm256_shuffle_ps(a, b, 0xee),
                     z = _mm256_shuffle_ps(c, d, 0x44);
        const __m256 lengths = _mm256_sqrt_ps(_mm256_add_ps(
            _mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y)), _mm256_mul_ps(z, z)));
        are_longer &= _mm256_movemask_ps(_mm256_cmp_ps(lengths, shortest, _CMP_GT_OQ));
        const __m256 factors = _mm256_div_ps(one, lengths);
        n[0] = _mm256_mul_ps(n[0], _mm256_permute_ps(factors, 0x00));
        n[1] = _mm256_mul_ps(n[1], _mm256_permute_ps(factors, 0x55));
        n[2] = _mm256_mul_ps(n[2], _mm256_permute_ps(factors, 0xaa));
        n[3] = _mm256_mul_ps(n[3], _mm256_permute_ps(factors, 0xff));
        // What each has after its three is written over by the next one.
        for (std::size_t k = 0; k < 4; ++k)
            _mm_storeu_ps(out + 3 * k, _mm256_castps256_ps128(n[k]));
        for (std::size_t k = 0; k < 3; ++k)
            _mm_storeu_ps(out + 12 + 3 * k, _mm256_extractf128_ps(n[k], 1));
        const __m128 last = _mm256_extractf128_ps(n[3], 1);
        _mm_storel_pi(reinterpret_cast<__m64*>(out + 21), last);
        _mm_store_ss(out + 23, _mm_movehl_ps(last, last));
    }
    return are_longer == 0xff;
}
#define POINTMORPH_FUSED __attribute__((target("avx2,fma")))
#define POINTMORPH_WIDEST __attribute__((target("avx512f")))
inline bool has_fused_products() {
    return has_wide_registers() && __builtin_cpu_supports("fma");
}
inline bool has_widest_registers() {
    return has_fused_products() && __builtin_cpu_supports("avx512f");
}
/// Writes the sums of four rows, one row after the other, and the least of them. Products
/// aren't rounded before they are added, so that last digits differ from those of other versions.
template <std::size_t kFactors>
POINTMORPH_FUSED void sum_products_of_four(const ProductSums& p, const LeastSums& least,
                                           float* POINTMORPH_RESTRICT sums) {
    constexpr std::size_t kRows = 4, kLanes = 8;
    __m256 low[kRows];
    for (__m256& its : low) its = _mm256_set1_ps(std::numeric_limits<float>::infinity());
    for (std::size_t at = 0; at < p.stride; at += 2 * kLanes) {
        __m256 left[kRows], right[kRows];
        const __m256 a = _mm256_loadu_ps(p.column_starts + at),
                     b = _mm256_loadu_ps(p.column_starts + at + kLanes);
#pragma GCC unroll 4
        for (std::size_t r = 0; r < kRows; ++r) {
            const __m256 start = _mm256_set1_ps(p.row_starts[r]);
            left[r] = _mm256_add_ps(a, start);
            right[r] = _mm256_add_ps(b, start);
        }
#pragma GCC unroll 16
        for (std::size_t k = 0; k < kFactors; ++k) {
            const __m256 c = _mm256_loadu_ps(p.columns + k * p.stride + at),
                         d = _mm256_loadu_ps(p.columns + k * p.stride + at + kLanes);
#pragma GCC unroll 4
            for (std::size_t r = 0; r < kRows; ++r) {
                const __m256 factor = _mm256_set1_ps(p.factors[kFactors * r + k]);
                left[r] = _mm256_fmadd_ps(factor, c, left[r]);
                right[r] = _mm256_fmadd_ps(factor, d, right[r]);
            }
        }
#pragma GCC unroll 4
        for (std::size_t r = 0; r < kRows; ++r) {
            low[r] = _mm256_min_ps(low[r], _mm256_min_ps(left[r], right[r]));
            _mm256_storeu_ps(sums + r * p.stride + at, left[r]);
            _mm256_storeu_ps(sums + r * p.stride + at + kLanes, right[r]);
        }
        float* const of_columns = least.of_columns + at;
        __m256 c = _mm256_loadu_ps(of_columns), d = _mm256_loadu_ps(of_columns + kLanes);
#pragma GCC unroll 4
        for (std::size_t r = 0; r < kRows; ++r) {
            c = _mm256_min_ps(c, left[r]);
            d = _mm256_min_ps(d, right[r]);
        }
        _mm256_storeu_ps(of_columns, c);
        _mm256_storeu_ps(of_columns + kLanes, d);
    }
    for (std::size_t r = 0; r < kRows; ++r) {
        std::array<float, kLanes> each;
        _mm256_storeu_ps(each.data(), low[r]);
        least.of_rows[r] = *std::min_element(each.begin(), each.end());
    }
}
/// The same of eight rows.
template <std::size_t kFactors>
POINTMORPH_WIDEST void sum_products_of_eight(const ProductSums& p, const LeastSums& least,
                                             float* POINTMORPH_RESTRICT sums) {
    constexpr std::size_t kRows = 8, kLanes = 16;
    __m512 low[kRows];
    for (__m512& its : low) its = _mm512_set1_ps(std::numeric_limits<float>::infinity());
    for (std::size_t at = 0; at < p.stride; at += 2 * kLanes) {
        __m512 left[kRows], right[kRows];
        const __m512 a = _mm512_loadu_ps(p.column_starts + at),
                     b = _mm512_loadu_ps(p.column_starts + at + kLanes);
#pragma GCC unroll 8
        for (std::size_t r = 0; r < kRows; ++r) {
            const __m512 start = _mm512_set1_ps(p.row_starts[r]);
            left[r] = _mm512_add_ps(a, start);
            right[r] = _mm512_add_ps(b, start);
        }
#pragma GCC unroll 16
        for (std::size_t k = 0; k < kFactors; ++k) {
            const __m512 c = _mm512_loadu_ps(p.columns + k * p.stride + at),
                         d = _mm512_loadu_ps(p.columns + k * p.stride + at + kLanes);
#pragma GCC unroll 8
            for (std::size_t r = 0; r < kRows; ++r) {
                const __m512 factor = _mm512_set1_ps(p.factors[kFactors * r + k]);
                left[r] = _mm512_fmadd_ps(factor, c, left[r]);
                right[r] = _mm512_fmadd_ps(factor, d, right[r]);
            }
        }
#pragma GCC unroll 8
        for (std::size_t r = 0; r < kRows; ++r) {
            // Of all lanes: without a mask, GCC 12 warns of what is uninitialized in its own
            // header.
            low[r] =
                _mm512_maskz_min_ps(0xffff, low[r], _mm512_maskz_min_ps(0xffff, left[r], right[r]));
            _mm512_storeu_ps(sums + r * p.stride + at, left[r]);
            _mm512_storeu_ps(sums + r * p.stride + at + kLanes, right[r]);
        }
        float* const of_columns = least.of_columns + at;
        __m512 c = _mm512_loadu_ps(of_columns), d = _mm512_loadu_ps(of_columns + kLanes);
#pragma GCC unroll 8
        for (std::size_t r = 0; r < kRows; ++r) {
            c = _mm512_maskz_min_ps(0xffff, c, left[r]);
            d = _mm512_maskz_min_ps(0xffff, d, right[r]);
        }
        _mm512_storeu_ps(of_columns, c);
        _mm512_storeu_ps(of_columns + kLanes, d);
    }
    for (std::size_t r = 0; r < kRows; ++r) {
        std::array<float, kLanes> each;
        _mm512_storeu_ps(each.data(), low[r]);
        least.of_rows[r] = *std::min_element(each.begin(), each.end());
    }
}
/// Which of 32 numbers are no more than `limit` or than a limit of their own, a bit each.
POINTMORPH_WIDE inline std::uint32_t bits_within_wide(const float* numbers, const float* limits,
                                                      float limit) {
    const __m256 of_all = _mm256_set1_ps(limit);
    std::uint32_t bits = 0;
#pragma GCC unroll 4
    for (unsigned k = 0; k < 32; k += 8) {
        const __m256 most = _mm256_max_ps(_mm256_loadu_ps(limits + k), of_all);
        const __m256 is_within = _mm256_cmp_ps(_mm256_loadu_ps(numbers + k), most, _CMP_LE_OQ);
        bits |= std::bit_cast<std::uint32_t>(_mm256_movemask_ps(is_within)) << k;
    }
    return bits;
}
/// The same.
POINTMORPH_WIDEST inline std::uint32_t bits_within_widest(const float* numbers, const float* limits,
                                                          float limit) {
    const __m512 of_all = _mm512_set1_ps(limit);
    std::uint32_t bits = 0;
#pragma GCC unroll 2
    for (unsigned k = 0; k < 32; k += 16) {
        const __m512 most = _mm512_maskz_max_ps(0xffff, _mm512_loadu_ps(limits + k), of_all);
        const std::uint32_t its =
            _mm512_cmp_ps_mask(_mm512_loadu_ps(numbers + k), most, _CMP_LE_OQ);
        bits |= its << k;
    }
    return bits;
}
/// Two columns of each tile at once. Products are rounded before they are taken.
POINTMORPH_WIDEST inline void subtract_products_widest(const TileProducts& p) {
    // Of all lanes, as above.
    constexpr __mmask8 kAll = 0xff;
    const __m512i lower = _mm512_set_epi64(1, 1, 1, 1, 0, 0, 0, 0),
                  upper = _mm512_set_epi64(3, 3, 3, 3, 2, 2, 2, 2);
    __m512d low[4], high[4];
#pragma GCC unroll 4
    for (std::size_t k = 0; k < 4; ++k) {
        const __m512d row = _mm512_maskz_broadcast_f64x4(kAll, _mm256_loadu_pd(p.by + 4 * k));
        low[k] = _mm512_maskz_permutexvar_pd(kAll, lower, row);
        high[k] = _mm512_maskz_permutexvar_pd(kAll, upper, row);
    }
    for (std::size_t t = 0; t < p.count; ++t) {
        double* const to = p.sums + 16 * p.places[t];
        __m512d left = _mm512_loadu_pd(to), right = _mm512_loadu_pd(to + 8);
#pragma GCC unroll 4
        for (std::size_t k = 0; k < 4; ++k) {
            const __m512d column =
                _mm512_maskz_broadcast_f64x4(kAll, _mm256_loadu_pd(p.tiles + 16 * t + 4 * k));
            left = _mm512_sub_pd(left, _mm512_mul_pd(column, low[k]));
            right = _mm512_sub_pd(right, _mm512_mul_pd(column, high[k]));
        }
        _mm512_storeu_pd(to, left);
        _mm512_storeu_pd(to + 8, right);
    }
}
/// Which squared distances are less than the limit, a bit each. Where half of the axes show that
/// none is, they aren't written.
template <std::size_t kAxes>
POINTMORPH_WIDE std::uint32_t squares_of_sixteen_wide(const SixteenPoints& p, double* squared) {
    const __m256d limit = _mm256_set1_pd(p.limit);
    __m256d sums[4]{};
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
        const __m256d from = _mm256_set1_pd(p.from[axis]);
#pragma GCC unroll 4
        for (std::size_t k = 0; k < 4; ++k) {
            const __m256d to =
                _mm256_sub_pd(from, _mm256_loadu_pd(p.coordinates + 16 * axis + 4 * k));
            sums[k] = _mm256_add_pd(sums[k], _mm256_mul_pd(to, to));
        }
        if (axis + 1 != kAxes / 2) continue;
        const __m256d least =
            _mm256_min_pd(_mm256_min_pd(sums[0], sums[1]), _mm256_min_pd(sums[2], sums[3]));
        if (_mm256_movemask_pd(_mm256_cmp_pd(least, limit, _CMP_LT_OQ)) == 0) return 0;
    }
    std::uint32_t bits = 0;
#pragma GCC unroll 4
    for (unsigned k = 0; k < 4; ++k) {
        _mm256_storeu_pd(squared + 4 * k, sums[k]);
        const __m256d is_less = _mm256_cmp_pd(sums[k], limit, _CMP_LT_OQ);
        bits |= std::bit_cast<std::uint32_t>(_mm256_movemask_pd(is_less)) << (4 * k);
    }
    return bits;
}
/// The same.
template <std::size_t kAxes>
POINTMORPH_WIDEST std::uint32_t squares_of_sixteen_widest(const SixteenPoints& p, double* squared) {
    const __m512d limit = _mm512_set1_pd(p.limit);
    __m512d low = _mm512_setzero_pd(), high = low;
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
        const __m512d from = _mm512_set1_pd(p.from[axis]);
        const double* const at = p.coordinates + 16 * axis;
        const __m512d to_low = _mm512_sub_pd(from, _mm512_loadu_pd(at)),
                      to_high = _mm512_sub_pd(from, _mm512_loadu_pd(at + 8));
        low = _mm512_add_pd(low, _mm512_mul_pd(to_low, to_low));
        high = _mm512_add_pd(high, _mm512_mul_pd(to_high, to_high));
        if (axis + 1 != kAxes / 2) continue;
        if ((_mm512_cmp_pd_mask(low, limit, _CMP_LT_OQ) |
             _mm512_cmp_pd_mask(high, limit, _CMP_LT_OQ)) == 0)
            return 0;
    }
    _mm512_storeu_pd(squared, low);
    _mm512_storeu_pd(squared + 8, high);
    const std::uint32_t of_low = _mm512_cmp_pd_mask(low, limit, _CMP_LT_OQ),
                        of_high = _mm512_cmp_pd_mask(high, limit, _CMP_LT_OQ);
    return of_low | of_high << 8;
}
#else
#define POINTMORPH_WIDE
#define POINTMORPH_WIDEST
inline bool has_wide_registers() {
    return false;
}
inline bool has_fused_products() {
    return false;
}
inline bool has_widest_registers() {
    return false;
}
template <std::size_t>
void sum_products_of_four(const ProductSums&, const LeastSums&, float*) {}
template <std::size_t>
void sum_products_of_eight(const ProductSums&, const LeastSums&, float*) {}
inline std::uint32_t bits_within_wide(const float*, const float*, float) {
    return 0;
}
inline std::uint32_t bits_within_widest(const float*, const float*, float) {
    return 0;
}
inline void subtract_products_widest(const TileProducts&) {}
template <std::size_t>
std::uint32_t squares_of_sixteen_wide(const SixteenPoints&, double*) {
    return 0;
}
template <std::size_t>
std::uint32_t squares_of_sixteen_widest(const SixteenPoints&, double*) {
    return 0;
}
inline bool put_units_wide(const float*, float, float*, std::size_t) {
    return false;
}
inline bool blend_units_wide(const float*, const float*, float, const std::array<float, 2>&, float*,
                             std::size_t) {
    return false;
}
inline void take_roots_wide(double* numbers, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) numbers[i] = std::sqrt(numbers[i]);
}
#endif

/// Has memory that is read soon brought into the caches.
inline void fetch_early([[maybe_unused]] const void* place) {
#if defined(__GNUC__)
    __builtin_prefetch(place);
#endif
}

}  // namespace pointmorph
