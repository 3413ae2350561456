// Triangles between two closed lines of vertices.
#pragma once

#include <vector>

#include "core/topology/mesh_patch.h"

namespace isoskin {

/// Adds to `patch` triangles between the hole's border `loop` and the ring, both the same way round, at least 3
/// vertices each: of all ways to step along both from a common start, the one whose crossing edges have the least sum
/// of squares (Fuchs, Kedem and Uselton 1977). `p` and `q` are their positions. Starts tried: loop[0] with each of the
/// first `starts` of the ring.
void weave(MeshPatch& patch, const std::vector<Index>& loop, const std::vector<DVec3>& p,
           const std::vector<Index>& ring, const std::vector<DVec3>& q, std::size_t starts);

}  // namespace isoskin
