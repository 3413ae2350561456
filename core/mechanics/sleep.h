// Skin at rest sleeps: where the field stands still, vertices stay as they are, bit for bit, and cost nothing.
#pragma once

#include <cstdint>
#include <vector>

#include "core/field/field_changes.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct SleepOptions {
  Index rest_frames =
      4;                // frames for which skin goes on settling after the field changed near it or an edit touched it
  double margin = 3.0;  // what lies nearer than this to a change of the field wakes with it; units of e
};

/// The ages of vertices within the mask become 1 at most: a change of the field counts as an edit of the frame before,
/// which locks nothing. Parallel.
void wake(VertexTable& vertices, const ChangeMask& changed);

/// One byte a vertex: 1 where it sleeps, having been left alone for more than options.rest_frames frames. Empty when
/// none does. Ages are in the files, so a resumed run sleeps and wakes as an unbroken one.
std::vector<std::uint8_t> sleeping(const VertexTable& vertices, const SleepOptions& options);

}  // namespace isoskin
