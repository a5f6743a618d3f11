// Real meshes that lie beside the repository, where they are: tests that measure on them are
// skipped elsewhere.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

#include "pointmorph/base/types.hpp"

namespace pointmorph::real_meshes {

struct Mesh {
    Positions positions;
    Normals normals;  ///< of the vertices: those of the faces around, weighted by area
    std::vector<std::array<Index, 3>> faces;

    /// Length of every directed edge that has a face on its left only, and its first vertex.
    std::map<Index, double> boundary;
};

inline std::filesystem::path folder() {
    return std::filesystem::path(__FILE__).parent_path().parent_path().parent_path() / ".." /
           "shared" / "data";
}

/// A binary PLY file with float positions and triangles, nothing else. Nothing where there is none.
inline std::optional<Mesh> read(const std::string& name) {
    std::ifstream file(folder() / name, std::ios::binary);
    if (!file) return {};
    Index vertices = 0, faces = 0, scalars = 0;
    for (std::string line; std::getline(file, line) && line != "end_header";) {
        std::istringstream words(line);
        std::string first, second;
        words >> first >> second;
        if (first == "element") words >> (second == "vertex" ? vertices : faces);
        if (first == "property" && second == "float") ++scalars;
        if (first == "property" && second != "float" && second != "list")
            throw std::runtime_error(name + ": unexpected property " + second);
    }
    Mesh mesh;
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows(vertices, scalars);
    file.read(reinterpret_cast<char*>(rows.data()),
              static_cast<std::streamsize>(sizeof(float)) * rows.size());
    mesh.positions = rows.leftCols<3>().cast<double>();
    mesh.normals.setZero(vertices, 3);
    std::map<std::pair<Index, Index>, int> sides;
    for (Index f = 0; f < faces; ++f) {
        std::uint8_t corners = 0;
        std::array<std::int32_t, 3> face{};
        file.read(reinterpret_cast<char*>(&corners), 1);
        file.read(reinterpret_cast<char*>(face.data()), sizeof(face));
        if (!file || corners != 3) throw std::runtime_error(name + ": not a triangle mesh");
        mesh.faces.push_back({face[0], face[1], face[2]});
        const Vector3 a = mesh.positions.row(face[0]), b = mesh.positions.row(face[1]),
                      c = mesh.positions.row(face[2]);
        for (int k = 0; k < 3; ++k) {
            mesh.normals.row(face[to_size(k)]) += (b - a).cross(c - a);
            ++sides[{face[to_size(k)], face[to_size((k + 1) % 3)]}];
        }
    }
    mesh.normals.rowwise().normalize();
    for (const auto& [edge, count] : sides)
        if (!sides.contains({edge.second, edge.first}))
            mesh.boundary[edge.first] =
                (mesh.positions.row(edge.first) - mesh.positions.row(edge.second)).norm();
    return mesh;
}

}  // namespace pointmorph::real_meshes
