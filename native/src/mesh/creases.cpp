#include "mesh/creases.hpp"

#include <utility>

#include "mesh/doubled_area.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

Vector3 Creases::facing(const Positions& x, Index f) const {
    const auto t = mesh_.triangles.row(f);
    return doubled_area(x, t[0], t[1], t[2]).transpose();
}

Index Creases::of_face(const Positions& x, Index f) const {
    Index count = 0;
    const Vector3 own = facing(x, f);
    for (Index k = 0; k < 3; ++k) {
        const Index g = across(f, k);
        if (g >= 0 && mesh_.normals.row(f).dot(mesh_.normals.row(g)) >= 0.0)
            count += own.dot(facing(x, g)) < 0.0;
    }
    return count;
}

Index Creases::around(const Positions& x, std::span<const Index> faces) const {
    Index count = 0;
    for (const Index f : faces) count += of_face(x, f);
    return count;
}

Index Creases::across(Index f, Index k) const {
    Index start = mesh_.triangles(f, k), end = mesh_.triangles(f, (k + 1) % 3);
    // Very many faces may meet at either.
    if (sheet_.around(end).size() < sheet_.around(start).size()) std::swap(start, end);
    Index result = -1;
    for (const Index c : sheet_.around(start)) {
        const auto other = mesh_.triangles.row(c / 3);
        if (c / 3 == f || (other.array() != end).all()) continue;
        if (result >= 0) return -1;
        result = c / 3;
    }
    return result;
}

std::vector<Index> creased_faces(const Mesh& mesh, const ElasticSheet& sheet, const Positions& x,
                                 Progress& progress) {
    const Creases creases(mesh, sheet);
    const auto count = to_index(mesh.triangles.rows());
    std::vector<char> is_creased(to_size(count), 0);
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f) is_creased[to_size(f)] = creases.of_face(x, f) > 0;
    });
    std::vector<Index> faces;
    for (Index f = 0; f < count; ++f)
        if (is_creased[to_size(f)]) faces.push_back(f);
    return faces;
}

void take_back(const Mesh& mesh, const ElasticSheet& sheet,
               const std::function<bool(Index)>& is_worse, const std::function<bool(Index)>& back,
               Progress& progress) {
    const auto count = to_index(mesh.triangles.rows());
    std::vector<char> is_bad(to_size(count), 0), is_due(to_size(count), 1);
    std::vector<char> is_near(to_size(mesh.positions.rows()), 0);
    for (bool is_any = true; is_any;) {
        is_any = false;
        parallel_for(count, progress, [&](Index begin, Index end) {
            for (Index f = begin; f < end; ++f)
                is_bad[to_size(f)] = is_due[to_size(f)] && is_worse(f);
        });
        is_due.assign(to_size(count), 0);
        is_near.assign(is_near.size(), 0);
        for (Index f = 0; f < count; ++f) {
            if (!is_bad[to_size(f)]) continue;
            for (const Index v : mesh.triangles.row(f)) {
                if (!back(v)) continue;
                is_any = true;
                for (const Index c : sheet.around(v))
                    for (const Index w : mesh.triangles.row(c / 3)) {
                        // Once for each vertex, however many faces meet at it.
                        if (std::exchange(is_near[to_size(w)], 1)) continue;
                        for (const Index d : sheet.around(w)) is_due[to_size(d / 3)] = 1;
                    }
            }
        }
    }
}

void take_back_creases(const Mesh& mesh, const ElasticSheet& sheet, const Positions& before,
                       const std::vector<char>& stays, Positions& x, Progress& progress) {
    const Creases creases(mesh, sheet);
    take_back(
        mesh, sheet,
        [&](Index f) {
            const Index now = creases.of_face(x, f);
            return now > 0 && now > creases.of_face(before, f);
        },
        [&](Index v) {
            if ((!stays.empty() && stays[to_size(v)]) || x.row(v) == before.row(v)) return false;
            x.row(v) = before.row(v);
            return true;
        },
        progress);
}

}  // namespace pointmorph
