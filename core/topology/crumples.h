// Where skin lies on itself in many layers.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Triangles that overlap six others or more without a common vertex, ascending. Where two sheets or folds touch it is
/// fewer. Only within `reach` (world units) of triangles with folded != 0 (see folds.h): layers lie face up and face
/// down. Deterministic.
std::vector<Index> crumpled_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& folded, float reach);

}  // namespace isoskin
