// What corner values alone do not say: which corners hang together on a face whose signs lie crosswise, and whether a
// tunnel leads through a cell. F does.
#pragma once

#include <array>

#include "core/field/field.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/brick_signs.h"
#include "core/sampling/cell_shapes.h"

namespace isoskin {

/// Fills lattice.face: every ambiguous face, resolved by inside_joined(). `signs`: of the lattice, one a brick. `stale`
/// (one byte a brick, may be empty for all): what lattice.face says of faces that no such brick has is taken as it is.
/// Parallel.
void resolve_ambiguous_faces(BrickLattice& lattice, const std::vector<BrickSigns>& signs, const Field& field,
                             const std::vector<std::uint8_t>& stale = {});

/// Fills lattice.tunnel: cells of two loops behind which F, on a lattice four times as fine, hangs together inside the
/// cell (the interior ambiguity of marching cubes). Faces must be resolved. Parallel.
void resolve_tunnels(BrickLattice& lattice, const std::vector<BrickSigns>& signs, const Field& field,
                     const std::vector<std::uint8_t>& stale = {});

/// A cell face whose corner signs lie crosswise.
struct CrosswiseFace {
  IVec3 corner;  // of the lattice, its low one
  int axis;
  std::array<float, 4> value;  // at the low corner, one along the next axis, one along the axis after that, both
};
/// Do its inside corners hang together? F on a lattice four times as fine in the face says.
bool inside_joined(const BrickLattice& lattice, const Field& field, const CrosswiseFace& face);

/// Does a tunnel lead through this cell, whose corners have the values v?
bool is_tunnel(const BrickLattice& lattice, const Field& field, const IVec3& cell, const CellShape& shape,
               const std::array<float, 8>& v);

/// The shape of a cell, with lattice.face deciding where it can.
std::uint16_t find_shape(const BrickLattice& lattice, const IVec3& cell, const std::array<float, 8>& v);

}  // namespace isoskin
