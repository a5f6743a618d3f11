#include "registration/few_matches.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>

#include "base/compiler.hpp"
#include "base/unset.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kAxes = ProductPoints::ColsAtCompileTime;
constexpr std::size_t kStrip = 8;   // sources that are compared at once ...
constexpr std::size_t kBlock = 32;  // ... with so many targets
constexpr float kFar = std::numeric_limits<float>::infinity();

/// A kd-tree's distance, to the bit.
double squared_distance(const double* a, const double* b) {
    double sum = 0.0;
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
        const double to = a[axis] - b[axis];
        sum += to * to;
    }
    return sum;
}

double square_of(const double* a) {
    double sum = 0.0;
    for (std::size_t axis = 0; axis < kAxes; ++axis) sum += a[axis] * a[axis];
    return sum;
}

/// No less than the number is.
float raised(double number) {
    return static_cast<float>(number * (1.0 + 1e-6));
}

/// The nearest of what has been compared exactly, of each row of an array.
struct Nearest {
    std::vector<double> squared;
    std::vector<Index> to;

    explicit Nearest(std::size_t count)
        : squared(count, std::numeric_limits<double>::infinity()), to(count, -1) {}

    void add(std::size_t row, double its_squared, Index other) {
        if (its_squared < squared[row] || (its_squared == squared[row] && other < to[row])) {
            squared[row] = its_squared;
            to[row] = other;
        }
    }
    Matches matches() && {
        std::vector<double> distances(squared.size());
        std::ranges::transform(squared, distances.begin(), [](double s) { return std::sqrt(s); });
        return {std::move(to), std::move(distances)};
    }
};

/// Both arrays in floats, of which |s − t|² = |s|² + |t|² − 2 s·t rules out all but a few pairs.
struct InFloats {
    const ProductPoints &source, &target;
    std::size_t padded;                          ///< targets, with some that are infinitely far off
    std::vector<float> sources, source_squares;  ///< row by row
    std::vector<float> targets, target_squares;  ///< axis by axis, −2 times
    double error;                                ///< of a squared distance, at most

    InFloats(const ProductPoints& s, const ProductPoints& t)
        : source(s),
          target(t),
          padded((to_size(t.rows()) + kBlock - 1) / kBlock * kBlock),
          sources(kAxes * (to_size(s.rows()) + kStrip), 0.0f),
          source_squares(to_size(s.rows()) + kStrip, kFar),
          targets(kAxes * padded, 0.0f),
          target_squares(padded, kFar) {
        double longest_source = 0.0, longest_target = 0.0;
        for (std::size_t i = 0; i < to_size(s.rows()); ++i) {
            const double* const row = s.data() + kAxes * i;
            const double square = square_of(row);
            for (std::size_t k = 0; k < kAxes; ++k)
                sources[kAxes * i + k] = static_cast<float>(row[k]);
            source_squares[i] = static_cast<float>(square);
            longest_source = std::max(longest_source, square);
        }
        for (std::size_t j = 0; j < to_size(t.rows()); ++j) {
            const double* const row = t.data() + kAxes * j;
            const double square = square_of(row);
            for (std::size_t k = 0; k < kAxes; ++k)
                targets[padded * k + j] = static_cast<float>(-2.0 * row[k]);
            target_squares[j] = static_cast<float>(square);
            longest_target = std::max(longest_target, square);
        }
        // Each of the 12 products and sums is off by 2⁻²⁴ of what is summed; twice as much as all.
        error = 40.0 * 0x1p-24 * (longest_source + longest_target);
    }
};

/// Squared distances of four sources to all targets, the least of each source, and of each target
/// if it is less than before.
void sum_products_plainly(const ProductSums& p, const LeastSums& least, float* sums) {
    constexpr std::size_t kRows = 4, kLanes = sizeof(FourFloats) / sizeof(float);
    std::array<FourFloats, kRows> lowest;
    for (FourFloats& low : lowest) low = FourFloats{} + kFar;
    for (std::size_t at = 0; at < p.stride; at += 2 * kLanes) {
        FourFloats left[kRows], right[kRows], column, next;
        std::memcpy(&column, p.column_starts + at, sizeof column);
        std::memcpy(&next, p.column_starts + at + kLanes, sizeof next);
        for (std::size_t r = 0; r < kRows; ++r) {
            left[r] = column + p.row_starts[r];
            right[r] = next + p.row_starts[r];
        }
        for (std::size_t k = 0; k < kAxes; ++k) {
            const float* const from = p.columns + k * p.stride + at;
            std::memcpy(&column, from, sizeof column);
            std::memcpy(&next, from + kLanes, sizeof next);
            for (std::size_t r = 0; r < kRows; ++r) {
                left[r] += p.factors[kAxes * r + k] * column;
                right[r] += p.factors[kAxes * r + k] * next;
            }
        }
        for (std::size_t r = 0; r < kRows; ++r) {
            float* const to = sums + r * p.stride + at;
            const FourFloats lower = left[r] < right[r] ? left[r] : right[r];
            lowest[r] = lower < lowest[r] ? lower : lowest[r];
            std::memcpy(to, &left[r], sizeof column);
            std::memcpy(to + kLanes, &right[r], sizeof next);
        }
        float* const of_columns = least.of_columns + at;
        std::memcpy(&column, of_columns, sizeof column);
        std::memcpy(&next, of_columns + kLanes, sizeof next);
        for (std::size_t r = 0; r < kRows; ++r) {
            column = left[r] < column ? left[r] : column;
            next = right[r] < next ? right[r] : next;
        }
        std::memcpy(of_columns, &column, sizeof column);
        std::memcpy(of_columns + kLanes, &next, sizeof next);
    }
    for (std::size_t r = 0; r < kRows; ++r) {
        std::array<float, kLanes> each;
        std::memcpy(each.data(), &lowest[r], sizeof each);
        least.of_rows[r] = *std::ranges::min_element(each);
    }
}

/// As bits_within_wide(), but all bits where any of the numbers is.
std::uint32_t bits_within_plainly(const float* numbers, const float* limits, float limit) {
    constexpr std::size_t kLanes = sizeof(FourFloats) / sizeof(float);
    auto any = FourFloats{} < FourFloats{};
    for (std::size_t k = 0; k < kBlock; k += kLanes) {
        FourFloats number, most;
        std::memcpy(&number, numbers + k, sizeof number);
        std::memcpy(&most, limits + k, sizeof most);
        any |= (number <= most) | (number <= FourFloats{} + limit);
    }
    std::array<std::uint64_t, (sizeof any + 7) / 8> words{};
    std::memcpy(words.data(), &any, sizeof any);
    std::uint64_t all = 0;
    for (const std::uint64_t word : words) all |= word;
    return all != 0 ? ~std::uint32_t{0} : 0;
}

FloatRegisters registers_within(FloatRegisters most) {
    const FloatRegisters widest = has_widest_registers() ? FloatRegisters::kOfSixteen
                                  : has_fused_products() ? FloatRegisters::kOfEight
                                                         : FloatRegisters::kOfFour;
    return std::min(most, widest);
}

/// The nearest of some of the sources, and what these are to the targets.
class Comparison {
public:
    Nearest forward, backward;

    /// `of_targets`: what is near the targets as far as it is known.
    Comparison(const InFloats& floats, std::size_t begin, std::size_t end, Nearest of_targets,
               FloatRegisters registers)
        : forward(to_size(floats.source.rows())),
          backward(std::move(of_targets)),
          floats_(floats),
          begin_(begin),
          end_(end),
          registers_(registers),
          bounds_(floats.padded, -kFar) {}

    /// Of the sources, and of the targets where they are wanted.
    void run(bool both) {
        if (both)
            for (std::size_t j = 0; j < backward.to.size(); ++j) {
                bounds_[j] = kFar;
                bound(j);
            }
        // As much as stays in a core's cache.
        constexpr std::size_t kMost = std::size_t{1} << 17;
        const std::size_t rows = std::max(kStrip, kMost / floats_.padded / kStrip * kStrip);
        sums_.resize(std::min(rows, (end_ - begin_ + kStrip - 1) / kStrip * kStrip) *
                     floats_.padded);
        for (std::size_t first = begin_; first < end_; first += rows)
            look_at(first, std::min(first + rows, end_), both);
    }

private:
    double exact(std::size_t i, std::size_t j) const {
        return squared_distance(floats_.source.data() + kAxes * i,
                                floats_.target.data() + kAxes * j);
    }
    void bound(std::size_t j) {
        bounds_[j] = std::min(bounds_[j], raised(backward.squared[j] + floats_.error));
    }

    /// Of some sources. What floats show to be near some target at all is known before any is
    /// compared exactly.
    void look_at(std::size_t begin, std::size_t end, bool both) {
        std::vector<float> of_rows(end - begin + kStrip), of_columns(floats_.padded, kFar);
        for (std::size_t first = begin; first < end; first += kStrip)
            compare(first, {of_rows.data() + (first - begin), of_columns.data()},
                    sums_.data() + (first - begin) * floats_.padded);
        if (both)
            for (std::size_t j = 0; j < backward.to.size(); ++j)
                bounds_[j] = std::min(bounds_[j], raised(of_columns[j] + 2.0 * floats_.error));
        for (std::size_t i = begin; i < end; ++i)
            look(i, sums_.data() + (i - begin) * floats_.padded,
                 raised(of_rows[i - begin] + 2.0 * floats_.error));
    }

    /// Squared distances of a strip to all targets.
    void compare(std::size_t first, LeastSums least, float* strip) const {
        constexpr std::size_t kHalf = kStrip / 2;
        ProductSums products{floats_.sources.data() + kAxes * first,
                             floats_.source_squares.data() + first, floats_.targets.data(),
                             floats_.target_squares.data(), floats_.padded};
        if (registers_ == FloatRegisters::kOfSixteen)
            return sum_products_of_eight<kAxes>(products, least, strip);
        for (int half = 0; half < 2; ++half) {
            (registers_ == FloatRegisters::kOfEight ? sum_products_of_four<kAxes>
                                                    : sum_products_plainly)(products, least, strip);
            products.factors += kAxes * kHalf;
            products.row_starts += kHalf;
            strip += kHalf * floats_.padded;
            least.of_rows += kHalf;
        }
    }

    /// Compares exactly what may be the nearest of source `i` or have it as its nearest.
    void look(std::size_t i, const float* strip, float its_bound) {
        const auto bits_within = registers_ == FloatRegisters::kOfSixteen ? bits_within_widest
                                 : registers_ == FloatRegisters::kOfEight ? bits_within_wide
                                                                          : bits_within_plainly;
        for (std::size_t at = 0; at < floats_.padded; at += kBlock)
            for (std::uint32_t bits = bits_within(strip + at, bounds_.data() + at, its_bound);
                 bits != 0; bits &= bits - 1)
                look_closely(i, at + static_cast<std::size_t>(std::countr_zero(bits)), strip,
                             its_bound);
    }

    void look_closely(std::size_t i, std::size_t j, const float* strip, float its_bound) {
        const bool is_near = strip[j] <= bounds_[j];
        if (!is_near && !(strip[j] <= its_bound)) return;
        const double squared = backward.to[j] == to_index(i) ? backward.squared[j] : exact(i, j);
        forward.add(i, squared, to_index(j));
        if (!is_near) return;
        backward.add(j, squared, to_index(i));
        bound(j);
    }

    const InFloats& floats_;
    std::size_t begin_, end_;
    FloatRegisters registers_;
    std::vector<float> bounds_;  ///< of each target: what seems farther off isn't nearer
    UnsetVector<float> sums_;    ///< of some sources, row by row
};

}  // namespace

bool fits_floats(const ProductPoints& points) {
    constexpr double kMost = 1e15;
    return (points.array().abs() < kMost).all();
}

std::pair<Matches, Matches> matches_both_ways_of_few(const ProductPoints& source,
                                                     const ProductPoints& target,
                                                     const Matches* guess, FloatRegisters most) {
    const InFloats floats(source, target);
    const std::size_t count = to_size(source.rows()), half = count / 2 / kStrip * kStrip;
    Nearest guessed(to_size(target.rows()));
    if (guess)
        for (std::size_t j = 0; j < guess->to.size(); ++j) {
            const auto i = guess->to[j];
            guessed.add(j, squared_distance(source.row(i).data(), target.row(to_index(j)).data()),
                        i);
        }
    const FloatRegisters registers = registers_within(most);
    std::array parts{Comparison(floats, 0, half, guessed, registers),
                     Comparison(floats, half, count, guessed, registers)};
    parallel_invoke(2, [&](int k, bool) { parts[to_size(k)].run(true); });
    auto& [first, second] = parts;
    for (std::size_t i = half; i < count; ++i)
        first.forward.add(i, second.forward.squared[i], second.forward.to[i]);
    for (std::size_t j = 0; j < first.backward.to.size(); ++j)
        first.backward.add(j, second.backward.squared[j], second.backward.to[j]);
    return {std::move(first.forward).matches(), std::move(first.backward).matches()};
}

Matches matches_of_few(const ProductPoints& source, const ProductPoints& target,
                       FloatRegisters most) {
    const InFloats floats(source, target);
    Comparison comparison(floats, 0, to_size(source.rows()), Nearest(to_size(target.rows())),
                          registers_within(most));
    comparison.run(false);
    return std::move(comparison.forward).matches();
}

}  // namespace pointmorph
