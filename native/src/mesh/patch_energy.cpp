#include "mesh/patch_energy.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

constexpr Index kAtOnce = 512;  ///< faces or vertices whose energies have one sum

Vector3 place_in(const PatchEnergy::Unknowns& at, Index v) {
    return at.segment<3>(3 * v);
}

}  // namespace

Vector3 plane_at(const Mesh& mesh, const WrapPartners& planes, Index f) {
    Vector3 normal = Vector3::Zero();
    for (Index k = 0; k < 3; ++k) normal += planes.normals.row(mesh.triangles(f, k)).transpose();
    return normal;
}

PatchEnergy::PatchEnergy(const Mesh& mesh, const WrapPartners& planes, const MeshPatch& patch,
                         const Terms& terms, const Positions& x)
    : is_flat_(!(terms.reach > 0.0)) {
    const auto vertices = to_index(patch.vertices.size()), faces = to_index(patch.faces.size());
    start_.resize(3 * vertices);
    for (Index v = 0; v < vertices; ++v)
        start_.segment<3>(3 * v) = x.row(patch.vertices[to_size(v)]).transpose();
    faces_.reserve(patch.faces.size());
    for (const Index f : patch.faces) add_face(plane_at(mesh, planes, f), terms.sides(f));
    number_corners(mesh, patch, x);
    forces_.resize(3 * patch.faces.size());
    corners_ = Grouped<Index>(vertices, [&](auto&& take) {
        for (Index c = 0; c < 3 * faces; ++c)
            if (const Index v = faces_[to_size(c / 3)].numbers[to_size(c % 3)]; v >= 0) take(v, c);
    });
    hold_vertices(planes, patch, terms);
    sums_.resize(to_size((faces + kAtOnce - 1) / kAtOnce + (vertices + kAtOnce - 1) / kAtOnce));
}

void PatchEnergy::add_face(const Vector3& normal, const Matrix2& sides) {
    const Vector3 n =
        normal.norm() > 1e-9 ? Vector3(normal.normalized()) : Vector3(Vector3::UnitZ());
    const Vector3 first = n.unitOrthogonal();
    Face& face = faces_.emplace_back();
    face.axes << first.transpose(), n.cross(first).transpose();
    face.inverse = sides.inverse();
    face.area = 0.5 * std::abs(sides.determinant());
}

void PatchEnergy::number_corners(const Mesh& mesh, const MeshPatch& patch, const Positions& x) {
    for (std::size_t i = 0; i < faces_.size(); ++i)
        for (Index k = 0; k < 3; ++k) {
            const Index corner = mesh.triangles(patch.faces[i], k);
            const auto found = std::ranges::lower_bound(patch.vertices, corner);
            Index& number = faces_[i].numbers[to_size(k)];
            if (found != patch.vertices.end() && *found == corner) {
                number = to_index(found - patch.vertices.begin());
            } else {
                number = -1 - to_index(held_.size());
                held_.emplace_back(x.row(corner).transpose());
            }
        }
}

void PatchEnergy::hold_vertices(const WrapPartners& planes, const MeshPatch& patch,
                                const Terms& terms) {
    constexpr double kLeast = 0.05;
    const double scale = is_flat_ ? 0.0 : terms.plane_length / terms.reach;
    for (std::size_t v = 0; v < patch.vertices.size(); ++v) {
        double area = 0.0;
        for (const Index c : corners_[to_index(v)]) area += faces_[to_size(c / 3)].area / 3.0;
        Hold& hold = holds_.emplace_back();
        hold.normal = planes.normals.row(patch.vertices[v]).transpose();
        hold.height = planes.positions.row(patch.vertices[v]).dot(hold.normal);
        hold.weight = area / (terms.plane_length * terms.plane_length);
        hold.pull = scale * scale * hold.weight / std::max(terms.shares[to_index(v)], kLeast);
    }
}

PatchEnergy::Sides PatchEnergy::sides_of(const Face& face, const Unknowns& at) const {
    const auto place = [&](std::size_t k) -> Vector3 {
        const Index v = face.numbers[k];
        return v >= 0 ? place_in(at, v) : held_[to_size(-1 - v)];
    };
    const Vector3 corner = place(0);
    Sides sides;
    sides << place(1) - corner, place(2) - corner;
    return sides;
}

double PatchEnergy::least_determinant(const Unknowns& at) const {
    double least = std::numeric_limits<double>::infinity();
    for (const Face& face : faces_)
        least =
            std::min(least, Matrix2(face.axes * sides_of(face, at) * face.inverse).determinant());
    return least;
}

double PatchEnergy::of_face(std::size_t i, const Unknowns& at, double soft) {
    const Face& face = faces_[i];
    const Sides in_space = sides_of(face, at) * face.inverse;
    const Matrix2 j = face.axes * in_space;
    const double d = j.determinant(), root = std::sqrt(soft * soft + d * d);
    const double chi = d > 0.0 ? 0.5 * (d + root) : 0.5 * soft * soft / (root - d);
    const double bend =
        (is_flat_ ? j.squaredNorm() : in_space.squaredNorm()) + kArea * (d * d + 1.0);
    Matrix2 of_determinant;
    of_determinant << j(1, 1), -j(1, 0), -j(0, 1), j(0, 0);
    const double by_root = 2.0 * kArea * d - bend / chi * (0.5 * (1.0 + d / root));
    const double scale = face.area / chi;
    Sides slope;
    if (is_flat_)
        slope = face.axes.transpose() * Matrix2(scale * (2.0 * j + by_root * of_determinant));
    else
        slope = scale * (2.0 * in_space + face.axes.transpose() * (by_root * of_determinant));
    const Sides by_sides = slope * face.inverse.transpose();
    forces_[3 * i] = -by_sides.col(0) - by_sides.col(1);
    forces_[3 * i + 1] = by_sides.col(0);
    forces_[3 * i + 2] = by_sides.col(1);
    return face.area * bend / chi;
}

double PatchEnergy::of_vertex(Index v, const Unknowns& at, Unknowns& gradient) const {
    const Hold& hold = holds_[to_size(v)];
    const double off = place_in(at, v).dot(hold.normal) - hold.height;
    const Vector3 way = place_in(at, v) - place_in(start_, v);
    Vector3 sum = 2.0 * hold.weight * off * hold.normal + 2.0 * hold.pull * way;
    for (const Index c : corners_[v]) sum += forces_[to_size(c)];
    gradient.segment<3>(3 * v) = sum;
    return hold.weight * off * off + hold.pull * way.squaredNorm();
}

double PatchEnergy::operator()(const Unknowns& at, double soft, Unknowns& gradient,
                               Progress& progress) {
    const auto faces = to_index(faces_.size()), vertices = to_index(holds_.size());
    auto next = sums_.begin();
    // Sums of so many, whoever does them, one after the other.
    const auto add_up = [&](Index count, auto&& of) {
        const auto first = next;
        parallel_for(
            count, progress,
            [&](Index begin, Index end) {
                double sum = 0.0;
                for (Index i = begin; i < end; ++i) sum += of(i);
                first[begin / kAtOnce] = sum;
            },
            0.0, 1.0, kAtOnce);
        next += (count + kAtOnce - 1) / kAtOnce;
    };
    gradient.resize(at.size());
    add_up(faces, [&](Index i) { return of_face(to_size(i), at, soft); });
    add_up(vertices, [&](Index v) { return of_vertex(v, at, gradient); });
    double sum = 0.0;
    for (const double some : sums_) sum += some;
    return sum;
}

}  // namespace pointmorph
