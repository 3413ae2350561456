// Where mesh and field disagree in topology: the seeds of a local re-skin (design 8).
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

struct BadSiteOptions {
  double tolerance = 1.0;      // corners with a larger distance estimate must be on the right side, world units
  double stray_vertex = 0.25;  // a mesh vertex farther than this from the surface is bad, in units of the tolerance
  double stray_centre = 0.75;  // the same of a triangle's centroid
};

struct BadSites {
  std::vector<Vec3> point;   // in a fixed order
  std::size_t clusters = 0;  // of lattice corners whose flip would change the topology or lie beyond the tolerance
  std::size_t strays = 0;    // mesh vertices and centroids off the surface
};

/// Corners whose side differs between mesh (`winding`, as winding_numbers gives it) and field are gathered into
/// 26-connected clusters. A cluster is benign (the coarse mesh merely cuts corners) when flipping it changes neither
/// Euler characteristic of the mesh's inside set, as 6- or as 26-connected voxels, and no corner of it lies beyond the
/// tolerance; the corners of all others are bad sites. So are mesh vertices and centroids that are off the surface: a
/// thread or film that the lattice is too coarse to see shows there. The backend must hold the field.
BadSites find_bad_sites(const TriangleMesh& mesh, const BrickLattice& lattice, const std::vector<std::int8_t>& winding,
                        Backend& backend, const BadSiteOptions& options);

}  // namespace isoskin
