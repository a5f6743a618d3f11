// Numbers of any bytes.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>

#include "pointmorph/base/types.hpp"

namespace pointmorph::fuzzing {

/// Read from the front; zeros after the end.
class Bytes {
public:
    explicit Bytes(std::span<const std::uint8_t> bytes) : rest_(bytes) {}

    std::uint8_t byte() {
        if (rest_.empty()) return 0;
        const std::uint8_t first = rest_.front();
        rest_ = rest_.subspan(1);
        return first;
    }
    bool chance(int of_256) { return byte() < of_256; }
    /// 0 to count − 1.
    Index below(Index count) {
        const Index given = count > 256 ? byte() * 256 + byte() : byte();
        return count > 0 ? given % count : 0;
    }
    /// 0 to 1, both included.
    double share() { return (byte() * 256 + byte()) / 65535.0; }

    /// Any number at all.
    double number() {
        using Limits = std::numeric_limits<double>;
        constexpr std::array kSpecial{
            0.0,   -0.0,   1.0,   -1.0, Limits::quiet_NaN(), Limits::infinity(),
            0.5,   1e-300, 1e300, 1e30, -Limits::infinity(), Limits::denorm_min(),
            -1e30, 1e-30,  2.0,   3e38, Limits::max(),       -Limits::max()};
        const std::uint8_t kind = byte();
        if (kind < kSpecial.size()) return kSpecial.at(kind);
        if (kind >= 64) return 2.0 * share() - 1.0;
        std::array<std::uint8_t, sizeof(double)> raw{};
        for (std::uint8_t& one : raw) one = byte();
        double result;
        std::memcpy(&result, raw.data(), sizeof result);
        return result;
    }
    /// A row of so many, or, where it is damaged, any.
    Index row(Index count, bool is_damaged) {
        if (!is_damaged) return below(count);
        constexpr std::array<Index, 6> kRows{
            -1,      0, std::numeric_limits<Index>::max(), std::numeric_limits<Index>::min(),
            1 << 20, -2};
        const std::uint8_t kind = byte();
        return kind < kRows.size() ? kRows.at(kind) : count - 3 + kind % 6;
    }

private:
    std::span<const std::uint8_t> rest_;
};

}  // namespace pointmorph::fuzzing
