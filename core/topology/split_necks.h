// A neck that the surface has left, or a tunnel that has closed, is cut: where points of the mesh find no surface
// (Nesme-Bouthors 4.2, which does one at a time).
#pragma once

#include <vector>

#include "core/field/field.h"
#include "core/topology/blend.h"

namespace isoskin {

struct SplitOptions {
  double edge_length = 1.0;  // e, world units
  double reach = 8.0;        // the tips of the caps are looked for no farther from the plane than this; units of e
  int longest = 1024;        // triangles of a ring, at most
  int growths = 3;           // of the ring by its neighbours, until it is an annulus
  int planes = 5;            // tried along an axis, an odd number
};

/// A cluster of quasi-critical points, on a mesh that lies on the surface of the frame before.
struct QuasiCritical {
  std::vector<Index> triangles;  // they came from, ascending
  std::vector<DVec3> points;     // one a triangle, where it was moved to
  int side = -1;  // the sign of the new field there: -1 where a neck has been left, 1 where a tunnel has closed
};

/// The direction along which a neck runs: the one most nearly across the normals of all its triangles.
DVec3 neck_axis(const TriangleMesh& mesh, const std::vector<Index>& triangles);

/// Planes across the neck's axis, and across the flattest direction of the quasi-critical points, which lie near the
/// plane between two new surfaces, cut rings out of the mesh; the one that goes round the neck and whose inside is
/// most clearly on `side` of the new field is erased with what is left of the neck on both sides.
/// Both borders are closed: rings of new vertices about e apart, projected onto the new surface, about a tip that lies
/// there along the axis where it is in reach, else in the middle. Euler characteristic: +2. Nothing when there is no
/// such ring or the caps do not fit.
PlannedPatch plan_split(const TriangleMesh& mesh, const QuasiCritical& cluster, const Field& field,
                        const SplitOptions& options);

}  // namespace isoskin
