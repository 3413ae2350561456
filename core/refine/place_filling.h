// Places of a skin that the lattice shows and it does not are emptied and filled with the lattice's surface.
#pragma once

#include "core/backend.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/growing_filling.h"
#include "core/topology/sides.h"

namespace isoskin {

struct PlaceFillingOptions {
  double edge_length = 1.0;       // e, world units
  double radius = 1.0;            // triangles nearer than this to a place are replaced, units of e
  std::size_t small_piece = 100;  // pieces of at most so many vertices are replaced whole
  double least_piece = 0.0;       // as CertifyOptions has it
  double about = 6.0;  // what is looked at beyond the radius; the double of that until it is enough, units of e
  ProjectOptions project;
};

struct PlaceFillingReport {
  std::size_t filled = 0;    // holes, or pieces, that were filled anew
  std::size_t left_out = 0;  // that were not: their seams do not close, or what came is not what the certificate wants
};

/// Where the skin has passed the certificate it does so after: what comes has the topology of what goes, hole by hole
/// or, where a gap of a sheet lies elsewhere in the lattice, all odd holes of a piece together; and no lattice corner
/// that is far from the surface changes sides; a piece that goes as a whole, because it is small or would be emptied
/// but for scraps, becomes the piece of the lattice that it was matched with. Costs what the places and the skin about
/// them do, and a few looks over the skin. The backend must hold the field. `filling`: of the same lattice, topology
/// and backend; calls for one field make it once. Deterministic.
PlaceFillingReport fill_places(TriangleMesh& skin, const std::vector<Vec3>& places, const Field& field,
                               const BrickLattice& lattice, const LatticeTopology& topology, const FarCorners& far,
                               GrowingFilling& filling, Backend& backend, const PlaceFillingOptions& options);

}  // namespace isoskin
