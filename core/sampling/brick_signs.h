// Signs of a brick's corners as bits, for finding what crosses the surface without looking at values.
#pragma once

#include <array>
#include <cstdint>

#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// Nine bits a row along z: bit z of at(x, y) is set when corner (x, y, z) is inside.
struct BrickSigns {
  static constexpr int kCorners = BrickLattice::kCorners;
  std::array<std::uint16_t, kCorners * kCorners> row;

  /// From the brick's 729 values.
  explicit BrickSigns(const float* value) {
    for (int r = 0; r < kCorners * kCorners; ++r) {
      unsigned bits = 0;
      for (int z = 0; z < kCorners; ++z) bits |= static_cast<unsigned>(value[r * kCorners + z] > 0) << z;
      row[r] = static_cast<std::uint16_t>(bits);
    }
  }
  unsigned at(int x, int y) const { return row[x * kCorners + y]; }

  /// Bit z set where cell (x, y, z) has corners of both signs.
  unsigned surface_cells(int x, int y) const {
    const unsigned all = at(x, y) & at(x + 1, y) & at(x, y + 1) & at(x + 1, y + 1);
    const unsigned any = at(x, y) | at(x + 1, y) | at(x, y + 1) | at(x + 1, y + 1);
    return (any | any >> 1) & ~(all & all >> 1) & 0xffu;
  }

  /// Bit z set where the face across `axis` whose low corner is (x, y, z) has its signs crosswise. Corners that have no
  /// such face within the brick must not be asked for: x and y are at most 7 unless they are the axis.
  unsigned ambiguous_faces(int axis, int x, int y) const {
    const unsigned r = at(x, y);
    if (axis == 2) return (r ^ at(x + 1, y)) & (r ^ at(x, y + 1)) & ~(r ^ at(x + 1, y + 1)) & 0x1ffu;
    const unsigned s = axis == 0 ? at(x, y + 1) : at(x + 1, y);
    return (r ^ r >> 1) & (s ^ s >> 1) & (r ^ s) & 0xffu;
  }
};

}  // namespace isoskin
