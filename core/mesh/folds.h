// Where a mesh faces away from the surface it is to lie on.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// One byte a triangle: 1 where it does not face the way that its corners' `normals` (outward, of the field; one a
/// vertex) do together. Without area it faces no way. Parallel.
std::vector<std::uint8_t> folded_triangles(const TriangleMesh& mesh, const std::vector<Vec3>& normals);

}  // namespace isoskin
