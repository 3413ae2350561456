// The pieces half of the certificate: which piece of the mesh is which piece of the lattice's surface?
#pragma once

#include <vector>

#include "core/mesh/mesh_changes.h"
#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin {

/// Pieces that have to do with each other; numbers ascending. A cluster of one mesh piece and one lattice piece is a
/// match.
struct Cluster {
  std::vector<Index> mesh, lattice;
};

/// Per vertex the piece of the lattice's surface for which it votes, kNone for none; see match_pieces(). `before`:
/// those of the mesh that `changes`, if given, begin at, and of the lattice that topology.changed begins at: only where
/// mesh or lattice have changed vertices are asked again, with the same result. Parallel.
std::vector<Index> piece_votes(const TriangleMesh& mesh, const BrickLattice& lattice, const LatticeTopology& topology,
                               const std::vector<Index>& before = {}, const MeshChanges* changes = nullptr);

/// Every vertex in a cell with patches of exactly one lattice piece (or, in an empty cell, with one such piece in the
/// 26 cells around it) votes for that piece. A mesh piece and a lattice piece that vote for each other most match; mesh
/// pieces left over take the lattice piece left over that most of their vertices have within a cell. Beyond its match a
/// piece hangs together with every other of the other kind that has a quarter of its votes; fewer are strays near
/// another sheet, and so are those of pieces enclosing less than `least_piece`, mesh or lattice, which have few votes
/// in all. Every piece is in exactly one cluster, so no stray can hide a piece that has no match of its own; clusters
/// are in order of their first mesh piece, then of their first lattice piece. Parallel and deterministic.
std::vector<Cluster> match_pieces(const TriangleMesh& mesh, const MeshPieces& pieces, const BrickLattice& lattice,
                                  const LatticeTopology& topology, double least_piece, const std::vector<Index>& vote);
inline std::vector<Cluster> match_pieces(const TriangleMesh& mesh, const MeshPieces& pieces,
                                         const BrickLattice& lattice, const LatticeTopology& topology,
                                         double least_piece) {
  return match_pieces(mesh, pieces, lattice, topology, least_piece, piece_votes(mesh, lattice, topology));
}

/// Where skin of pieces that are merged (one byte a vertex) runs from one piece of the lattice's surface to another, by
/// the votes of its vertices, or of those nearest along edges: a vertex of every edge with different ones, ascending.
std::vector<Index> vertices_between_pieces(const TriangleMesh& mesh, const std::vector<std::uint8_t>& merged,
                                           const BrickLattice& lattice, const LatticeTopology& topology);

}  // namespace isoskin
