// Where mesh and field disagree in topology: the seeds of a local re-skin (design 8).
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/field/field.h"
#include "core/mechanics/project.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/brick_signs.h"

namespace isoskin {

struct BadSiteOptions {
  double tolerance = 1.0;  // corners with a larger distance estimate must be on the right side, world units
  // A mesh vertex or a triangle's centroid farther than this from the surface is bad; in units of the tolerance.
  double stray_vertex = 0.25, stray_centre = 0.75;
};

struct BadSites {
  std::vector<Vec3> point;         // in a fixed order
  std::vector<std::uint8_t> sure;  // per point: it is off the surface or on the wrong side by more than the tolerance,
                                   // or what is so hangs together with the mesh there alone; the others may turn out
                                   // to have the topology of the field
  std::vector<std::uint8_t> odd;   // per point: nothing there says that the topology differs; rough fields have such
                                   // places on every good mesh

  void add(const Vec3& p, bool is_sure, bool is_odd = false) {
    point.push_back(p);
    sure.push_back(is_sure);
    odd.push_back(is_odd && !is_sure);
  }
};

/// Corners whose side differs between mesh and field (`signs`: of the lattice, one a brick) are gathered into
/// 26-connected clusters and flipped to the field's side, nearest to the surface first, as long as the flip is simple
/// in both digital connectivities (see simple_point.h): there the coarse mesh merely cuts corners. Corners on the
/// surface whose flip is simple from the first are left out. What is left is where the topology may have to change,
/// and, of a cluster that is surely wrong but nowhere beside the mesh, where it begins there. Bad are also corners that
/// the mesh encloses twice, or beyond the tolerance, and mesh vertices and centroids off the surface: a thread or film
/// that the lattice is too coarse to see shows there. The backend must hold the field, from which the lattice was
/// sampled.
BadSites find_bad_sites(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice,
                        const std::vector<BrickSigns>& signs, Backend& backend, const BadSiteOptions& options);

/// Adds, as odd sites, the corners of triangles, with wanted != 0 (one byte a vertex) at one of them, from whose
/// centroid projection finds no surface within `reach` (world units).
void add_astray(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted, Backend& backend,
                ProjectOptions project, double reach, BadSites& sites);

/// Cubes side by side that holes are cut to, so that each tells whether the topology differs there: for handles that no
/// corner of the lattice and no distance gives away.
struct Tiles {
  double width = 16.0;  // of a cube, in units of e
  double border = 1.8;  // left to either side of a cube's faces, where the seams run; in units of e
  double shift = 0.0;   // of the cubes along the space diagonal, in widths
};

/// Adds the vertices with wanted != 0 that are in a tile, as odd sites.
void add_tiles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted, const Tiles& tiles,
               double edge_length, BadSites& sites);

}  // namespace isoskin
