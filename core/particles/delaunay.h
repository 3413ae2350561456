// Delaunay tetrahedra of points in space, by Qhull.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// A Delaunay triangulation. Points on a common empty sphere share one cell of the Delaunay complex; Qhull finds it and
/// cuts it in tetrahedra, which then have the same `circumcenter`, bit for bit, and may be flat.
struct Delaunay {
  std::vector<std::array<Index, 4>> tetrahedron;  // each ascending; the whole list ascending
  std::vector<DVec3> circumcenter;                // a Voronoi vertex, one a tetrahedron
};

/// No point is moved. Points must differ and not all lie in a plane. Throws std::invalid_argument for fewer than 5
/// points or points that are not finite; std::runtime_error with Qhull's first line where it gives up.
Delaunay delaunay(std::span<const DVec3> points);

}  // namespace isoskin
