// Whether a grid's surface is so smooth that its own voxels show all of it.
#pragma once

#include "core/field/grid_field.h"

namespace isoskin {

/// True when, about every voxel that the surface may cross, F rises or falls along one and the same axis all through
/// that voxel and those beside it (in the same brick) which the surface crosses: there the surface is a graph over a
/// plane, one sheet without holes, and corner signs at whole voxels tell its topology. Sheets thinner than two voxels
/// fail, and so do creases and rough fluids. Told by the signs of differences of taps (a B-spline's derivative lies in
/// their hull), where they say too little by Bernstein coefficients. Cubic grids only. Parallel; ends at the first
/// brick that fails.
bool is_plain(const BrickGrid& grid);

}  // namespace isoskin
