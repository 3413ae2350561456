// The background lattice of design 8: values of F at the corners of cubic cells, kept only in 8^3-cell bricks that the
// surface may cross. Extraction and certificate share it.
#pragma once

#include <unordered_map>
#include <vector>

#include "core/backend.h"
#include "core/types.h"

namespace isoskin {

/// Lattice point (i,j,k) lies at origin + spacing * (i,j,k). Brick b covers cells 8*coordinate[b] .. 8*coordinate[b]+7
/// on each axis and owns 9^3 corner values (shared corners are stored in each brick, bit for bit equal).
struct BrickLattice {
  static constexpr int kCells = 8;
  static constexpr int kCorners = 9;
  static constexpr int kValues = kCorners * kCorners * kCorners;

  DVec3 origin{0.0};
  double spacing = 0.0;
  std::vector<IVec3> coordinate;  // sorted, z fastest; one a brick
  std::vector<float> value;       // kValues a brick, index (x * 9 + y) * 9 + z

  std::size_t brick_count() const { return coordinate.size(); }
  /// Brick with this coordinate, or kNone.
  Index find(const IVec3& brick) const;
  void build_index();  // after `coordinate` is filled; find() needs it

  DVec3 point(const IVec3& corner) const { return origin + spacing * DVec3(corner); }

private:
  std::unordered_map<std::uint64_t, Index> index_;
};

/// Samples F on the lattice of the given spacing wherever the surface may be: every cell edge whose ends differ in sign
/// has all its four cells in bricks that are present. For a grid the lattice contains its voxel centres when spacing is
/// h / n. Throws InputError when more than `max_bricks` bricks would be needed (an absurd spacing).
BrickLattice sample_lattice(const Field& field, Backend& backend, double spacing, std::size_t max_bricks = 8u << 20);

}  // namespace isoskin
