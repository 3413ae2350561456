// What lattice_topology() and marching_cubes() have in common.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <utility>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/sampling/cell_shapes.h"
#include "core/sampling/cell_surface.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin::sampling {

template <class F>
void for_bricks(std::size_t count, const F& f) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 16), [&](const auto& range) {
    for (std::size_t b = range.begin(); b != range.end(); ++b) f(b);
  });
}

/// Turns counts into CSR offsets: first[i] becomes the sum of all before it; the total is returned and stored last.
inline Index offsets_from_counts(std::vector<Index>& first) {
  Index sum = 0;
  for (Index& f : first) sum += std::exchange(f, sum);
  return sum;
}

/// Of a brick: the low corner of cell (x * 8 + y) * 8 + z.
inline IVec3 cell_corner(int cell) {
  constexpr int kCells = BrickLattice::kCells;
  return {cell / (kCells * kCells), cell / kCells % kCells, cell % kCells};
}

/// Calls visit(number, low corner, axis) for the crossings that start in a brick.
template <class Visit>
void for_each_crossing(const BrickCrossings& crossings, const Visit& visit) {
  Index number = 0;
  for (int word = 0; word < 24; ++word)
    for (std::uint64_t bits = crossings.mask[word]; bits; bits &= bits - 1) {
      const int bit = std::countr_zero(bits);
      visit(number++, IVec3(word % 8, bit / 8, bit % 8), word / 8);
    }
}

/// Calls visit(SurfaceCell) for the cells of a brick that the surface crosses, ascending.
template <class Visit>
void for_each_surface_cell(const LatticeTopology& t, std::size_t brick, const Visit& visit) {
  constexpr int kCells = BrickLattice::kCells;
  for (const SurfaceCell& cell : t.cells[brick]) visit(cell);
  if (!t.cells[brick].empty()) return;
  const BrickSigns& signs = t.signs[brick];
  std::uint16_t patch = 0;
  for (int x = 0; x < kCells; ++x)
    for (int y = 0; y < kCells; ++y)
      for (unsigned cells = signs.surface_cells(x, y); cells; cells &= cells - 1) {
        const int z = std::countr_zero(cells);
        visit(SurfaceCell{static_cast<std::uint16_t>((x * kCells + y) * kCells + z),
                          plain_shape(signs.cell_signs(x, y, z)), patch++, 1, false});
      }
}

/// How far along the lattice edge that starts at a brick's corner the surface crosses it. `value`: of the brick.
inline double crossing_place(const float* value, const IVec3& corner, int axis) {
  constexpr std::array<int, 3> kStep{BrickLattice::kCorners * BrickLattice::kCorners, BrickLattice::kCorners, 1};
  const float* const at = value + BrickLattice::corner_index(corner);
  return crossing_fraction(at[0], at[kStep[axis]]);
}

}  // namespace isoskin::sampling
