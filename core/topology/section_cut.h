// A mesh is cut along a closed curve and both sides are closed (design 8: how necks and tunnels are severed).
#pragma once

#include <utility>

#include "core/topology/mesh_patch.h"
#include "core/topology/mesh_probe.h"

namespace isoskin {

/// The mean of the section's points.
DVec3 middle_of(const Section& section);

/// Adds to `patch`: the triangles that `section` crosses are taken away, and the border left above the plane is closed
/// by a fan about a new vertex at `high`, the one below at `low`. Where a border touches itself it is given vertices of
/// its own. Returns the patch's numbers of the two new vertices. Euler characteristic: +2.
std::pair<Index, Index> cut_and_cap(const TriangleMesh& mesh, MeshPatch& patch, const Section& section,
                                    const DVec3& high, const DVec3& low);

}  // namespace isoskin
