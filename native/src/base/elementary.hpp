// exp, log, pow, sin and cos with the same bits on every system. The system's have other last bits
// from one C library to the next, and in glibc from one processor to the next: where there is a
// fused multiply-add, it is used. Here all is sums, products and quotients of IEEE's, one by one.
//
// Exponential, sine and cosine are off by less than one unit in the last place, logarithm and power
// as well, but for results that are no normal numbers.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace pointmorph {

/// A number as a double and what that lacks.
struct TwoParts {
    double head = 0.0;
    double tail = 0.0;
};

inline TwoParts exact_sum(double a, double b) {
    const double sum = a + b, other = sum - a;
    return {sum, (a - (sum - other)) + (b - other)};
}

/// Of numbers below 1e290.
inline TwoParts exact_product(double a, double b) {
    constexpr double kHalf = 134217729.0;  // 2^27 + 1
    const double a_scaled = kHalf * a, b_scaled = kHalf * b;
    const double a_high = a_scaled - (a_scaled - a), b_high = b_scaled - (b_scaled - b);
    const double a_low = a - a_high, b_low = b - b_high, product = a * b;
    return {product,
            ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low};
}

/// The nearest whole number, of numbers below 2^51.
inline double nearest_whole(double x) {
    constexpr double kShift = 0x1.8p52;
    return (x + kShift) - kShift;
}

/// 2^exponent, for exponents of normal numbers.
inline double power_of_two(std::int64_t exponent) {
    return std::bit_cast<double>(static_cast<std::uint64_t>(exponent + 1023) << 52);
}

/// 2^(k/16).
inline constexpr std::array<TwoParts, 16> kSixteenths = {
    {{0x1.0000000000000p+0, 0x0.0p+0},
     {0x1.0b5586cf9890fp+0, 0x1.8a62e4adc610bp-54},
     {0x1.172b83c7d517bp+0, -0x1.19041b9d78a76p-55},
     {0x1.2387a6e756238p+0, 0x1.9b07eb6c70573p-54},
     {0x1.306fe0a31b715p+0, 0x1.6f46ad23182e4p-55},
     {0x1.3dea64c123422p+0, 0x1.ada0911f09ebcp-55},
     {0x1.4bfdad5362a27p+0, 0x1.d4397afec42e2p-56},
     {0x1.5ab07dd485429p+0, 0x1.6324c054647adp-54},
     {0x1.6a09e667f3bcdp+0, -0x1.bdd3413b26456p-54},
     {0x1.7a11473eb0187p+0, -0x1.41577ee04992fp-55},
     {0x1.8ace5422aa0dbp+0, 0x1.6e9f156864b27p-54},
     {0x1.9c49182a3f090p+0, 0x1.c7c46b071f2bep-56},
     {0x1.ae89f995ad3adp+0, 0x1.7a1cd345dcc81p-54},
     {0x1.c199bdd85529cp+0, 0x1.11065895048ddp-55},
     {0x1.d5818dcfba487p+0, 0x1.2ed02d75b3707p-55},
     {0x1.ea4afa2a490dap+0, -0x1.e9c23179c2893p-54}}};

/// ln 2; products of its head with whole numbers below 2^11 are exact.
inline constexpr TwoParts kLn2 = {0x1.62e42fefa3800p-1, 0x1.ef35793c76730p-45};

/// ln(k/32) from 24 on; the heads are multiples of 2^-42.
inline constexpr std::array<TwoParts, 25> kLogarithms = {
    {{-0x1.269621134e000p-2, 0x1.1b61f10522625p-44},
     {-0x1.f991c6cb3c000p-3, 0x1.90d04cd7cc834p-44},
     {-0x1.a93ed3c8ae000p-3, 0x1.8724350562169p-45},
     {-0x1.5bf406b544000p-3, 0x1.27023eb68981cp-46},
     {-0x1.1178e8227e000p-3, -0x1.1ef78ce2d07f2p-45},
     {-0x1.9335e5d594000p-4, -0x1.3115c3abd47dap-45},
     {-0x1.08598b59e4000p-4, 0x1.7e5dd7009902cp-46},
     {-0x1.0415d89e78000p-5, 0x1.dddc7f461c516p-44},
     {0x0.0p+0, 0x0.0p+0},
     {0x1.f829b0e780000p-6, 0x1.980267c7e09e4p-45},
     {0x1.f0a30c0118000p-5, -0x1.d599e83368e91p-45},
     {0x1.6f0d28ae58000p-4, -0x1.4b4641b664613p-44},
     {0x1.e27076e2b0000p-4, -0x1.a342c2af0003cp-45},
     {0x1.29552f8200000p-3, -0x1.5b967f4471dfcp-44},
     {0x1.5ff3070a7a000p-3, -0x1.8586f183bebf2p-44},
     {0x1.9525a9cf46000p-3, -0x1.297137d9f158fp-44},
     {0x1.c8ff7c79aa000p-3, -0x1.7794f689f8434p-45},
     {0x1.fb9186d5e4000p-3, -0x1.d572aab993c87p-47},
     {0x1.1675cababa000p-2, 0x1.8380e731f55c4p-44},
     {0x1.2e8e2bae12000p-2, -0x1.67b1e99b72bd8p-45},
     {0x1.4618bc21c6000p-2, -0x1.3d82f484c84ccp-46},
     {0x1.5d1bdbf581000p-2, -0x1.8d6bdc9c7c238p-44},
     {0x1.739d7f6bbd000p-2, 0x1.a7389314feb50p-52},
     {0x1.89a3386c14000p-2, 0x1.2d5ad38c40882p-45},
     {0x1.9f323ecbfa000p-2, -0x1.ed03525ca2643p-44}}};

/// e to the power of x; `rest` is what a double can't hold of it.
inline double exponential(double x, double rest = 0.0) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    if (!(std::abs(x) < 746.0)) return x > 0.0 ? kInfinity : x < 0.0 ? 0.0 : x;
    constexpr TwoParts kStep = {0x1.62e42ff000000p-5, -0x1.718432a1b0e26p-39};  // ln 2 / 16
    const double steps = nearest_whole(x * 0x1.71547652b82fep+4);
    const double r = (x - steps * kStep.head) + (rest - steps * kStep.tail), square = r * r;
    const double sum =
        1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0))));
    const double grown = r + (0.5 * square + r * square * sum);
    const auto count = static_cast<std::int64_t>(steps);
    const TwoParts& part = kSixteenths[static_cast<std::size_t>(count & 15)];
    const double share = part.head + (part.tail + part.head * grown);
    const std::int64_t exponent = count >> 4;
    if (exponent > -1022 && exponent < 1024) return share * power_of_two(exponent);
    return share * power_of_two(exponent / 2) * power_of_two(exponent - exponent / 2);
}

/// The natural logarithm, of positive numbers.
inline TwoParts logarithm_parts(double x) {
    std::int64_t exponent = 0;
    if (x < std::numeric_limits<double>::min()) {
        x *= 0x1p54;
        exponent = -54;
    }
    const auto bits = std::bit_cast<std::int64_t>(x);
    const std::int64_t binades = (bits - std::bit_cast<std::int64_t>(0.75)) >> 52;
    exponent += binades;
    const double m = std::bit_cast<double>(bits - binades * (std::int64_t{1} << 52));
    const double place = nearest_whole(32.0 * m), c = place / 32.0;
    // ln(m / c) = 2 artanh((m - c) / (m + c))
    const double difference = m - c;
    const TwoParts sum = exact_sum(m, c);
    const double s = difference / sum.head, square = s * s;
    const TwoParts back = exact_product(s, sum.head);
    const double rest = ((difference - back.head) - back.tail - s * sum.tail) / sum.head;
    const TwoParts& whole = kLogarithms[static_cast<std::size_t>(place) - 24];
    const auto times = static_cast<double>(exponent);
    const TwoParts result = exact_sum(times * kLn2.head + whole.head, 2.0 * s);
    const double series =
        s * square * (2.0 / 3.0 + square * (2.0 / 5.0 + square * (2.0 / 7.0 + square * 2.0 / 9.0)));
    return {result.head, result.tail + (2.0 * rest + (times * kLn2.tail + whole.tail) + series)};
}

inline double logarithm(double x) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    if (x > 0.0 && x < kInfinity) {
        const TwoParts parts = logarithm_parts(x);
        return parts.head + parts.tail;
    }
    if (x == 0.0) return -kInfinity;
    return x > 0.0 || std::isnan(x) ? x : std::numeric_limits<double>::quiet_NaN();
}

/// The logarithm of 1 + x, also where x is small.
inline double logarithm_after_one(double x) {
    const double sum = 1.0 + x;
    if (sum == 1.0) return x;
    if (!(sum > 0.0 && sum < 1e300)) return logarithm(sum);
    return logarithm(sum) * (x / (sum - 1.0));
}

/// x to the power of y, where x is positive and finite.
inline double positive_power(double x, double y) {
    if (x == 1.0) return 1.0;
    if (std::abs(y) > 0x1p65)
        return (x > 1.0) == (y > 0.0) ? std::numeric_limits<double>::infinity() : 0.0;
    const TwoParts logarithm = logarithm_parts(x);
    const TwoParts product = exact_product(y, logarithm.head);
    return exponential(product.head, product.tail + y * logarithm.tail);
}

/// x to the power of y; special values as std::pow has them.
inline double power(double x, double y) {
    if (y == 0.0 || x == 1.0) return 1.0;
    if (y == 1.0 || std::isnan(x)) return x;
    if (std::isnan(y)) return y;
    const double size = std::abs(x);
    const bool is_whole = std::isinf(y) || std::trunc(y) == y;
    if (x < 0.0 && !std::isinf(x) && !is_whole) return std::numeric_limits<double>::quiet_NaN();
    const bool is_odd = is_whole && !std::isinf(y) && std::fmod(y, 2.0) != 0.0;
    double result = 0.0;
    if (size == 0.0 || std::isinf(size))
        result = (size == 0.0) == (y > 0.0) ? 0.0 : std::numeric_limits<double>::infinity();
    else
        result = positive_power(size, y);
    return std::signbit(x) && is_odd ? -result : result;
}

/// The quarter turns in an angle, and what is left, from −π/4 to π/4. Angles of more than a million
/// are taken for what is left of them over double(2π).
class QuarterTurns {
public:
    explicit QuarterTurns(double angle) : rest_{angle, 0.0} {
        if (std::isinf(angle)) rest_.head = std::numeric_limits<double>::quiet_NaN();
        if (!(std::abs(rest_.head) > 0.785)) return;
        if (std::abs(angle) > 1e6) angle = std::fmod(angle, 0x1.921fb54442d18p+2);
        const double turns = nearest_whole(angle * 0x1.45f306dc9c883p-1);
        const TwoParts left =
            exact_sum(angle - turns * 0x1.921fb54400000p+0, -turns * 0x1.0b4611a600000p-34);
        rest_ = exact_sum(left.head, left.tail - turns * 0x1.3198a2e037073p-69);
        count_ = static_cast<std::int64_t>(turns) & 3;
    }

    double sine() const {
        const double size = count_ % 2 == 0 ? sine_of_rest() : cosine_of_rest();
        return count_ < 2 ? size : -size;
    }

    double cosine() const {
        const double size = count_ % 2 == 0 ? cosine_of_rest() : sine_of_rest();
        return count_ == 0 || count_ == 3 ? size : -size;
    }

private:
    double sine_of_rest() const {
        constexpr std::array<double, 8> kFactors = {
            1.0 / 355687428096000.0, -1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0,
            1.0 / 362880.0,          -1.0 / 5040.0,          1.0 / 120.0,        -1.0 / 6.0};
        const double square = rest_.head * rest_.head;
        double sum = 0.0;
        for (const double factor : kFactors) sum = factor + square * sum;
        return rest_.head + (rest_.head * square * sum + rest_.tail * (1.0 - 0.5 * square));
    }

    double cosine_of_rest() const {
        constexpr std::array<double, 7> kFactors = {
            1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
            1.0 / 40320.0,          -1.0 / 720.0,         1.0 / 24.0};
        const double square = rest_.head * rest_.head, half = 0.5 * square, most = 1.0 - half;
        double sum = 0.0;
        for (const double factor : kFactors) sum = factor + square * sum;
        return most + (((1.0 - most) - half) + (square * square * sum - rest_.head * rest_.tail));
    }

    TwoParts rest_;
    std::int64_t count_ = 0;
};

inline double sine_of(double angle) {
    return QuarterTurns(angle).sine();
}

inline double cosine_of(double angle) {
    return QuarterTurns(angle).cosine();
}

}  // namespace pointmorph
