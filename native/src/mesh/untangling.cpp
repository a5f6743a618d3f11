#include "mesh/untangling.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <unordered_set>
#include <utility>

#include "mesh/mesh_patches.hpp"
#include "mesh/patch_energy.hpp"
#include "pointmorph/base/parallel.hpp"

namespace pointmorph {

namespace {

/// Of the face's normal with the plane's; 0 where either is none.
double agreement(const Mesh& mesh, const WrapPartners& planes, const Positions& x, Index f) {
    const auto corner = [&](Index k) -> Vector3 { return x.row(mesh.triangles(f, k)).transpose(); };
    const Vector3 face = (corner(1) - corner(0)).cross(corner(2) - corner(0));
    const Vector3 plane = plane_at(mesh, planes, f);
    const double length = face.norm() * plane.norm();
    return length > 0.0 ? face.dot(plane) / length : 0.0;
}

/// Nocedal's L-BFGS, with steps that make the energy smaller.
class Descent {
public:
    using Unknowns = PatchEnergy::Unknowns;

    explicit Descent(PatchEnergy& energy) : energy_(energy) {}

    /// From `at` until a step gains less than `tolerance` of the energy. Throws Cancelled.
    void go(double soft, int most_steps, double tolerance, Unknowns& at, Progress& progress) {
        remembered_ = 0;
        double now = energy_(at, soft, gradient_, progress);
        for (int step = 0; step < most_steps; ++step) {
            find_way();
            const double slope = way_.dot(gradient_);
            if (!(slope < 0.0)) break;
            double length = remembered_ == 0 ? 1e-3 / std::max(way_.norm(), 1e-30) : 1.0;
            double then = now;
            bool better = false;
            for (int half = 0; half < 20 && !better; ++half, length *= 0.4) {
                there_ = at + length * way_;
                then = energy_(there_, soft, next_gradient_, progress);
                better = then <= now + 1e-4 * length * slope;
            }
            if (!better) break;
            remember(at);
            const double gained = now - then;
            at.swap(there_);
            gradient_.swap(next_gradient_);
            now = then;
            if (gained < tolerance * now) break;
        }
    }

private:
    struct Pair {
        Unknowns step, change;  ///< of the places, and of the gradient by it
        double product;         ///< of both
    };
    static constexpr std::size_t kRemembered = 8;

    const Pair& latest(std::size_t age) const { return pairs_[(count_ - 1 - age) % pairs_.size()]; }

    void remember(const Unknowns& at) {
        Pair& pair = pairs_[count_ % pairs_.size()];
        pair.step = there_ - at;
        pair.change = next_gradient_ - gradient_;
        pair.product = pair.step.dot(pair.change);
        if (!(pair.product > 1e-12 * pair.step.norm() * pair.change.norm())) return;
        ++count_;
        remembered_ = std::min(remembered_ + 1, kRemembered);
    }

    void find_way() {
        way_ = -gradient_;
        std::array<double, kRemembered> alphas;
        for (std::size_t age = 0; age < remembered_; ++age) {
            const Pair& pair = latest(age);
            alphas[age] = pair.step.dot(way_) / pair.product;
            way_ -= alphas[age] * pair.change;
        }
        if (remembered_ > 0) way_ *= latest(0).product / latest(0).change.squaredNorm();
        for (std::size_t age = remembered_; age-- > 0;) {
            const Pair& pair = latest(age);
            way_ += (alphas[age] - pair.change.dot(way_) / pair.product) * pair.step;
        }
    }

    PatchEnergy& energy_;
    std::array<Pair, kRemembered + 1> pairs_;  ///< one more than is remembered: for the next
    std::size_t count_ = 0, remembered_ = 0;
    Unknowns gradient_, next_gradient_, way_, there_;
};

/// Of faces: how far bad faces within so many rings take them along.
std::vector<double> shares_of(const Mesh& mesh, const ElasticSheet& sheet,
                              const std::vector<Index>& bad, const UntangleOptions& options) {
    std::vector<double> shares(to_size(mesh.triangles.rows()), 0.0);
    for (const Index f : bad) shares[to_size(f)] = options.share ? options.share(f) : 1.0;
    // Faces are asked by vertices, each passed once: very many may meet at one.
    std::vector<double> at_vertices(to_size(mesh.positions.rows()), 0.0);
    std::vector<Index> front = bad, vertices;
    for (int ring = 0; ring < options.rings; ++ring) {
        for (const Index f : front)
            for (const Index v : mesh.triangles.row(f)) {
                double& most = at_vertices[to_size(v)];
                if (!(most < shares[to_size(f)])) continue;
                if (most == 0.0) vertices.push_back(v);
                most = shares[to_size(f)];
            }
        front.clear();
        for (const Index v : vertices) {
            const double share = std::exchange(at_vertices[to_size(v)], 0.0);
            for (const Index c : sheet.around(v)) {
                if (!(shares[to_size(c / 3)] < share)) continue;
                shares[to_size(c / 3)] = share;
                front.push_back(c / 3);
            }
        }
        vertices.clear();
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

/// Where the vertices of a patch have the least energy.
PatchEnergy::Unknowns least_of(PatchEnergy& energy, const UntangleOptions& options,
                               Progress& progress) {
    constexpr double kHard = 1e-3, kRough = 1e-6, kExact = 1e-13;
    constexpr double kMostExact = 1000.0, kMostFaces = 1e7;  // steps; faces, as often as they move
    const Progress::Part part(progress, 0.0, 0.0);
    Descent descent(energy);
    PatchEnergy::Unknowns at = energy.start();
    double least = energy.least_determinant(at);
    for (int round = 0; round < options.most_rounds; ++round) {
        const double below = std::min(least, 0.0);
        descent.go(std::sqrt(kHard * kHard + 0.04 * below * below), options.most_steps, kRough, at,
                   progress);
        const double before = std::exchange(least, energy.least_determinant(at));
        if (least > 0.0 || (round > 2 && least <= before)) break;
    }
    if (options.is_exact) {
        const double most = std::min(kMostExact, kMostFaces / static_cast<double>(energy.faces()));
        descent.go(kHard, static_cast<int>(most), kExact, at, progress);
    }
    return at;
}

/// Large patches one after the other, each on all threads; small ones side by side.
void for_all(const std::vector<MeshPatch>& patches,
             const std::function<void(const MeshPatch&, Progress&)>& work, Progress& progress) {
    constexpr std::size_t kLarge = 8000;  // faces
    std::vector<const MeshPatch*> small;
    for (const MeshPatch& patch : patches) {
        if (patch.vertices.empty()) continue;
        if (patch.faces.size() < kLarge)
            small.push_back(&patch);
        else
            work(patch, progress);
    }
    parallel_invoke(static_cast<int>(small.size()), progress, [&](int p, Progress& its) {
        const ThreadCount one(1);  // thousands of short steps, also of one that is alone
        work(*small[to_size(p)], its);
    });
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
    const auto turn_back_in = [&](const MeshPatch& patch, Progress& its) {
        const Values shares = shares_of(patch, sheet, of_faces);
        PatchEnergy energy(
            mesh, planes, patch,
            {.sides =
                 [&](Index f) { return options.sides ? options.sides(f) : sheet.metric_sides(f); },
             .plane_length = options.plane_length,
             .reach = options.reach,
             .shares = shares},
            x);
        const PatchEnergy::Unknowns ends = least_of(energy, options, its);
        for (Index v = 0; v < shares.size(); ++v) {
            auto place = x.row(patch.vertices[to_size(v)]);
            const Eigen::RowVector3d there = ends.segment<3>(3 * v).transpose();
            place = shares[v] < 1.0
                        ? Eigen::RowVector3d((1.0 - shares[v]) * place + shares[v] * there)
                        : there;
        }
        if (options.off) take_strays_back(mesh, sheet, patch, options, start, x);
    };
    for_all(patches, turn_back_in, progress);
    if (may_worsen) take_back(mesh, sheet, planes, patches, options, start, x);
    return to_index(std::ranges::count_if(
        bad, [&](Index f) { return agreement(mesh, planes, x, f) < options.least_agreement; }));
}

}  // namespace pointmorph
