// The skin round a neck or tunnel, however crumpled (design 8: how they are severed where no plane does).
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/topology/mesh_probe.h"

namespace isoskin {

/// A part of a mesh with the topology of an annulus.
struct Annulus {
  std::vector<Index> triangle;               // ascending
  std::array<std::vector<Index>, 2> border;  // the higher one first: halfedges of `triangle` in order
};

/// Of the triangles that hang together within one of the `radii` (ascending) about the plane's origin, the first such
/// part whose borders both wind once about the plane's normal, the lower one `turn` times counter-clockwise seen from
/// above: 1 about a solid, -1 about a tunnel. What they look like in between does not matter.
std::optional<Annulus> annulus_about(const TriangleMesh& mesh, const Plane& plane, int turn,
                                     const std::vector<double>& radii);

}  // namespace isoskin
