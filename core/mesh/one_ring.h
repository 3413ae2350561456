// Walks about a vertex.
#pragma once

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// visit(k) for each halfedge k that leaves from(h), beginning with h, clockwise; of a mesh without borders.
template <class Visit>
void for_each_leaving(const TriangleMesh& mesh, Index h, const Visit& visit) {
  Index k = h;
  do {
    visit(k);
    k = mesh.turn(k);
  } while (k != h);
}

}  // namespace isoskin
