#include "mesh/untangling.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <iterator>
#include <limits>
#include <unordered_set>
#include <utility>

#include "mesh/mesh_patches.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

Vector3 plane_at(const Mesh& mesh, const WrapPartners& planes, Index f) {
    Vector3 normal = Vector3::Zero();
    for (Index k = 0; k < 3; ++k) normal += planes.normals.row(mesh.triangles(f, k)).transpose();
    return normal;
}

/// Of the face's normal with the plane's; 0 where either is none.
double agreement(const Mesh& mesh, const WrapPartners& planes, const Positions& x, Index f) {
    const auto corner = [&](Index k) -> Vector3 { return x.row(mesh.triangles(f, k)).transpose(); };
    const Vector3 face = (corner(1) - corner(0)).cross(corner(2) - corner(0));
    const Vector3 plane = plane_at(mesh, planes, f);
    const double length = face.norm() * plane.norm();
    return length > 0.0 ? face.dot(plane) / length : 0.0;
}

/// What is to be least, of the places of a patch's vertices.
class Energy {
public:
    Energy(const Mesh& mesh, const ElasticSheet& sheet, const WrapPartners& planes,
           const MeshPatch& patch, const UntangleOptions& options, const Positions& start,
           const Values& shares)
        : mesh_(mesh), planes_(planes), patch_(patch) {
        for (const Index f : patch.faces) {
            const Vector3 normal = plane_at(mesh, planes, f);
            Face face;
            const Vector3 n =
                normal.norm() > 1e-9 ? Vector3(normal.normalized()) : Vector3(Vector3::UnitZ());
            const Vector3 first = n.unitOrthogonal();
            face.axes << first.transpose(), n.cross(first).transpose();
            const Matrix2 sides = options.sides ? options.sides(f) : sheet.metric_sides(f);
            face.inverse = sides.inverse();
            face.area = 0.5 * std::abs(sides.determinant());
            for (Index k = 0; k < 3; ++k) {
                const Index corner = mesh.triangles(f, k);
                const auto at = std::ranges::lower_bound(patch.vertices, corner);
                face.numbers[to_size(k)] = at != patch.vertices.end() && *at == corner
                                               ? to_index(at - patch.vertices.begin())
                                               : -1;
            }
            faces_.push_back(face);
        }
        const double plane_length = options.plane_length;
        weights_ = Values::Zero(static_cast<Eigen::Index>(patch.vertices.size()));
        for (const Face& face : faces_)
            for (const Index v : face.numbers)
                if (v >= 0) weights_[v] += face.area / 3.0 / (plane_length * plane_length);
        if (!(options.reach > 0.0)) return;
        constexpr double kLeast = 0.05;
        const double scale = plane_length / options.reach;
        pulls_ = scale * scale * weights_.cwiseQuotient(shares.cwiseMax(kLeast));
        start_ = start(patch.vertices, Eigen::all);
    }

    /// The least determinant of a face's map.
    double least_determinant(const Positions& x) const {
        double least = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < faces_.size(); ++i)
            least = std::min(least, jacobian(i, x).determinant());
        return least;
    }

    /// The energy and, where asked for, its gradient; `soft` lets faces pass through zero.
    double operator()(const Positions& x, double soft, Eigen::VectorXd* gradient) const {
        double sum = 0.0;
        if (gradient) gradient->setZero(static_cast<Eigen::Index>(3 * patch_.vertices.size()));
        for (std::size_t i = 0; i < faces_.size(); ++i) {
            const Sides in_space = sides_at(i, x) * faces_[i].inverse;
            const Matrix2 j = jacobian(i, x);
            const double d = j.determinant(), root = Eigen::Vector2d(soft, d).norm();
            const double chi = d > 0.0 ? 0.5 * (d + root) : 0.5 * soft * soft / (root - d);
            const bool is_flat = pulls_.size() == 0;
            const double bend =
                (is_flat ? j.squaredNorm() : in_space.squaredNorm()) + kArea * (d * d + 1.0);
            sum += faces_[i].area * bend / chi;
            if (!gradient) continue;
            Matrix2 of_determinant;
            of_determinant << j(1, 1), -j(1, 0), -j(0, 1), j(0, 0);
            const double slope = 0.5 * (1.0 + d / root);
            const double by_root = 2.0 * kArea * d - bend / chi * slope;
            const auto& axes = faces_[i].axes;
            const Sides by_jacobian =
                is_flat
                    ? Sides(faces_[i].area * axes.transpose() *
                            Matrix2((2.0 * j + by_root * of_determinant) / chi))
                    : Sides(faces_[i].area *
                            (2.0 * in_space + axes.transpose() * (by_root * of_determinant)) / chi);
            add(*gradient, faces_[i], by_jacobian * faces_[i].inverse.transpose());
        }
        for (std::size_t v = 0; v < patch_.vertices.size(); ++v) {
            const Index vertex = patch_.vertices[v];
            const Eigen::RowVector3d n = planes_.normals.row(vertex);
            const double off = (x.row(vertex) - planes_.positions.row(vertex)).dot(n);
            const auto row = static_cast<Eigen::Index>(v);
            sum += weights_[row] * off * off;
            if (gradient)
                gradient->segment<3>(3 * row) += 2.0 * weights_[row] * off * n.transpose();
            if (pulls_.size() == 0) continue;
            const Eigen::RowVector3d way = x.row(vertex) - start_.row(row);
            sum += pulls_[row] * way.squaredNorm();
            if (gradient) gradient->segment<3>(3 * row) += 2.0 * pulls_[row] * way.transpose();
        }
        return sum;
    }

private:
    using Sides = Eigen::Matrix<double, 3, 2>;
    static constexpr double kArea = 1.0;  ///< how much areas count against angles

    struct Face {
        Eigen::Matrix<double, 2, 3> axes;
        Matrix2 inverse;
        double area;
        std::array<Index, 3> numbers;  ///< of its corners in the patch; −1 for those that stay
    };

    Sides sides_at(std::size_t i, const Positions& x) const {
        const auto t = mesh_.triangles.row(patch_.faces[i]);
        Sides sides;
        sides << (x.row(t[1]) - x.row(t[0])).transpose(), (x.row(t[2]) - x.row(t[0])).transpose();
        return sides;
    }

    Matrix2 jacobian(std::size_t i, const Positions& x) const {
        return faces_[i].axes * sides_at(i, x) * faces_[i].inverse;
    }

    static void add(Eigen::VectorXd& gradient, const Face& face, const Sides& by_sides) {
        const auto put = [&](Index v, const Vector3& g) {
            if (v >= 0) gradient.segment<3>(3 * v) += g;
        };
        put(face.numbers[0], -by_sides.col(0) - by_sides.col(1));
        put(face.numbers[1], by_sides.col(0));
        put(face.numbers[2], by_sides.col(1));
    }

    const Mesh& mesh_;
    const WrapPartners& planes_;
    const MeshPatch& patch_;
    std::vector<Face> faces_;
    Values weights_;
    Values pulls_;     ///< toward `start_`; none where nothing pulls
    Positions start_;  ///< of the patch's vertices
};

/// A patch's vertices, moved.
void put(const MeshPatch& patch, const Eigen::VectorXd& unknowns, Positions& x) {
    for (std::size_t v = 0; v < patch.vertices.size(); ++v)
        x.row(patch.vertices[v]) =
            unknowns.segment<3>(3 * static_cast<Eigen::Index>(v)).transpose();
}

/// Nocedal's L-BFGS, with steps that make the energy smaller.
void descend(const Energy& energy, const MeshPatch& patch, double soft, int most_steps,
             double tolerance, Positions& x) {
    constexpr std::size_t kRemembered = 8;
    const auto count = to_index(3 * patch.vertices.size());
    Eigen::VectorXd at(count), gradient(count), next_gradient(count);
    for (std::size_t v = 0; v < patch.vertices.size(); ++v)
        at.segment<3>(3 * static_cast<Eigen::Index>(v)) = x.row(patch.vertices[v]).transpose();
    double now = energy(x, soft, &gradient);
    std::deque<std::pair<Eigen::VectorXd, Eigen::VectorXd>> history;
    for (int step = 0; step < most_steps; ++step) {
        Eigen::VectorXd way = -gradient;
        std::vector<double> alphas;
        for (auto h = history.rbegin(); h != history.rend(); ++h) {
            alphas.push_back(h->first.dot(way) / h->first.dot(h->second));
            way -= alphas.back() * h->second;
        }
        if (!history.empty()) {
            const auto& [s, y] = history.back();
            way *= s.dot(y) / y.squaredNorm();
        }
        for (auto h = history.begin(); h != history.end(); ++h) {
            way += (alphas.back() - h->second.dot(way) / h->first.dot(h->second)) * h->first;
            alphas.pop_back();
        }
        double slope = way.dot(gradient);
        if (!(slope < 0.0)) break;
        double length = history.empty() ? 1e-3 / std::max(way.norm(), 1e-30) : 1.0;
        double then = now;
        Eigen::VectorXd there;
        bool better = false;
        for (int half = 0; half < 20 && !better; ++half, length *= 0.4) {
            there = at + length * way;
            put(patch, there, x);
            then = energy(x, soft, &next_gradient);
            better = then <= now + 1e-4 * length * slope;
        }
        if (!better) break;
        const Eigen::VectorXd s = there - at, y = next_gradient - gradient;
        if (s.dot(y) > 1e-12 * s.norm() * y.norm()) {
            history.emplace_back(s, y);
            if (history.size() > kRemembered) history.pop_front();
        }
        const double gained = now - then;
        at = there;
        gradient = next_gradient;
        now = then;
        if (gained < tolerance * now) break;
    }
    put(patch, at, x);
}

/// Of faces: how far bad faces within so many rings take them along.
std::vector<double> shares_of(const Mesh& mesh, const ElasticSheet& sheet,
                              const std::vector<Index>& bad, const UntangleOptions& options) {
    std::vector<double> shares(to_size(mesh.triangles.rows()), 0.0);
    for (const Index f : bad) shares[to_size(f)] = options.share ? options.share(f) : 1.0;
    std::vector<Index> front = bad;
    for (int ring = 0; ring < options.rings; ++ring) {
        std::vector<std::pair<Index, double>> larger;
        for (const Index f : front)
            for (Index k = 0; k < 3; ++k)
                for (const Index c : sheet.around(mesh.triangles(f, k)))
                    if (shares[to_size(c / 3)] < shares[to_size(f)])
                        larger.emplace_back(c / 3, shares[to_size(f)]);
        front.clear();
        for (const auto& [f, share] : larger) {
            if (!(shares[to_size(f)] < share)) continue;
            shares[to_size(f)] = share;
            front.push_back(f);
        }
    }
    return shares;
}

/// Of a patch's vertices: how far the faces around each let it be taken along.
Values shares_of(const MeshPatch& patch, const ElasticSheet& sheet,
                 const std::vector<double>& of_faces) {
    Values result = Values::Ones(to_index(patch.vertices.size()));
    for (Index v = 0; v < result.size(); ++v) {
        for (const Index c : sheet.around(patch.vertices[to_size(v)]))
            result[v] = std::min(result[v], of_faces[to_size(c / 3)]);
    }
    return result;
}

/// Of a patch's vertices: which have gone astray since they were at `start`.
std::vector<Index> strays_of(const MeshPatch& patch, const UntangleOptions& options,
                             const Positions& start, const Positions& x) {
    double most = options.most_off;
    for (const Index v : patch.vertices)
        most = std::max(most, options.off(v, start.row(v).transpose()));
    std::vector<Index> strays;
    std::ranges::copy_if(patch.vertices, std::back_inserter(strays),
                         [&](Index v) { return options.off(v, x.row(v).transpose()) > most; });
    return strays;
}

/// Takes vertices that have gone astray back to where they were at `start`, with those around them;
/// and where they are more than a few, all of their patch.
void take_strays_back(const Mesh& mesh, const ElasticSheet& sheet, const MeshPatch& patch,
                      const UntangleOptions& options, const Positions& start, Positions& x) {
    constexpr double kFew = 0.001;  // of the patch's vertices
    constexpr int kRings = 3;
    std::vector<Index> back = strays_of(patch, options, start, x);
    const auto strays = static_cast<double>(back.size());
    if (strays > kFew * static_cast<double>(patch.vertices.size())) back = patch.vertices;
    std::unordered_set<Index> taken(back.begin(), back.end());
    std::size_t first = 0;
    for (int ring = 0; ring < kRings; ++ring)
        for (const std::size_t end = back.size(); first < end; ++first)
            for (const Index c : sheet.around(back[first]))
                for (const Index v : mesh.triangles.row(c / 3))
                    if (std::ranges::binary_search(patch.vertices, v) && taken.insert(v).second)
                        back.push_back(v);
    for (const Index v : back) x.row(v) = start.row(v);
}

/// Takes patches back to where they were at `start` where more became worse than better.
void take_back(const Mesh& mesh, const ElasticSheet& sheet, const WrapPartners& planes,
               const std::vector<MeshPatch>& patches, const UntangleOptions& options,
               const Positions& start, Positions& x) {
    constexpr double kHardly = 0.002;  // of the area: some samples more or less
    const Positions end = x;
    const Values bare_before = options.bare ? options.bare(start) : Values();
    const Values bare_now = options.bare ? options.bare(end) : Values();
    const auto lies_against = [&](const Positions& at, Index f) {
        return agreement(mesh, planes, at, f) < 0.0 ? 1 : 0;
    };
    for (const MeshPatch& patch : patches) {
        Index more = 0;
        double bared = 0.0, turned = 0.0;
        for (const Index f : patch.faces) {
            const int less = lies_against(start, f) - lies_against(end, f);
            more -= less;
            if (options.creases)
                more += options.creases->of_face(end, f) - options.creases->of_face(start, f);
            if (!options.bare) continue;
            bared += bare_now[f] - bare_before[f];
            turned += 0.5 * less * sheet.metric_sides(f).determinant();
        }
        if (more <= 0 && bared <= std::max(turned, kHardly)) continue;
        for (const Index v : patch.vertices) x.row(v) = start.row(v);
    }
}

}  // namespace

Index untangle(const Mesh& mesh, const ElasticSheet& sheet, const WrapPartners& planes,
               const std::vector<char>& is_fixed, const UntangleOptions& options, Positions& x,
               Progress& progress) {
    const auto count = to_index(mesh.triangles.rows());
    std::vector<char> is_bad(to_size(count), 0);
    parallel_for(count, progress, [&](Index begin, Index end) {
        for (Index f = begin; f < end; ++f)
            is_bad[to_size(f)] = (!options.concerns || options.concerns(f)) &&
                                 agreement(mesh, planes, x, f) < options.least_agreement;
    });
    std::vector<Index> bad;
    for (Index f = 0; f < count; ++f)
        if (is_bad[to_size(f)]) bad.push_back(f);
    if (bad.empty()) return 0;
    const std::vector<MeshPatch> patches =
        patches_around(mesh, sheet, bad, is_fixed, options.rings);
    const bool may_worsen = options.creases || options.bare || options.off;
    const Positions start = may_worsen ? x : Positions();
    const std::vector<double> of_faces = shares_of(mesh, sheet, bad, options);
    parallel_for(
        to_index(patches.size()), progress,
        [&](Index begin, Index end) {
            for (Index p = begin; p < end; ++p) {
                const MeshPatch& patch = patches[to_size(p)];
                if (patch.vertices.empty()) continue;
                const Values shares = shares_of(patch, sheet, of_faces);
                const Positions before_all = x(patch.vertices, Eigen::all);
                const Energy energy(mesh, sheet, planes, patch, options, x, shares);
                double least = energy.least_determinant(x);
                constexpr double kHard = 1e-3, kRough = 1e-6, kExact = 1e-13;
                for (int round = 0; round < options.most_rounds; ++round) {
                    const double below = std::min(least, 0.0);
                    descend(energy, patch, std::sqrt(kHard * kHard + 0.04 * below * below),
                            options.most_steps, kRough, x);
                    const double before = std::exchange(least, energy.least_determinant(x));
                    if (least > 0.0 || (round > 2 && least <= before)) break;
                }
                if (options.is_exact) descend(energy, patch, kHard, 1000, kExact, x);
                for (std::size_t v = 0; v < patch.vertices.size(); ++v) {
                    const Index vertex = patch.vertices[v];
                    if (const double share = shares[to_index(v)]; share < 1.0)
                        x.row(vertex) =
                            (1.0 - share) * before_all.row(to_index(v)) + share * x.row(vertex);
                }
                if (options.off) take_strays_back(mesh, sheet, patch, options, start, x);
            }
        },
        0.0, 1.0, 1);
    if (may_worsen) take_back(mesh, sheet, planes, patches, options, start, x);
    return to_index(std::ranges::count_if(
        bad, [&](Index f) { return agreement(mesh, planes, x, f) < options.least_agreement; }));
}

}  // namespace pointmorph
