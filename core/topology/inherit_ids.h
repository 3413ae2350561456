// Which vertices of new skin are old ones: identity goes on where the skin does.
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Vertices of `mesh` with ids from `first_new` on take the ids of those of `old`, the same skin before a repair, that
/// are gone: each the one nearest to it, when it is the nearest to that one too, no farther than `reach` (world units),
/// and the field's surface faces the same way at both. `old` has moved with the surface, so nothing jumps farther than
/// `reach`. The backend must hold the field. Returns the ids taken. Deterministic.
std::vector<Index> inherit_ids(TriangleMesh& mesh, Index first_new, const VertexTable& old, Backend& backend,
                               float reach);

}  // namespace isoskin
