// Whether a grid's surface is so smooth that its own voxels show all of it.
#pragma once

#include <optional>

#include "core/field/field_changes.h"
#include "core/field/grid_field.h"

namespace isoskin {

/// A brick of the grid (its coordinate) that is not plain, none when all are. In a plain one, about every voxel that
/// the surface may cross, F rises or falls along one and the same direction (of 13) all through that voxel and those
/// beside it (in the brick) which the surface crosses: there the surface is a graph over a plane, one sheet without
/// holes, and corner signs at whole voxels tell its topology. Sheets thinner than two voxels fail, and so do rough
/// fluids. Told by the signs of differences of taps (a B-spline's derivative lies in their hull), where they say too
/// little by Bernstein coefficients. No brick of a linear grid is plain. Which brick it is may differ from call to
/// call; whether there is one does not. `only`: where bricks are looked at, everywhere when null. Parallel; ends at the
/// first.
std::optional<IVec3> find_rough(const BrickGrid& grid, const ChangeMask* only = nullptr);

/// Is this brick there, and not plain?
bool is_rough(const BrickGrid& grid, const IVec3& brick);

inline bool is_plain(const BrickGrid& grid) {
  return !find_rough(grid);
}

}  // namespace isoskin
