// Morphs one text file of points (x y z on each line) into another, and prints the points halfway.
#include <cstdio>
#include <exception>
#include <fstream>
#include <vector>

#include "pointmorph/morph/morph.hpp"

namespace {

pointmorph::Cloud read(const char* path) {
    std::ifstream file(path);
    std::vector<double> numbers;
    for (double number = 0; file >> number;) numbers.push_back(number);
    pointmorph::Cloud cloud{.name = path};
    cloud.positions.resize(static_cast<Eigen::Index>(numbers.size() / 3), 3);
    for (Eigen::Index row = 0; row < cloud.positions.rows(); ++row)
        for (Eigen::Index axis = 0; axis < 3; ++axis)
            cloud.positions(row, axis) = numbers[static_cast<std::size_t>(3 * row + axis)];
    return cloud;
}

}  // namespace

int main(int count, char** words) {
    if (count != 3) {
        std::fprintf(stderr, "usage: morph_example SOURCE.xyz TARGET.xyz\n");
        return 2;
    }
    try {
        pointmorph::Progress progress;
        const pointmorph::Morph morph({read(words[1]), read(words[2])}, {}, progress);
        std::vector<double> positions(3 * morph.pairs().size());
        morph.frame<double>(0.5, {positions, {}, {}, {}});
        for (std::size_t i = 0; i < positions.size(); i += 3)
            std::printf("%.17g %.17g %.17g\n", positions[i], positions[i + 1], positions[i + 2]);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "morph_example: %s\n", error.what());
        return 1;
    }
}
