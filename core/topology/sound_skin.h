// Skin that lies on the surface as it should.
#pragma once

#include <cstdint>
#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct SoundOptions {
  float reach = 0.25f;   // how far a triangle's corners, the middles of its sides and its centroid may be off the
                         // surface, world units
  float layers = 0.5f;   // how far apart, along their normals, layers of one surface may lie, world units
  float longest = 1.0f;  // triangles with longer sides are not sound, world units
};

/// One byte a triangle: 1 where it lies on the surface of the backend's field, faces the way that this faces, and no
/// other such triangle lies over it: of a fold that lies flat on the surface nothing is sound. Only triangles with
/// wanted != 0 (one byte a vertex) at a corner are looked at. Parallel.
std::vector<std::uint8_t> sound_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted,
                                          Backend& backend, const SoundOptions& options);

}  // namespace isoskin
