// Where a line or a plane meets a mesh: how an operation finds the triangles around a critical point.
#pragma once

#include <functional>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// A triangle a line passes through.
struct LineHit {
  double distance = 0.0;  // along the direction, negative behind the origin
  Index triangle = kNone;
  bool along = false;  // the triangle's normal points along the direction: the line leaves the solid
};

/// Every triangle the whole line through `origin` passes through within `reach` of it, by distance. `direction` is a
/// unit vector. The line is shifted by 1e-6 reach, so that it does not run through a vertex; an edge belongs to one of
/// its triangles. Parallel; the result does not depend on the number of threads.
std::vector<LineHit> line_hits(const TriangleMesh& mesh, const DVec3& origin, const DVec3& direction, double reach);

/// A plane; points on it count as above.
struct Plane {
  DVec3 origin{0.0};
  DVec3 normal{0.0, 0.0, 1.0};
  double height(const Vec3& p) const { return glm::dot(DVec3(p) - origin, normal); }
};

/// The closed curve in which a plane cuts the mesh, as the halfedges it crosses, each from above to below; consecutive
/// ones lie in one triangle (that of the earlier). About a solid it runs counter-clockwise seen from above.
struct Section {
  std::vector<Index> halfedge;
  std::vector<DVec3> point;  // where the halfedges cross the plane
};

/// Walks from `triangle`. Empty when the plane does not cross it, or after more than `longest` steps.
Section cut_section(const TriangleMesh& mesh, const Plane& plane, Index triangle, std::size_t longest);

/// How often the section winds about the plane's origin, counter-clockwise seen from above.
int winding(const Section& section, const Plane& plane);

/// Triangles of the connected piece `triangle` belongs to, ascending.
std::vector<Index> piece_of(const TriangleMesh& mesh, Index triangle);

/// The disc of triangles `seeds` (one triangle, or the fan of a vertex) grown by edges over triangles that `wanted`
/// asks for; its border is always one simple closed curve. In order of growth, the seeds first.
std::vector<Index> grow_disc(const TriangleMesh& mesh, std::vector<Index> seeds,
                             const std::function<bool(Index triangle)>& wanted);

/// The border of a disc: its halfedges in order, each leaving from the vertex the one before it arrives at.
std::vector<Index> disc_border(const TriangleMesh& mesh, const std::vector<Index>& disc);

}  // namespace isoskin
