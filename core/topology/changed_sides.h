// The sides half of a local certificate: what does a change of a mesh move to the other side?
#pragma once

#include <vector>

#include "core/topology/sides.h"

namespace isoskin {

/// Triangles that came, and turned about those that went, in sets of which each is closed.
struct Difference {
  TriangleMesh mesh;       // vertices and positions only
  std::vector<Index> set;  // per triangle
  Index sets = 0;
};

/// One byte a set: 1 when it leaves a lattice corner that is far from the surface on another side of the mesh than it
/// was, and on the wrong one. Where it does not, a mesh that check_sides() passes still passes. `before`: the whole
/// mesh that is changed; `field`: the one the lattice was sampled from. Parallel and deterministic.
std::vector<std::uint8_t> sets_gone_wrong(const Difference& difference, const TriangleMesh& before, const Field& field,
                                          const BrickLattice& lattice, const FarCorners& far);

}  // namespace isoskin
