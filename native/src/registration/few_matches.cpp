#include "registration/few_matches.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>

#include "base/compiler.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr std::size_t kAxes = ProductPoints::ColsAtCompileTime;
constexpr std::size_t kStrip = 4;   // sources that are compared at once ...
constexpr std::size_t kBlock = 16;  // ... with so many targets
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
          source_squares(to_size(s.rows()) + kStrip, 0.0f),
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

/// The nearest of some of the sources, and what these are to the targets.
class Comparison {
public:
    Nearest forward, backward;

    Comparison(const InFloats& floats, std::size_t begin, std::size_t end)
        : forward(to_size(floats.source.rows())),
          backward(to_size(floats.target.rows())),
          floats_(floats),
          begin_(begin),
          end_(end),
          bounds_(floats.padded, -kFar) {}

    void guess(const Matches& of_targets) {
        for (std::size_t j = 0; j < of_targets.to.size(); ++j)
            backward.add(j, exact(to_size(of_targets.to[j]), j), of_targets.to[j]);
    }
    /// Of the sources, and of the targets where they are wanted.
    void run(bool both) {
        if (both)
            for (std::size_t j = 0; j < backward.to.size(); ++j) bound(j);
        if (has_wide_registers())
            run_wide();
        else
            run_with<FourFloats>();
    }

private:
    double exact(std::size_t i, std::size_t j) const {
        return squared_distance(floats_.source.data() + kAxes * i,
                                floats_.target.data() + kAxes * j);
    }
    void bound(std::size_t j) { bounds_[j] = raised(backward.squared[j] + floats_.error); }

    POINTMORPH_WIDE void run_wide() { run_with<EightFloats>(); }

    template <class Floats>
    POINTMORPH_INLINE void run_with() {
        std::vector<float> strip(kStrip * floats_.padded);
        for (std::size_t first = begin_; first < end_; first += kStrip) {
            std::array<float, kStrip> least;
            compare<Floats>(first, strip.data(), least);
            for (std::size_t r = 0; r < std::min(kStrip, end_ - first); ++r)
                look<Floats>(first + r, strip.data() + r * floats_.padded,
                             raised(least[r] + 2.0 * floats_.error));
        }
    }

    /// Squared distances of a strip to all targets, and the least of each row.
    template <class Floats>
    POINTMORPH_INLINE void compare(std::size_t first, float* strip,
                                   std::array<float, kStrip>& least) const {
        constexpr std::size_t kLanes = sizeof(Floats) / sizeof(float), kTwice = 2 * kLanes;
        const float* const rows = floats_.sources.data() + kAxes * first;
        std::array<Floats, kStrip> lowest;
        for (Floats& low : lowest) low = Floats{} + kFar;
        for (std::size_t at = 0; at < floats_.padded; at += kTwice) {
            Floats left[kStrip], right[kStrip], column, next;
            std::memcpy(&column, floats_.target_squares.data() + at, sizeof column);
            std::memcpy(&next, floats_.target_squares.data() + at + kLanes, sizeof next);
            for (std::size_t r = 0; r < kStrip; ++r) {
                left[r] = column + floats_.source_squares[first + r];
                right[r] = next + floats_.source_squares[first + r];
            }
            for (std::size_t axis = 0; axis < kAxes; ++axis) {
                const float* const from = floats_.targets.data() + axis * floats_.padded + at;
                std::memcpy(&column, from, sizeof column);
                std::memcpy(&next, from + kLanes, sizeof next);
                for (std::size_t r = 0; r < kStrip; ++r) {
                    left[r] += rows[kAxes * r + axis] * column;
                    right[r] += rows[kAxes * r + axis] * next;
                }
            }
            for (std::size_t r = 0; r < kStrip; ++r) {
                float* const to = strip + r * floats_.padded + at;
                const Floats lower = left[r] < right[r] ? left[r] : right[r];
                lowest[r] = lower < lowest[r] ? lower : lowest[r];
                std::memcpy(to, &left[r], sizeof column);
                std::memcpy(to + kLanes, &right[r], sizeof next);
            }
        }
        for (std::size_t r = 0; r < kStrip; ++r) {
            std::array<float, kLanes> each;
            std::memcpy(each.data(), &lowest[r], sizeof each);
            least[r] = *std::ranges::min_element(each);
        }
    }

    /// Compares exactly what may be the nearest of source `i` or have it as its nearest.
    template <class Floats>
    POINTMORPH_INLINE void look(std::size_t i, const float* strip, float bound) {
        constexpr std::size_t kLanes = sizeof(Floats) / sizeof(float);
        for (std::size_t at = 0; at < floats_.padded; at += kBlock) {
            auto near = Floats{} < Floats{};
            for (std::size_t k = 0; k < kBlock; k += kLanes) {
                Floats squared, bounds;
                std::memcpy(&squared, strip + at + k, sizeof squared);
                std::memcpy(&bounds, bounds_.data() + at + k, sizeof bounds);
                near |= (squared <= bounds) | (squared <= Floats{} + bound);
            }
            std::array<std::uint64_t, (sizeof near + 7) / 8> words{};
            std::memcpy(words.data(), &near, sizeof near);
            std::uint64_t any = 0;
            for (const std::uint64_t word : words) any |= word;
            if (any != 0) look_closely(i, strip, at, bound);
        }
    }

    void look_closely(std::size_t i, const float* strip, std::size_t at, float its_bound) {
        const std::size_t end = std::min(at + kBlock, backward.to.size());
        for (std::size_t j = at; j < end; ++j) {
            if (!(strip[j] <= its_bound || strip[j] <= bounds_[j])) continue;
            const double squared = exact(i, j);
            forward.add(i, squared, to_index(j));
            if (!(strip[j] <= bounds_[j])) continue;
            backward.add(j, squared, to_index(i));
            bound(j);
        }
    }

    const InFloats& floats_;
    std::size_t begin_, end_;
    std::vector<float> bounds_;  ///< of each target: what seems farther off isn't nearer
};

}  // namespace

bool fits_floats(const ProductPoints& points) {
    constexpr double kMost = 1e15;
    return points.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() < kMost;
}

std::pair<Matches, Matches> matches_both_ways_of_few(const ProductPoints& source,
                                                     const ProductPoints& target,
                                                     const Matches* guess) {
    const InFloats floats(source, target);
    const std::size_t count = to_size(source.rows()), half = count / 2 / kStrip * kStrip;
    std::array parts{Comparison(floats, 0, half), Comparison(floats, half, count)};
    parallel_invoke(2, [&](int k, bool) {
        Comparison& part = parts[to_size(k)];
        if (guess) part.guess(*guess);
        part.run(true);
    });
    auto& [first, second] = parts;
    for (std::size_t i = half; i < count; ++i)
        first.forward.add(i, second.forward.squared[i], second.forward.to[i]);
    for (std::size_t j = 0; j < first.backward.to.size(); ++j)
        first.backward.add(j, second.backward.squared[j], second.backward.to[j]);
    return {std::move(first.forward).matches(), std::move(first.backward).matches()};
}

Matches matches_of_few(const ProductPoints& source, const ProductPoints& target) {
    const InFloats floats(source, target);
    Comparison comparison(floats, 0, to_size(source.rows()));
    comparison.run(false);
    return std::move(comparison.forward).matches();
}

}  // namespace pointmorph
