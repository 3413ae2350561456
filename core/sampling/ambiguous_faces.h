// What corner values alone do not say: which corners hang together on a face whose signs lie crosswise, and whether a
// tunnel leads through a cell. F does.
#pragma once

#include <array>

#include "core/field/field.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// Evaluates F at the saddle of the bilinear interpolant of every ambiguous face and fills lattice.face. Parallel.
void resolve_ambiguous_faces(BrickLattice& lattice, const Field& field);

/// Fills lattice.tunnel: cells of two loops between whose centres F, at a quarter, half and three quarters of the way,
/// has the sign that lies beyond them (the interior ambiguity of marching cubes). Faces must be resolved. Parallel.
void resolve_tunnels(BrickLattice& lattice, const Field& field);

/// The shape of a cell, with lattice.face deciding where it can.
std::uint16_t find_shape(const BrickLattice& lattice, const IVec3& cell, const std::array<float, 8>& v);

}  // namespace isoskin
