// The eight operations that change a mesh's topology at a critical point (design 8; Rumiano 2007, section 3.3.3;
// Stander and Hart 1997). The 1-saddle and the minimum are the mirror images of the 2-saddle and the maximum with
// inside and outside exchanged (design 14).
#pragma once

#include <string>

#include "core/field/field.h"
#include "core/mesh/triangle_mesh.h"
#include "core/topology/critical_points.h"

namespace isoskin {

struct SurgeryOptions {
  double edge_length = 1.0;  // e, world units: the measure of the lengths below
  double reach = 12.0;       // triangles and new vertices are looked for no farther from the critical point; units of e
  double search = 2.0;  // a gap or a small piece the critical point is not inside of may be this far away; units of e
  double widest_disc = 3.0;      // radius of the discs that a tube replaces, at most; units of e
  double least_disc = 0.5;       // and at least; units of e
  double least_ring = 0.05;      // radius of a new tube's waist, at least; units of e
  double fall_back_ring = 0.25;  // the same where the field does not tell it; units of e
};

/// One critical point seen from both ends of a change: on the field whose surface the mesh lies on now, and on the
/// field it is to follow. Both alike when there is no motion.
struct SurgerySite {
  CriticalPoint before;
  CriticalPoint after;
};

struct SurgeryReport {
  bool done = false;
  std::string reason;  // why the mesh was left as it was; empty when done
  std::size_t vertices_added = 0, triangles_removed = 0, triangles_added = 0;
  double area = 0.0;  // of the triangles added, world units^2
  explicit operator bool() const { return done; }
};

// Each changes the Euler characteristic by exactly +2 or -2, keeps a closed, oriented 2-manifold, and places its new
// vertices on the surface of `field`, the field to follow. Vertices that stay are not moved. New ones have fresh ids,
// age 1 and the mean rest and velocity of their neighbours. When something does not fit, the mesh is not changed and
// the report says why. Deterministic.

/// A maximum became positive: an octahedron about it, subdivided to about e, its corners found along rays. +2
SurgeryReport create_component(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                               const SurgeryOptions& options);
/// A maximum became negative: the piece around it is removed, which must be a sphere. -2
SurgeryReport destroy_component(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                                const SurgeryOptions& options);
/// A 2-saddle became positive: the two sheets met along its positive eigenvector lose a disc each and are joined by a
/// tube, with a ring of new vertices at its waist. -2
SurgeryReport connect(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options);
/// A 2-saddle became negative: the ring of triangles about it that the plane of its negative eigenvectors crosses is
/// removed and both borders are closed by a fan. Where a border touches itself it is given vertices of its own. +2
SurgeryReport cut(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options);
/// A 1-saddle became negative: connect() through the solid, along its negative eigenvector. -2
SurgeryReport pierce(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options);
/// A 1-saddle became positive: cut() of a tunnel, in the plane of its positive eigenvectors. +2
SurgeryReport spackle(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options);
/// A minimum became negative: create_component() turned inside out. +2
SurgeryReport open_bubble(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                          const SurgeryOptions& options);
/// A minimum became positive: destroy_component() of the cavity around it. -2
SurgeryReport burst_bubble(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                           const SurgeryOptions& options);

}  // namespace isoskin
