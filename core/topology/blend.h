// Two sheets of a mesh are joined: a disc is erased from each and the borders are welded (Nesme-Bouthors 4.1).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/topology/mesh_patch.h"

namespace isoskin {

/// The borders of a set of triangles, as halfedges of the set in order, each leaving from the vertex the one before it
/// arrives at; each border begins at its smallest halfedge, and the borders are in that order. Empty when a border
/// touches itself or another one.
std::vector<std::vector<Index>> find_borders(const TriangleMesh& mesh, const std::vector<Index>& triangles);

/// The Euler characteristic of a set of triangles: 1 for a disc, 0 for an annulus.
int euler_of(const TriangleMesh& mesh, const std::vector<Index>& triangles);

/// `triangles` and all that share a vertex with them, ascending.
std::vector<Index> with_neighbours(const TriangleMesh& mesh, const std::vector<Index>& triangles);

/// A change of the mesh that was planned, or why it cannot be made.
struct PlannedPatch {
  std::optional<MeshPatch> patch;
  std::string reason;  // empty when there is a patch
};

/// Erases the triangles `a` and `b`, two discs without a common vertex, and welds what is left. The border with more
/// vertices loses its shortest edges, again and again, until both have as many; of all rotations of one border against
/// the other the one with the least sum of squared distances is taken, or the next or next but one where two edges that
/// are no neighbours would become one; each welded vertex lies in the middle between the two it was and keeps the id of
/// that of `a`. Euler characteristic: -2. Nothing when a set is not a disc, a border has fewer than 3 vertices, none of
/// the three rotations fits, or equalising would use up a piece of the mesh.
PlannedPatch plan_blend(const TriangleMesh& mesh, const std::vector<Index>& a, const std::vector<Index>& b);

}  // namespace isoskin
