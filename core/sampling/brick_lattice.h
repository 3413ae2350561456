// The background lattice of design 8: values of F at the corners of cubic cells, kept only in 8^3-cell bricks that the
// surface may cross. Extraction and certificate share it.
#pragma once

#include <cstdint>
#include <vector>

#include "core/backend.h"
#include "core/field/field_changes.h"
#include "core/types.h"

namespace isoskin {

/// Lattice point (i,j,k) lies at origin + spacing * (i,j,k). Brick b covers cells 8*coordinate[b] .. 8*coordinate[b]+7
/// on each axis and owns 9^3 corner values (shared corners are stored in each brick, bit for bit equal).
struct BrickLattice {
  static constexpr int kCells = 8;
  static constexpr int kCorners = 9;
  static constexpr int kFarthestCorner = 1 << 19;  // from the origin on each axis
  static constexpr int kValues = kCorners * kCorners * kCorners;

  DVec3 origin{0.0};
  double spacing = 0.0;
  std::vector<IVec3> coordinate;  // sorted, z fastest; one a brick
  std::vector<float> value;       // kValues a brick, index (x * 9 + y) * 9 + z

  /// A cell face whose corner signs lie crosswise, and whether its inside corners hang together. Sorted by key; faces
  /// not listed are left to the asymptotic decider.
  struct Face {
    std::uint64_t key = 0;
    bool joined = false;
  };
  std::vector<Face> face;
  /// Cells whose two loops of crossings are joined by a tunnel, as face_key(cell, 3). Sorted.
  std::vector<std::uint64_t> tunnel;

  /// What sampling decided about crossings that corner signs hide, so that resample_lattice() need not do it again:
  /// edges with the Euler characteristic wanted about them, sorted, and corners that changed sides with their values
  /// before, in the order in which they did.
  struct HiddenEdge {
    IVec3 low{0};
    int axis = 0;
    int euler = 0;
    std::uint64_t key() const { return face_key(low, axis); }
    bool operator==(const HiddenEdge& other) const = default;
  };
  struct Revealed {
    IVec3 corner{0};
    float value = 0.0f;
    bool operator==(const Revealed& other) const = default;
  };
  std::vector<HiddenEdge> hidden;
  std::vector<Revealed> revealed;
  IVec3 first_searched{0}, last_searched{-1};  // bricks that were asked whether the surface may cross them, no grid's
  bool extended = false;                       // bricks had to be added
  /// Of resample_lattice(): per brick, the one of the lattice before that is alike in all its cells, else kNone.
  std::vector<Index> same_as;
  std::vector<IVec3> gone;  // of the same: bricks of the lattice before that this one does not have

  /// Where a brick keeps the value of its corner `c` (0..8 on each axis).
  static int corner_index(const IVec3& c) { return (c.x * kCorners + c.y) * kCorners + c.z; }

  std::size_t brick_count() const { return coordinate.size(); }
  /// Brick with this coordinate, or kNone.
  Index find(const IVec3& brick) const;
  void build_index();  // after `coordinate` is filled; find() needs it

  /// Of the face across `axis` (of the cell, for axis 3) with this low corner; corners are within
  /// kFarthestCorner.
  static std::uint64_t face_key(const IVec3& corner, int axis);
  /// The corner of a key.
  static IVec3 corner_of(std::uint64_t key);
  /// The face's entry, or null.
  const Face* find_face(const IVec3& corner, int axis) const;
  bool has_tunnel(const IVec3& cell) const;

  DVec3 point(const IVec3& corner) const { return origin + spacing * DVec3(corner); }
  Box box(const IVec3& brick) const { return {point(kCells * brick), point(kCells * (brick + 1))}; }

private:
  std::vector<Index> slot_;  // open addressing over `coordinate`, a power of two of slots
};

/// Samples F on the lattice of the given spacing wherever the surface may be: every cell edge whose ends differ in sign
/// has all its four cells in bricks that are present, and F has one sign in each part of space that no brick covers. A
/// corner is inside when its value is > 0. The lattice is anchored at the world's origin, that of a grid field at voxel
/// (0,0,0), so it contains the voxel centres when spacing is h / n. Grids at h, h/2, h/4 and h/8 are evaluated on the
/// host, brick by brick; everything else through the backend, whose field must be `field`. Ambiguous faces are resolved
/// by F at their saddle. Throws InputError when more than `max_bricks` bricks would be needed (an absurd spacing) or
/// the surface runs out of the field's bounds.
BrickLattice sample_lattice(const Field& field, Backend& backend, double spacing, std::size_t max_bricks = 8u << 20);

/// What sample_lattice(field, backend, before.spacing) returns, bit for bit but for same_as, made from the lattice of
/// a field from which `field` differs by `changes`: only bricks in and about those are sampled.
BrickLattice resample_lattice(BrickLattice before, const FieldChanges& changes, const Field& field, Backend& backend,
                              std::size_t max_bricks = 8u << 20);

/// One byte a brick: those marked in `bricks` and the 26 about each.
std::vector<std::uint8_t> with_neighbours(const BrickLattice& lattice, const std::vector<std::uint8_t>& bricks);

}  // namespace isoskin
