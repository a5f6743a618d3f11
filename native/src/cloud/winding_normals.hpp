// Normals that agree all over a closed surface, from winding numbers.
#pragma once

#include <span>

#include "pointmorph/base/progress.hpp"
#include "pointmorph/base/types.hpp"

namespace pointmorph {

/// Unit normals of points of a closed surface that point outward: those along which the winding
/// number falls that they make themselves (Lin, Shi and Liu, *Fast and Globally Consistent Normal
/// Orientation based on the Winding Number Normal Consistency*, 2024). They tell the sides of a
/// sheet that is about as thick as the points lie apart. It takes time with the square of their
/// number.
class WindingNormals {
public:
    /// `areas`: of the surface that each point stands for, > 0.
    WindingNormals(const Positions& positions, const Values& areas);

    /// `first` are right for the most part. Throws Cancelled.
    Normals find(const Normals& first, Progress& progress) const;

    /// How badly normals tell inside from outside: mean over the surface of the squared differences
    /// of the winding number, half a spacing off either side of a point, from 0 outside and 1
    /// inside. Throws Cancelled.
    double misfit(const Normals& normals, Progress& progress) const;

    /// The unit vectors along which the winding number that such normals make falls at other
    /// places. Throws Cancelled.
    Normals fall_at(const Normals& normals, const Positions& places, const Values& areas,
                    Progress& progress) const;

private:
    Eigen::ArrayX3f positions_;
    Eigen::ArrayXf areas_;
};

/// Turns and reverses the normals of some rows, a component, where winding numbers tell inside from
/// outside better then. Where there are many, some thousand of them say which are to be reversed.
/// Throws Cancelled.
void orient_by_winding(const Positions& positions, std::span<const Index> rows, Normals& normals,
                       Progress& progress);

}  // namespace pointmorph
