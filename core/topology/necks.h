// Where a mesh is one triangle around: its shortest necks and handles.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// One byte a vertex: 1 where three edges through it make a loop that is no triangle of the mesh. On a good mesh there
/// are next to none. Only those with wanted != 0 are looked at; empty: all. Parallel.
std::vector<std::uint8_t> neck_vertices(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted = {});

}  // namespace isoskin
