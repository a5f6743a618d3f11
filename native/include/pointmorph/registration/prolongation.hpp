// Stage `prolongation`: from the images of the coarse points of a cloud to those of all its points.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"
#include "pointmorph/cloud/oriented_points.hpp"
#include "pointmorph/cloud/similarity.hpp"
#include "pointmorph/registration/coarse_shape.hpp"
#include "pointmorph/registration/deformation.hpp"

namespace pointmorph {

using FloatNormals = Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>;

/// What coarse points do, laid out so that points that follow them read it quickly.
class CoarseMoves {
public:
    CoarseMoves(const CoarseShape& shape, const DeformedCloud& coarse);

    /// Lets a similarity follow.
    void then(const Similarity& after);

private:
    friend class Prolongation;
    /// Of an affine map, two cache lines: the images of the axes, and where the origin goes, a 0
    /// after each.
    struct alignas(64) Move {
        std::array<double, 16> columns{};

        auto map() { return Eigen::Map<Eigen::Matrix<double, 4, 4>>(columns.data()).topRows<3>(); }
    };
    std::vector<Move> moves_;  ///< of each coarse point
    Similarity after_;         ///< what has followed; its translation is in the moves alone
};

/// Which coarse points every point of a cloud follows, and how much: those nearest on its side of
/// the surface, with weights that fall with the distance and fade to 0 at the farthest, so that the
/// result is continuous. Kept for as many deformations as are wanted.
class Prolongation {
public:
    /// `shape` has been made from the cloud; normals have unit length.
    Prolongation(const CoarseShape& shape, const Positions& positions, const Normals& normals,
                 Progress& progress);

    /// Every point under the affine maps of its coarse points; a coarse point goes where `coarse`
    /// has it, up to about a hundredth of a spacing. `shape`, `positions` and `normals` as given
    /// to the constructor.
    OrientedPoints operator()(const CoarseShape& shape, const DeformedCloud& coarse,
                              const Positions& positions, const Normals& normals,
                              Progress& progress) const;

    /// The same for the points from `begin` to `end`, which are where they were, in place. Where
    /// turns cancel, a normal takes part in the rotation after all moves alone. The same bits with
    /// wide registers and without; `wide`: they may be used, where the processor has any.
    void move(Index begin, Index end, const CoarseMoves& moves, OrientedPoints& points,
              bool wide = true) const;

    /// All points at rest.
    struct Rest {
        const Positions& positions;
        const FloatNormals& normals;
        const Positions& offsets;  ///< of which `share` is added before anything moves
        double share;
    };
    /// The same from points at rest, into the same rows of `points`.
    void move(Index begin, Index end, const CoarseMoves& moves, const Rest& rest,
              std::span<OrientedPoint> points, bool wide = true) const;

    /// What happens right around a point: its coarse points' linear maps, averaged.
    Matrix3 linear(Index point, const DeformedCloud& coarse) const;

private:
    template <class Rows>
    struct Blending;
    struct OwnRows;
    struct RestRows;
    static constexpr std::size_t kFollowed = 5;
    /// Of each point, where the moves begin that it follows, in bytes.
    std::unique_ptr<std::array<std::uint32_t, kFollowed>[]> followed_;
    std::unique_ptr<std::array<float, kFollowed>[]> weights_;  ///< of sum 1
};

}  // namespace pointmorph
