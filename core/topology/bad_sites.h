// Where mesh and field disagree in topology: the seeds of a local re-skin (design 8).
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

struct BadSiteOptions {
  double tolerance = 1.0;     // corners with a larger distance estimate must be on the right side, world units
  double stray_vertex = 1.0;  // a mesh vertex farther than this from the surface is bad, in units of the tolerance
  double stray_centre = 1.5;  // the same of a triangle's centroid
  bool strict = false;        // a corner must be simple in both digital connectivities, not in one, to be passed over
};

struct BadSites {
  std::vector<Vec3> point;  // in a fixed order
  std::size_t clusters =
      0;  // of lattice corners that cannot change sides without changing the topology, or lie beyond the tolerance
  std::size_t strays = 0;  // mesh vertices and centroids off the surface
};

/// Corners whose side differs between mesh (`winding`, as winding_numbers gives it) and field are gathered into
/// 26-connected clusters and flipped to the field's side, nearest to the surface first, as long as the flip is simple
/// (see simple_point.h): there the coarse mesh merely cuts corners. What is left is where the topology has to change;
/// it is bad, as are corners beyond the tolerance, and mesh vertices and centroids off the surface: a thread or film
/// that the lattice is too coarse to see shows there. The backend must hold the field.
BadSites find_bad_sites(const TriangleMesh& mesh, const BrickLattice& lattice, const std::vector<std::int8_t>& winding,
                        Backend& backend, const BadSiteOptions& options);

}  // namespace isoskin
