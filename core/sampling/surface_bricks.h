// What lattice_topology() and marching_cubes() have in common.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <utility>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

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

/// How far along the lattice edge that starts at a brick's corner the surface crosses it. `value`: of the brick.
inline double crossing_place(const float* value, const IVec3& corner, int axis) {
  constexpr std::array<int, 3> kStep{BrickLattice::kCorners * BrickLattice::kCorners, BrickLattice::kCorners, 1};
  const float* const at = value + BrickLattice::corner_index(corner);
  return crossing_fraction(at[0], at[kStep[axis]]);
}

}  // namespace isoskin::sampling
