// Flaps: skin that spans what the surface has left, between walls on which all of its vertices lie.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/backend.h"
#include "core/field/field.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Whether a point with this value and length of the gradient is far from the surface.
using IsFar = std::function<bool(double value, double slope)>;

/// Where a film or neck withdraws faster than its skin, vertices end on walls that face each other, with both layers of
/// the skin stretched out between them. An edge whose middle is far from the surface is astray; of every vertex with
/// such edges one edge is collapsed into a neighbour, as long as that leaves fewer astray, until none is left that can
/// be. The topology stays, vertices that stay are not moved. Edges between vertices that are `frozen` (one byte a
/// vertex, may be empty) are not looked at. The backend must hold the field. Returns the vertices that went.
/// Deterministic.
std::size_t collapse_flaps(TriangleMesh& mesh, const Field& field, Backend& backend,
                           const std::vector<std::uint8_t>& frozen, const IsFar& is_far);

}  // namespace isoskin
