// Tier 1 of design 8 for fields without second derivatives: sheets that collide are blended, necks and tunnels that the
// surface has left are split (Nesme-Bouthors 4; here both also with inside and outside exchanged, and several at once).
#pragma once

#include <string>
#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"
#include "core/topology/split_necks.h"

namespace isoskin {

struct CollisionOptions {
  double edge_length = 1.0;    // e, world units: the measure of the lengths below
  double stray_centre = 0.5;   // a moved triangle is quasi-critical when its centroid is farther from the surface; of e
  double stray_vertex = 0.05;  // the same of a vertex: it was not projected; units of e
  double least_slope = 0.1;    // distances are |F| / |grad F|, with |grad F| at least this share of its median
  double near = 2.0;           // sheets nearer than this belong together; units of e
  SplitOptions split;          // edge_length is filled in
};

/// One operation, a line of the ledger.
struct CollisionEvent {
  std::string kind;          // "blend", "split"; "pierce", "spackle": the same through a film, of a tunnel; "vanish"
  DVec3 position{0.0};       // centre of what was erased
  std::size_t vertices = 0;  // of the erased triangles
  double area = 0.0;         // of the new triangles, world units^2
};

/// A place.
struct Ball {
  DVec3 center{0.0};
  double radius = 0.0;
};

struct CollisionReport {
  std::vector<CollisionEvent> events;  // done, in order of their smallest triangle
  std::vector<Ball> split;             // about each neck or tunnel that was split
  std::size_t refused = 0;             // clusters for which nothing could be done
  std::size_t pairs = 0;               // overlapping pairs of triangles of sheets that face each other
  std::size_t strays = 0;              // quasi-critical triangles
};

/// `mesh` lies on the surface of the frame before, `moved` is where its vertices are after they were moved and
/// projected onto `field`, the backend's current one. Triangles of the moved mesh that the new surface has left, or
/// that overlap another sheet's, are gathered: those with common vertices are one patch, patches nearer than `near` one
/// cluster. Where the field says that a ring about a cluster encloses nothing any more, it is split; else its patches,
/// grown by their neighbours, are blended in pairs; a piece of mesh that has no surface at all is removed. All on the
/// mesh as it lies, which then has to be moved and looked at again: what three sheets need is done two by two.
/// Operations that do not fit are left out, and so are clusters in `split`, where this frame has split before. Vertices
/// about a split lose their velocity, which was that of the neck. The result is a closed, oriented 2-manifold; vertices
/// keep their ids and order. Parallel and deterministic.
CollisionReport handle_collisions(TriangleMesh& mesh, const std::vector<Vec3>& moved, Backend& backend,
                                  const Field& field, const std::vector<std::uint8_t>& open,
                                  const std::vector<Ball>& split, const CollisionOptions& options);

}  // namespace isoskin
