// From voxel values in sparse 8^3 blocks to a BrickGrid: which blocks need taps, and the taps (design 9).
#pragma once

#include <vector>

#include "core/field/grid_field.h"

namespace isoskin {

/// Voxel values as OpenVDB keeps them: a dense table of 8^3 blocks, each of 512 values (index (x * 8 + y) * 8 + z) or
/// of one value. F = scale * value + offset. The values must outlive the call only.
struct BlockValues {
  IVec3 low{0};                      // block coordinate (voxel / 8, rounded down) of entry 0
  IVec3 size{0};                     // entries on each axis, z fastest
  std::vector<const float*> values;  // null where the block holds one value ...
  std::vector<float> constant;       // ... namely this one
  float outside = 0.0f;              // F at every voxel beyond the table

  std::size_t entry(const IVec3& block) const {
    const IVec3 b = block - low;
    return (static_cast<std::size_t>(b.x) * size.y + b.y) * size.z + b.z;
  }
};

/// Builds the bricks. A block gets a brick when it has 512 values that are not all alike, or when a value that its
/// cells or their splines see differs from its constant in sign, or is less than half of it: so each cell the surface
/// may cross lies in a brick. Cubic taps are the coefficients of the interpolating spline by recursive filtering
/// (Unser, Aldroubi and Eden 1993) from 12 voxels away, where a wrong start has decayed to 1e-7 of the values.
/// Parallel; bricks are in table order. The table is one block wider than `blocks` on each side.
BrickGrid build_bricks(const BlockValues& blocks, const DVec3& origin, double h, Interpolation interpolation);

}  // namespace isoskin
