#include "fuzzing/any_input.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "fuzzing/corpus.hpp"
#include "watched.hpp"

namespace pointmorph::fuzzing {
namespace {

using Input = std::vector<std::uint8_t>;

Input from_hex(std::string_view hex) {
    Input bytes;
    for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
        bytes.push_back(
            static_cast<std::uint8_t>(std::stoi(std::string(hex.substr(i, 2)), nullptr, 16)));
    return bytes;
}

std::vector<Input> kept_for(Question question) {
    std::vector<Input> inputs;
    for (const char* hex : kCorpus) {
        Input input = from_hex(hex);
        if (input.at(0) % kQuestions == static_cast<int>(question)) inputs.push_back(input);
    }
    return inputs;
}

/// Bytes changed, left out, repeated, or taken from another input; the first one stays.
Input changed(Input bytes, const Input& other, std::mt19937& random) {
    const auto below = [&](std::size_t count) {
        return random() % std::max<std::size_t>(count, 1);
    };
    for (std::size_t more = 1 + below(4); more > 0; --more) {
        const std::size_t at = 1 + below(bytes.size() - 1);
        const auto place = bytes.begin() + static_cast<std::ptrdiff_t>(std::min(at, bytes.size()));
        const std::size_t kind = below(4);
        if (kind == 0 && bytes.size() > 2 && place != bytes.end())
            bytes.erase(place);
        else if (kind == 1)
            bytes.insert(place, static_cast<std::uint8_t>(random()));
        else if (kind == 2 && place != bytes.end())
            *place = static_cast<std::uint8_t>(random());
        else if (at < other.size())
            std::copy(other.begin() + static_cast<std::ptrdiff_t>(at), other.end(),
                      std::back_inserter(bytes));
    }
    constexpr std::size_t kMost = 512;
    bytes.resize(std::min(bytes.size(), kMost));
    return bytes;
}

std::string to_hex(const Input& bytes) {
    std::string hex;
    for (const std::uint8_t byte : bytes)
        for (const int digit : {byte >> 4, byte & 15}) hex += "0123456789abcdef"[digit];
    return hex;
}

void try_one(const Input& input) {
    try {
        try_bytes(input);
    } catch (const std::exception& error) {
        ADD_FAILURE() << error.what() << ": " << to_hex(input);
    }
}

class AnyInput : public testing::TestWithParam<Question> {};

TEST_P(AnyInput, IsAnsweredOrRefusedAsThoseThatWereKept) {
    const std::vector<Input> kept = kept_for(GetParam());
    EXPECT_GT(kept.size(), 2u);
    for (const Input& input : kept) try_one(input);
}

INSTANTIATE_TEST_SUITE_P(Questions, AnyInput,
                         testing::Values(Question::kOptions, Question::kShapes, Question::kSaved,
                                         Question::kTransforms, Question::kMorph,
                                         Question::kPreviews));

struct Damage {
    Question question;
    int changes;  ///< of each kept input
};

class DamagedInput : public testing::TestWithParam<Damage> {};

TEST_P(DamagedInput, IsAnsweredOrRefused) {
    const auto [question, most] = GetParam();
    const std::vector<Input> kept = kept_for(question);
    std::mt19937 random(7);
    const int changes = std::max(most / (is_watched() ? 20 : 1), 1);
    for (const Input& input : kept)
        for (int k = 0; k < changes; ++k)
            try_one(changed(input, kept[random() % kept.size()], random));
}

INSTANTIATE_TEST_SUITE_P(
    Questions, DamagedInput,
    testing::Values(Damage{Question::kOptions, 5000}, Damage{Question::kShapes, 2000},
                    Damage{Question::kSaved, 40}, Damage{Question::kTransforms, 2000},
                    Damage{Question::kMorph, 1}, Damage{Question::kPreviews, 1}));

}  // namespace
}  // namespace pointmorph::fuzzing
