// The pieces half of the certificate: which piece of the mesh is which piece of the lattice's surface?
#pragma once

#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin {

/// Pieces that have to do with each other; numbers ascending. A cluster of one mesh piece and one lattice piece is a
/// match.
struct Cluster {
  std::vector<Index> mesh, lattice;
};

/// Every vertex in a cell with patches of exactly one lattice piece (or, in an empty cell, with one such piece in the
/// 26 cells around it) votes for that piece. A mesh piece hangs together with the lattice piece it votes for most, a
/// lattice piece with the mesh piece that votes for it most, and both with every other that has a tenth of their votes;
/// stray votes near another sheet are fewer. Lattice pieces enclosing less than `least_piece` take part only where a
/// mesh piece votes for them most: they may lack a mesh. Every piece is in exactly one cluster; clusters are in order
/// of their first mesh piece, then of their first lattice piece. Parallel and deterministic.
std::vector<Cluster> match_pieces(const TriangleMesh& mesh, const MeshPieces& pieces, const BrickLattice& lattice,
                                  const LatticeTopology& topology, double least_piece);

}  // namespace isoskin
