// Cell faces whose corner signs lie crosswise: signs alone do not say which corners hang together, F does.
#pragma once

#include "core/field/field.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// Evaluates F at the saddle of the bilinear interpolant of every ambiguous face and fills lattice.face. Parallel.
void resolve_ambiguous_faces(BrickLattice& lattice, const Field& field);

}  // namespace isoskin
