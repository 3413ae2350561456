// The geometric mesh of a frame: the mechanical mesh refined, and taken back where that went wrong (design 7).
#pragma once

#include "core/backend.h"
#include "core/refine/refine.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

struct GeometricOptions {
  RefineOptions refine;
  ProjectOptions project;
  double edge_length = 1.0;  // e, world units
  double tolerance = 1.0;  // lattice corners farther from the surface than this must be on the right side, world units
};

/// Refines a certified mechanical mesh; where that puts a lattice corner on the wrong side, the refined vertices go
/// back onto the mechanical mesh: nearby, then farther away, at last everywhere. `field` is the one the backend holds
/// and the lattice was sampled from.
GeometricMesh geometric_mesh(const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
                             Backend& backend, const GeometricOptions& options);

}  // namespace isoskin
