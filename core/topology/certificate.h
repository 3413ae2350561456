// The certificate of design 8: does this mesh have the field's sides and the field's topology?
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/columns.h"  // winding_numbers
#include "core/topology/sides.h"

namespace isoskin {

struct CertifyOptions {
  double tolerance = 1.0;  // lattice corners farther from the surface than this must be on the right side; world units
                           // (a run: one voxel, or e / 2)
  double least_piece = 0.0;  // pieces of the lattice's surface enclosing less than this may lack a mesh, unless a
                             // corner beyond tolerance is on the wrong side for it; world units^3
  // Matched pieces that enclose at least volume_from (world units^3) must agree in volume to within the factor
  // volume_share, else they count as wrong_side. An octahedron has 0.32 of its sphere's volume.
  double volume_from = std::numeric_limits<double>::infinity();
  double volume_share = 0.25;
};

/// What is wrong with one mesh piece or one lattice piece.
enum class Fault : std::uint8_t {
  none = 0,
  wrong_side,  // a lattice corner beyond tolerance lies on the wrong side of this piece
  euler,       // the Euler characteristics differ
  merged,      // one mesh piece where the field has several
  split,       // several mesh pieces where the field has one
  spurious,    // a mesh piece where the field has no surface
  missing,     // a lattice piece without a mesh
};
const char* name(Fault fault);

struct Certificate {
  bool passed = false;
  std::vector<Fault> mesh_piece;     // per piece of mesh_pieces(mesh)
  std::vector<Fault> lattice_piece;  // per piece of the LatticeTopology
  std::size_t corners_checked = 0;   // lattice corners on whose sides mesh and field were compared
  std::size_t wrong_side = 0;        // of those, farther than the tolerance and on the wrong side
  std::string summary() const;       // one line: counts by fault
};

/// Compares mesh and lattice; `field` is the one the lattice was sampled from. Sides: the winding number of the mesh
/// must be 1 at lattice corners inside and 0 outside, everywhere in space, once they are farther than the tolerance
/// (see check_sides). Topology: pieces are matched through the cells their vertices lie in (see match_pieces); a match
/// must be one to one with equal Euler characteristic and sign of volume. Every piece of a cluster fails with it, so
/// failed lattice pieces are where the failed mesh pieces were. `memory`, `changes`: see check_sides. Parallel and
/// deterministic.
Certificate certify(const TriangleMesh& mesh, const MeshPieces& pieces, const Field& field, const BrickLattice& lattice,
                    const LatticeTopology& topology, const CertifyOptions& options, SideMemory* memory = nullptr,
                    std::optional<MeshChanges> changes = std::nullopt);

/// One byte a vertex: whether its piece has another topology than the field.
std::vector<std::uint8_t> failed_vertices(const MeshPieces& pieces, const Certificate& certificate);

}  // namespace isoskin
