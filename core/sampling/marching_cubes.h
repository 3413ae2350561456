// Marching cubes on a BrickLattice: a closed, oriented 2-manifold whatever the signs (design 8).
#pragma once

#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// The surface as the lattice sees it: its connected pieces, without any triangle. A *patch* is one loop of crossings in
/// one cell (a cell holds up to four); pieces join patches that share a crossing.
struct LatticeTopology {
  std::vector<Index> first_patch;  // per cell, CSR over brick * 512 + cell index; size cells + 1
  std::vector<Index> piece;        // per patch
  std::vector<int> euler;          // per piece: vertices - edges + patches
  std::vector<double> volume;      // per piece: enclosed volume, world units^3, negative for a cavity
  std::vector<Box> box;            // per piece: bounds of its crossings

  std::size_t piece_count() const { return euler.size(); }
};

/// Face ambiguities are resolved by the asymptotic decider, alike in both cells of a face, so loops close; pieces are
/// numbered in order of their first patch. Parallel and deterministic.
LatticeTopology lattice_topology(const BrickLattice& lattice);

/// Triangulates the pieces with wanted[piece] != 0 (all when `wanted` is empty). Loops are cut so that no diagonal lies
/// in a cell face (a centre point is added where it must), hence no edge is shared by more than two triangles.
/// Crossing points by linear interpolation, kept at least 2% of an edge away from lattice corners. Fresh ids from
/// `next_id` on. `piece_of_vertex`, if given, receives the piece of every vertex.
TriangleMesh marching_cubes(const BrickLattice& lattice, const LatticeTopology& topology,
                            const std::vector<std::uint8_t>& wanted = {}, Index next_id = 0,
                            std::vector<Index>* piece_of_vertex = nullptr);

}  // namespace isoskin
