// Where skin lies on itself in many layers.
#pragma once

#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Triangles that overlap six others or more without a common vertex, ascending. Where two sheets or folds touch it is
/// fewer. Costs what overlapping_pairs() does. Deterministic.
std::vector<Index> crumpled_triangles(const TriangleMesh& mesh);

}  // namespace isoskin
