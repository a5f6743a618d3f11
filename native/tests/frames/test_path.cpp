#include "pointmorph/frames/path.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <new>
#include <random>

#include "allocations.hpp"
#include "pointmorph/base/error.hpp"
#include "pointmorph/base/parallel.hpp"
#include "shapes.hpp"

namespace pointmorph {
namespace {

/// Not a multiple of a block, and more than one chunk.
constexpr Index kPoints = 9'001;

/// Numbers of both signs, ±0 among them, in the caller's type; unit normals.
template <class Scalar>
Cloud random_cloud(Index count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    Cloud cloud;
    const auto fill = [&](auto& rows, Eigen::Index r, Eigen::Index c) {
        rows.resize(r, c);
        for (Eigen::Index i = 0; i < rows.size(); ++i) {
            using Number = std::decay_t<decltype(rows.data()[i])>;
            rows.data()[i] = static_cast<Number>(static_cast<Scalar>(uniform(random)));
            if (i % 17 == 0) rows.data()[i] = i % 2 == 0 ? Number(0.0) : Number(-0.0);
        }
    };
    fill(cloud.positions, count, 3);
    fill(cloud.normals, count, 3);
    fill(cloud.colors, count, 4);
    cloud.colors = cloud.colors.cwiseAbs();
    fill(cloud.radii, count, 1);
    cloud.radii = cloud.radii.cwiseAbs();
    for (Index i = 0; i < count; ++i) {
        const Vector3 unit = cloud.normals.row(i).transpose().normalized();
        for (int d = 0; d < 3; ++d) cloud.normals(i, d) = static_cast<Scalar>(unit[d]);
    }
    return cloud;
}

std::vector<IndexPair> random_pairs(Index rows, Index count, unsigned seed) {
    std::mt19937_64 random(seed);
    std::uniform_int_distribution<Index> row(0, rows - 1);
    std::vector<IndexPair> pairs;
    for (Index i = 0; i < count; ++i) pairs.push_back({row(random), row(random)});
    return pairs;
}

template <class Scalar>
struct Frame {
    explicit Frame(Index count)
        : positions(3 * to_size(count)),
          normals(3 * to_size(count)),
          colors(4 * to_size(count)),
          radii(to_size(count)) {}

    FrameView<Scalar> view() { return {positions, normals, colors, radii}; }
    bool operator==(const Frame&) const = default;

    std::vector<Scalar> positions, normals, colors, radii;
};

template <class Scalar>
Frame<Scalar> frame_at(const StraightPath<Scalar>& path, double t) {
    Frame<Scalar> frame(path.size());
    path.frame(t, frame.view());
    return frame;
}

template <class Scalar>
bool same_bits(Scalar a, Scalar b) {
    using Bits = std::conditional_t<sizeof(Scalar) == 4, std::uint32_t, std::uint64_t>;
    return std::bit_cast<Bits>(a) == std::bit_cast<Bits>(b);
}

/// How many of the frame's numbers differ in any bit from the clouds' rows.
template <class Scalar>
int different_bits(const Frame<Scalar>& frame, const Cloud& cloud,
                   const std::vector<IndexPair>& pairs, Index IndexPair::*side) {
    int different = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const Index row = pairs[i].*side;
        for (int d = 0; d < 3; ++d) {
            const auto k = 3 * i + to_size(d);
            different += !same_bits(frame.positions[k], Scalar(cloud.positions(row, d)));
            different += !same_bits(frame.normals[k], Scalar(cloud.normals(row, d)));
        }
        for (int d = 0; d < 4; ++d)
            different += !same_bits(frame.colors[4 * i + to_size(d)], Scalar(cloud.colors(row, d)));
        different += !same_bits(frame.radii[i], Scalar(cloud.radii[row]));
    }
    return different;
}

Cloud one_point(const Vector3& position, const Vector3& normal) {
    Cloud cloud;
    cloud.positions = position.transpose();
    cloud.normals = normal.transpose();
    cloud.radii = Values::Constant(1, 0.5);
    return cloud;
}

template <class Scalar>
Vector3 normal_at(const Vector3& source, const Vector3& target, double t) {
    const std::vector<IndexPair> pairs{{0, 0}};
    const StraightPath<Scalar> path(one_point(Vector3::Zero(), source),
                                    one_point(Vector3::Zero(), target), pairs);
    const auto frame = frame_at(path, t);
    return {frame.normals[0], frame.normals[1], frame.normals[2]};
}

template <class Scalar>
class PathOf : public testing::Test {
protected:
    const Cloud source = random_cloud<Scalar>(kPoints, 1),
                target = random_cloud<Scalar>(kPoints, 2);
    const std::vector<IndexPair> pairs = random_pairs(kPoints, kPoints + 100, 3);
    const StraightPath<Scalar> path{source, target, pairs};
    static constexpr Scalar kEpsilon = std::numeric_limits<Scalar>::epsilon();
};
using Scalars = testing::Types<float, double>;
TYPED_TEST_SUITE(PathOf, Scalars);

TYPED_TEST(PathOf, EndsAreTheInputsBitForBit) {
    EXPECT_EQ(
        different_bits(frame_at(this->path, 0.0), this->source, this->pairs, &IndexPair::source),
        0);
    EXPECT_EQ(
        different_bits(frame_at(this->path, 1.0), this->target, this->pairs, &IndexPair::target),
        0);
    // The test can tell: a frame past the end is another cloud.
    EXPECT_GT(
        different_bits(frame_at(this->path, 1e-3), this->source, this->pairs, &IndexPair::source),
        0);
}

TYPED_TEST(PathOf, IsEquationFiveToRounding) {
    for (const double t : {1e-9, 0.1, 0.25, 0.4999, 0.5, 0.7, 0.999999}) {
        const auto frame = frame_at(this->path, t);
        for (std::size_t i = 0; i < this->pairs.size(); ++i) {
            const auto [s, e] = this->pairs[i];
            const auto mix = [&](double a, double b) { return (1 - t) * a + t * b; };
            for (int d = 0; d < 3; ++d)
                ASSERT_NEAR(frame.positions[3 * i + to_size(d)],
                            mix(this->source.positions(s, d), this->target.positions(e, d)),
                            4 * this->kEpsilon);
            for (int d = 0; d < 4; ++d)
                ASSERT_NEAR(frame.colors[4 * i + to_size(d)],
                            mix(this->source.colors(s, d), this->target.colors(e, d)),
                            4 * this->kEpsilon);
            ASSERT_NEAR(frame.radii[i], mix(this->source.radii[s], this->target.radii[e]),
                        4 * this->kEpsilon);
            const Vector3 mean = (1 - t) * this->source.normals.row(s).transpose() +
                                 t * this->target.normals.row(e).transpose();
            const Vector3 unit = mean.normalized();
            for (int d = 0; d < 3; ++d)
                ASSERT_NEAR(frame.normals[3 * i + to_size(d)], unit[d],
                            8 * this->kEpsilon / mean.norm());
        }
    }
}

TYPED_TEST(PathOf, NormalsHaveUnitLength) {
    for (const double t : {0.01, 0.5, 0.77}) {
        const auto frame = frame_at(this->path, t);
        for (std::size_t i = 0; i < frame.normals.size(); i += 3)
            ASSERT_NEAR(std::hypot(frame.normals[i], frame.normals[i + 1], frame.normals[i + 2]),
                        1.0, 4 * this->kEpsilon);
    }
}

TYPED_TEST(PathOf, EqualEndsStayToTheBit) {
    std::vector<IndexPair> same;
    for (Index i = 0; i < kPoints; ++i) same.push_back({i, i});
    Cloud turned = this->source;  // other normals: those are renormalized
    turned.normals = -turned.normals;
    const StraightPath<TypeParam> path(this->source, turned, same);
    for (const double t : {1e-12, 0.3, 0.5, 0.8, 1.0 - 1e-12}) {
        auto frame = frame_at(path, t);
        for (std::size_t i = 0; i < frame.normals.size(); ++i)
            frame.normals[i] = static_cast<TypeParam>(this->source.normals.data()[i]);
        EXPECT_EQ(different_bits(frame, this->source, same, &IndexPair::source), 0) << t;
    }
}

TYPED_TEST(PathOf, NeverLeavesTheIntervalAndRunsOneWay) {
    using Scalar = TypeParam;
    const auto start = frame_at(this->path, 0.0), end = frame_at(this->path, 1.0);
    auto before = start;
    for (int step = 1; step <= 64; ++step) {
        const auto now = frame_at(this->path, step / 64.0);
        for (std::size_t i = 0; i < now.positions.size(); ++i) {
            const auto [low, high] = std::minmax(start.positions[i], end.positions[i]);
            ASSERT_GE(now.positions[i], low);
            ASSERT_LE(now.positions[i], high);
            const Scalar way = now.positions[i] - before.positions[i];
            ASSERT_GE(start.positions[i] < end.positions[i] ? way : -way, -this->kEpsilon);
        }
        before = now;
    }
}

TYPED_TEST(PathOf, DoesNotDependOnThreads) {
    for (const double t : {0.0, 0.3, 1.0}) {
        const ThreadCount one(1);
        const auto serial = frame_at(this->path, t);
        for (const int threads : {2, 3, 8}) {
            const ThreadCount several(threads);
            EXPECT_EQ(frame_at(this->path, t), serial) << threads;
        }
    }
}

TYPED_TEST(PathOf, AllocatesNothing) {
    Frame<TypeParam> frame(this->path.size());
    this->path.frame(0.5, frame.view());  // the threads start here
    const long before = allocations();
    for (const double t : {0.0, 0.3, 0.5, 1.0}) this->path.frame(t, frame.view());
    EXPECT_EQ(allocations(), before);
    ::operator delete(::operator new(1));  // the count counts
    EXPECT_EQ(allocations(), before + 1);
}

TYPED_TEST(PathOf, WritesToAnyAddressAndNothingElse) {
    const auto expected = frame_at(this->path, 0.3);
    const auto count = expected.positions.size();
    for (std::size_t shift = 0; shift < 5; ++shift) {
        std::vector<TypeParam> memory(count + 10, TypeParam(7));
        this->path.frame(0.3, {std::span(memory).subspan(shift, count), {}, {}, {}});
        for (std::size_t i = 0; i < memory.size(); ++i) {
            const bool inside = i >= shift && i < shift + count;
            ASSERT_EQ(memory[i], inside ? expected.positions[i - shift] : TypeParam(7));
        }
    }
}

TYPED_TEST(PathOf, LeavesOutWhatIsNotAskedFor) {
    const auto whole = frame_at(this->path, 0.6);
    Frame<TypeParam> part(this->path.size());
    this->path.frame(0.6, {{}, part.normals, {}, part.radii});
    EXPECT_EQ(part.normals, whole.normals);
    EXPECT_EQ(part.radii, whole.radii);
    EXPECT_EQ(part.positions, std::vector<TypeParam>(part.positions.size()));
    EXPECT_EQ(part.colors, std::vector<TypeParam>(part.colors.size()));
}

TYPED_TEST(PathOf, NormalsThatCancelAreThoseOfTheNearerEnd) {
    const Vector3 up = Vector3(1.0, -2.0, 0.5).normalized();
    EXPECT_LT((normal_at<TypeParam>(up, -up, 0.3) - up).norm(), 4 * this->kEpsilon);
    EXPECT_LT((normal_at<TypeParam>(up, -up, 0.7) + up).norm(), 4 * this->kEpsilon);
    EXPECT_LT((normal_at<TypeParam>(up, -up, 0.5) + up).norm(), 4 * this->kEpsilon);
    EXPECT_LT((normal_at<TypeParam>(up, -up, std::nextafter(0.5, 0.0)) - up).norm(),
              4 * this->kEpsilon);
}

TYPED_TEST(PathOf, NearlyOppositeNormalsTurnThroughTheMiddle) {
    const double angle = 1e-3;
    const Vector3 a(1.0, 0.0, 0.0), b(-std::cos(angle), std::sin(angle), 0.0);
    const Vector3 middle = normal_at<TypeParam>(a, b, 0.5);
    EXPECT_NEAR(middle.norm(), 1.0, 4 * this->kEpsilon);
    EXPECT_NEAR(middle[1], 1.0, 1e-6 + 10 * this->kEpsilon / angle);
}

TYPED_TEST(PathOf, NormalsOfAnyLength) {
    for (const double length : {1e-30, 1e-10, 1e-3, 1.0, 1e3, 1e10, 1e30}) {
        const Vector3 middle = normal_at<TypeParam>({length, 0.0, 0.0}, {0.0, length, 0.0}, 0.5);
        EXPECT_LT((middle - Vector3(1.0, 1.0, 0.0).normalized()).norm(), 4 * this->kEpsilon)
            << length;
    }
}

TEST(Path, MissingColorsAreWhiteAndOpaque) {
    Cloud source = random_cloud<float>(20, 4), target = random_cloud<float>(20, 5);
    source.colors.resize(0, 4);
    target.colors.setZero();
    const auto pairs = random_pairs(20, 30, 6);
    const auto frame = frame_at(StraightPath<float>(source, target, pairs), 0.25);
    EXPECT_EQ(frame.colors, std::vector<float>(120, 0.75F));
}

TEST(Path, NoPairs) {
    const Cloud cloud = random_cloud<float>(20, 4);
    const StraightPath<float> path(cloud, cloud, {});
    EXPECT_EQ(path.size(), 0);
    EXPECT_NO_THROW(path.frame(0.5, {}));
}

TEST(Path, RefusesWhatDoesNotFit) {
    const Cloud cloud = random_cloud<float>(20, 4);
    const auto pairs = random_pairs(20, 30, 6);
    const StraightPath<float> path(cloud, cloud, pairs);
    Frame<float> frame(30), short_frame(29);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (const double t : {-0.1, 1.0001, nan, -std::numeric_limits<double>::infinity()})
        EXPECT_THROW(path.frame(t, frame.view()), OptionError) << t;
    EXPECT_THROW(path.frame(0.5, {short_frame.positions, {}, {}, {}}), OptionError);
    EXPECT_THROW(path.frame(0.5, {{}, {}, {}, short_frame.radii}), OptionError);

    Cloud bare = cloud;
    bare.normals.resize(0, 3);
    EXPECT_THROW(StraightPath<float>(cloud, bare, pairs), CloudError);
    bare = cloud;
    bare.radii.resize(0);
    EXPECT_THROW(StraightPath<float>(bare, cloud, pairs), CloudError);

    Cloud huge = cloud;
    huge.positions.setConstant(3e38);
    EXPECT_THROW(StraightPath<float>(huge, cloud, pairs), CloudError);
    EXPECT_NO_THROW(StraightPath<double>(huge, cloud, pairs));
}

TEST(Path, EndsThatLieElsewhereGiveTheSameBits) {
    const Cloud source = random_cloud<float>(3000, 1), target = random_cloud<float>(2000, 2);
    const std::vector<IndexPair> pairs = random_pairs(2000, 5000, 3);
    const StraightPath<float> path(source, target, pairs);
    const Frame<float> start = frame_at(path, 0.0), end = frame_at(path, 1.0);
    const auto view = [](const Frame<float>& frame) -> FrameView<const float> {
        return {frame.positions, frame.normals, frame.colors, frame.radii};
    };
    const StraightPath<float> borrowed(view(start), view(end));
    for (const double t : {0.0, 0.3, 0.8, 1.0})
        EXPECT_TRUE(frame_at(borrowed, t) == frame_at(path, t)) << t;
    std::vector<double> times;
    for (std::size_t i = 0; i < pairs.size(); ++i) times.push_back(static_cast<double>(i) / 5000);
    Frame<float> here(path.size()), there(path.size());
    path.frame(times, here.view());
    borrowed.frame(times, there.view());
    EXPECT_TRUE(here == there);

    FrameView<const float> incomplete = view(end);
    incomplete.colors = {};
    EXPECT_THROW(StraightPath<float>(view(start), incomplete), OptionError);
}

TEST(Path, ManyNormalsHaveTheBitsOfFew) {
    // By eights where registers are wide, else, and where there are fewer, one by one.
    const Cloud source = random_cloud<float>(3000, 1), target = random_cloud<float>(2000, 2);
    const StraightPath<float> path(source, target, random_pairs(2000, 5000, 3));
    const Frame<float> start = frame_at(path, 0.0), end = frame_at(path, 1.0);
    const auto some_of = [](const Frame<float>& frame, std::size_t first, std::size_t count) {
        return FrameView<const float>{std::span(frame.positions).subspan(3 * first, 3 * count),
                                      std::span(frame.normals).subspan(3 * first, 3 * count),
                                      std::span(frame.colors).subspan(4 * first, 4 * count),
                                      std::span(frame.radii).subspan(first, count)};
    };
    for (const double t : {0.2, 0.5, 0.7}) {
        const Frame<float> all = frame_at(path, t);
        for (std::size_t first = 0; first < 5000; first += 5) {
            const StraightPath<float> few(some_of(start, first, 5), some_of(end, first, 5));
            const Frame<float> frame = frame_at(few, t);
            for (std::size_t k = 0; k < 15; ++k)
                ASSERT_TRUE(same_bits(frame.normals[k], all.normals[3 * first + k])) << first;
        }
    }
}

TEST(Path, WhereNeitherHasColorsAllIsWhite) {
    Cloud source = random_cloud<double>(3000, 1), target = random_cloud<double>(2000, 2);
    source.colors.resize(0, 4);
    const std::vector<IndexPair> pairs = random_pairs(2000, 5000, 3);
    target.colors.setOnes();
    const StraightPath<double> explicitly(source, target, pairs);
    target.colors.resize(0, 4);
    const StraightPath<double> path(source, target, pairs);
    for (const double t : {0.0, 0.3, 1.0})
        EXPECT_TRUE(frame_at(path, t) == frame_at(explicitly, t)) << t;
    const std::vector<double> times(pairs.size(), 0.7);
    Frame<double> here(path.size()), there(path.size());
    path.frame(times, here.view());
    explicitly.frame(times, there.view());
    EXPECT_TRUE(here == there);
    const Frame<double> start = frame_at(path, 0.0), end = frame_at(path, 1.0);
    const StraightPath<double> borrowed({start.positions, start.normals, {}, start.radii},
                                        {end.positions, end.normals, {}, end.radii});
    EXPECT_TRUE(frame_at(borrowed, 0.6) == frame_at(path, 0.6));
}

TEST(Example, Path) {
    const Cloud source = random_cloud<float>(50, 1), target = random_cloud<float>(40, 2);
    const std::vector<IndexPair> pairs = random_pairs(40, 60, 3);
    // --- example
    const StraightPath<float> path(source, target, pairs);
    std::vector<float> positions(3 * path.size()), normals(3 * path.size());
    path.frame(0.5, {positions, normals, {}, {}});
    // --- end of the example
    for (std::size_t i = 0; i < pairs.size(); ++i)
        for (int d = 0; d < 3; ++d)
            EXPECT_NEAR(
                positions[3 * i + to_size(d)],
                0.5 * (source.positions(pairs[i].source, d) + target.positions(pairs[i].target, d)),
                1e-6);
    EXPECT_NEAR(std::hypot(normals[0], normals[1], normals[2]), 1.0, 1e-6);
}

}  // namespace
}  // namespace pointmorph
