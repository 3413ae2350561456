// The certificate of design 8: does this mesh have the field's sides and the field's topology?
#pragma once

#include <string>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin {

struct CertifyOptions {
  double tolerance = 1.0;      // lattice corners with |F|/|grad F| beyond this (world units; a run: h, or e/2) must be on the right side
  double least_piece = 0.0;    // pieces of the lattice's surface enclosing less volume than this may lack a mesh; see Tracker
};

/// What is wrong with one mesh piece or one lattice piece.
enum class Fault : std::uint8_t {
  none = 0,
  wrong_side,      // a lattice corner beyond tolerance lies on the wrong side of this piece
  euler,           // the Euler characteristics differ
  merged,          // one mesh piece where the field has several
  split,           // several mesh pieces where the field has one
  spurious,        // a mesh piece where the field has no surface
  missing,         // a lattice piece without a mesh
};
const char* name(Fault fault);

struct Certificate {
  bool passed = false;
  std::vector<Fault> mesh_piece;     // per piece of mesh_pieces(mesh)
  std::vector<Fault> lattice_piece;  // per piece of the LatticeTopology
  std::size_t corners_checked = 0;   // lattice corners farther than the tolerance
  std::size_t wrong_side = 0;        // of those, on the wrong side
  std::string summary() const;       // one line: counts by fault
};

/// Compares mesh and lattice. The winding number of the mesh at every lattice corner comes from crossings along lattice
/// columns (exact predicates on shifted coordinates, so no corner is ever "on" the mesh); it must be 1 inside, 0
/// outside. Pieces are matched through the cells their vertices lie in; a match must be one to one with equal Euler
/// characteristic, else every piece of the cluster fails. Corners in space that no brick covers are checked only through
/// pieces. Parallel and deterministic.
Certificate certify(const TriangleMesh& mesh, const MeshPieces& pieces, const Field& field,
                    const BrickLattice& lattice, const LatticeTopology& topology, const CertifyOptions& options);

/// Winding number of the mesh at each corner of each brick, same layout as BrickLattice::value.
std::vector<std::int8_t> winding_numbers(const TriangleMesh& mesh, const BrickLattice& lattice);

}  // namespace isoskin
