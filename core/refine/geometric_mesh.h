// The geometric mesh of a frame: the mechanical mesh refined, filled anew where that does not show the field, and taken
// back where it went wrong (design 7).
#pragma once

#include "core/backend.h"
#include "core/refine/refine.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/certificate.h"

namespace isoskin {

struct GeometricOptions {
  RefineOptions refine;
  ProjectOptions project;
  double edge_length = 1.0;  // e, world units
  CertifyOptions certify;    // as the mechanical mesh was certified; its tolerance is the unit of the next two
  // Lattice corners on the wrong side and farther than this from the surface, and centroids farther than that, are
  // places which the refined mesh does not show.
  double hidden_corner = 0.15, hidden_centre = 0.25;
  double radius = 1.0;  // triangles of the mechanical mesh nearer than this to such a place are replaced, units of e
  std::size_t small_piece = 100;  // pieces of at most so many vertices are replaced whole
  // Times this is done, each after the first only where the one before left places out; 0: never. Each takes the places
  // in twice as many parts as the last, since one seam that does not close keeps all of a part open.
  int fillings = 3;
};

struct GeometricReport {
  RefineReport refine;     // of the mesh with its fillings
  int fillings = 0;        // that were kept
  std::size_t hidden = 0;  // places that one pass over the mechanical mesh does not show; not known without fillings
  std::size_t still_hidden = 0;  // places that the result does not show
};

/// Refines a certified mechanical mesh. A tip or rim that has grown out of it, a thread that it cuts short and a sheet
/// that it has folded into cannot be subdivided right: there a copy of the mechanical mesh is emptied and filled with
/// the lattice's surface (core/topology/reskin.h), kept only if it passes the certificate, and the copy refined
/// instead. Where refined vertices put a lattice corner beyond the tolerance on the wrong side, they go back onto the
/// mesh they were refined from: nearby, then farther away, at last everywhere. `field` is the one the backend holds and
/// the lattice was sampled from. Deterministic.
GeometricMesh geometric_mesh(const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
                             const LatticeTopology& topology, Backend& backend, const GeometricOptions& options,
                             GeometricReport* report = nullptr);

}  // namespace isoskin
