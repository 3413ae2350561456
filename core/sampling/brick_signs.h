// Signs of a brick's corners as bits, for finding what crosses the surface without looking at values.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "core/parallel.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// Nine bits a row along z: bit z of at(x, y) is set when corner (x, y, z) is inside.
struct BrickSigns {
  static constexpr int kCorners = BrickLattice::kCorners;
  std::array<std::uint16_t, kCorners * kCorners> row{};

  BrickSigns() = default;
  /// From the brick's 729 values.
  explicit BrickSigns(const float* value) {
    for (int r = 0; r < kCorners * kCorners; ++r) row[r] = static_cast<std::uint16_t>(signs_of(value + r * kCorners));
  }
  unsigned at(int x, int y) const { return row[x * kCorners + y]; }

  /// Are there corners of both signs?
  bool mixed() const {
    unsigned any = 0, all = 0x1ff;
    for (const unsigned r : row) any |= r, all &= r;
    return any != 0 && all != 0x1ff;
  }

  /// Does the face (or edge, for two axes that are not 0) of the brick towards `offset` have corners of both signs?
  /// `offset` is -1, 0 or 1 on each axis.
  bool crosses(const IVec3& offset) const {
    unsigned any = 0, all = 0x1ff;
    for (int x = offset.x > 0 ? 8 : 0; x <= (offset.x < 0 ? 0 : 8); ++x)
      for (int y = offset.y > 0 ? 8 : 0; y <= (offset.y < 0 ? 0 : 8); ++y) any |= at(x, y), all &= at(x, y);
    const unsigned there = offset.z == 0 ? 0x1ff : offset.z > 0 ? 0x100 : 1;
    return (any & there) != 0 && (all & there) != there;
  }

  /// Bit c set where corner (c & 1, c >> 1 & 1, c >> 2 & 1) of the cell is inside.
  unsigned cell_signs(int x, int y, int z) const {
    const unsigned a = at(x, y) >> z & 3, b = at(x + 1, y) >> z & 3, c = at(x, y + 1) >> z & 3,
                   d = at(x + 1, y + 1) >> z & 3;
    const unsigned low = (a & 1) | (b & 1) << 1 | (c & 1) << 2 | (d & 1) << 3;
    const unsigned high = a >> 1 | (b >> 1) << 1 | (c >> 1) << 2 | (d >> 1) << 3;
    return low | high << 4;
  }

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

private:
  /// Of nine values in a row. A third of a certificate's passes begin with this.
  static unsigned signs_of(const float* value) {
#ifdef __SSE2__
    const __m128 zero = _mm_setzero_ps();
    const int low = _mm_movemask_ps(_mm_cmpgt_ps(_mm_loadu_ps(value), zero));
    const int high = _mm_movemask_ps(_mm_cmpgt_ps(_mm_loadu_ps(value + 4), zero));
    return static_cast<unsigned>(low | high << 4 | (value[8] > 0) << 8);
#else
    unsigned bits = 0;
    for (int z = 0; z < kCorners; ++z) bits |= static_cast<unsigned>(value[z] > 0) << z;
    return bits;
#endif
  }
};

/// Of every brick.
inline std::vector<BrickSigns> brick_signs(const BrickLattice& lattice) {
  std::vector<BrickSigns> signs(lattice.brick_count());
  for_each_heavy(signs.size(),
                 [&](std::size_t b) { signs[b] = BrickSigns(&lattice.value[b * BrickLattice::kValues]); });
  return signs;
}

}  // namespace isoskin
