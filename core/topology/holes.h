// Holes cut into a mesh, the seams about them, and the patches of a filling that close them.
#pragma once

#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/topology/filling.h"
#include "core/topology/growing_filling.h"
#include "core/topology/point_grid.h"

namespace isoskin {

/// A border of a hole, as halfedges of removed triangles: the hole lies to their left.
struct Seam {
  Index hole = kNone;
  std::vector<Index> halfedge;
  std::vector<std::vector<Index>> path;  // per halfedge: filling vertices from the snapped start to the snapped end
  bool failed = false;
  std::vector<Index> failed_at;  // halfedges that could not be snapped or joined; none where the patch is wrong
};

/// Connected sets of removed triangles.
struct Holes {
  std::vector<Index> of_triangle;  // per triangle of the mesh: its hole, kNone where it stays
  std::vector<int> euler;          // per hole: of the removed triangles with their border
  std::vector<Seam> seams;

  Index count() const { return Index(euler.size()); }
};

/// Removes triangles with a hot vertex (one byte a vertex) that are not spared (one byte a triangle, may be empty), and
/// then more until every border is a simple closed curve. Holes are numbered by their first triangle, seams by their
/// first halfedge.
Holes cut_holes(const TriangleMesh& mesh, const std::vector<std::uint8_t>& hot,
                const std::vector<std::uint8_t>& spared = {});

/// Snaps seam vertices to the nearest vertex of the filling on the same side (`normals`: of the field at the mesh's
/// vertices), each to one of its own, and joins neighbours by shortest paths that share no vertex. Seams for which it
/// cannot be done fail. Returns, per vertex of the mesh, the filling's vertex, kNone away from seams.
std::vector<Index> lay_seams(const TriangleMesh& mesh, const std::vector<Vec3>& normals, Holes& holes,
                             const GrowingFilling& filling, double spacing);
/// One byte a vertex: 1 where no triangle about it is in a hole.
std::vector<std::uint8_t> staying_vertices(const TriangleMesh& mesh, const Holes& holes);
/// How far a vertex may be snapped. `spacing`: of the lattice.
float seam_reach(double spacing);

/// Connected parts of the filling on the holes' sides of the seams' paths.
struct Patches {
  std::vector<Index> of_triangle;         // per triangle of the filling: its patch, kNone where it has none; of patches
                                          // that leak some have none
  std::vector<int> euler;                 // per patch, with its border
  std::vector<std::vector<Index>> seams;  // per patch: the seams it closes, ascending; they fail when it leaks
  std::vector<std::uint8_t> leaks;        // per patch: it runs out at the filling's border or behind a seam

  Index count() const { return Index(euler.size()); }
};

Patches find_patches(Holes& holes, const Filling& filling);

/// Where patches that leak run to.
struct Leaks {
  std::vector<Index> skin;   // vertices of the mesh, away from holes, whose surface is reached
  std::vector<Index> seams;  // vertices of the mesh, on seams that are reached from behind
  std::vector<Vec3> ends;    // places where the filling ends too early
};

/// Follows the patches of failed seams, whose paths must be complete, as far as no skin lies on them that stays. Where
/// there is some, another sheet hangs together with the hole's and has to be opened too. `vertices`: the mesh's, within
/// an edge's length; `normals` as for lay_seams().
Leaks follow_leaks(const TriangleMesh& mesh, const std::vector<Vec3>& normals, const PointGrid& vertices,
                   const Holes& holes, const Filling& filling);

}  // namespace isoskin
