// The geometric mesh of a frame: the mechanical mesh refined, filled anew where that does not show the field, and taken
// back where it went wrong (design 7).
#pragma once

#include "core/backend.h"
#include "core/refine/refined_skin.h"
#include "core/refine/wrong_corners.h"
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
  // places which the refined mesh does not show; not what lies no farther than `refine` leaves triangles of edge e.
  double hidden_corner = 0.15, hidden_centre = 0.25;
  // Triangles of the mechanical mesh nearer than this to such a place are replaced, units of e; each time after the
  // first half as far.
  double radius = 1.0;
  std::size_t small_piece = 100;  // pieces of at most so many vertices are replaced whole
  // Times this is done, each after the first only where the one before left places out; 0: never, nor are crossings
  // that smoothing leaves filled.
  int fillings = 3;
  int untanglings = 8;         // times folds are smoothed, at most
  double smoothed_away = 0.4;  // that puts no lattice corner farther than this onto the wrong side, tolerances
};

struct GeometricReport {
  int fillings = 0;              // that were kept
  std::size_t hidden = 0;        // places that the refined mechanical mesh does not show; not known without fillings
  std::size_t still_hidden = 0;  // places that the result does not show
};

/// The geometric mesh of a certified mechanical mesh, frame after frame. A tip or rim that has grown out of the refined
/// mesh, a thread that it cuts short and a sheet that it has folded into cannot be subdivided right: there a copy of
/// the mechanical mesh is emptied and filled with the lattice's surface where that keeps the certificate (see
/// fill_places), and the copy refined instead. Where refined triangles overlap, the copy's vertices are smoothed along
/// the surface, seams of what was filled first (see untangle.h); what that leaves is filled as well, where fewer
/// remain. Where refined vertices put a lattice corner beyond the tolerance on the wrong side, they go back onto the
/// mesh they were refined from: nearby, then farther away, at last everywhere. Deterministic: no frame depends on those
/// before it, but what they have in common is not made again.
class GeometricSkin {
public:
  /// `field` is the one the backend holds and the lattice was sampled from; `changes`: from the last call's, null:
  /// anything. Then `lattice` was made from the last call's by resample_lattice(). Options are the same in all calls.
  void update(const TriangleMesh& mechanical, const Field& field, const FieldChanges* changes,
              const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
              const GeometricOptions& options, GeometricReport* report = nullptr);

  /// Put in order when asked for, see RefinedSkin::mesh().
  const GeometricMesh& mesh() const { return refined_.mesh(); }
  std::size_t triangle_count() const { return refined_.triangle_count(); }
  /// Pairs of triangles of mesh() that overlap and have no vertex in common.
  std::size_t self_intersections() const;
  ShapeStatistics statistics() const { return refined_.statistics(); }
  /// Triangles of the mechanical mesh (or of its copies) that the last update() refined.
  std::size_t refined_triangles() const { return refined_triangles_; }

private:
  friend class Making;
  RefinedSkin refined_;
  WrongCorners wrong_;
  std::size_t refined_triangles_ = 0;
};

/// Of one frame.
GeometricMesh geometric_mesh(const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
                             const LatticeTopology& topology, Backend& backend, const GeometricOptions& options,
                             GeometricReport* report = nullptr);

}  // namespace isoskin
