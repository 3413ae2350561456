// Says whether a mesh is a closed, oriented 2-manifold, and if not, where and why.
#pragma once

#include <string>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct ValidateReport {
  bool ok = true;
  std::string reason;  // the first fault found, with the indices involved; empty when ok
  explicit operator bool() const { return ok; }
};

/// Checks (design 4): array sizes agree; indices in range; twin is an involution between opposite directions; no
/// triangle with a repeated vertex; no two edges with the same ends; no duplicate triangle; one fan of triangles about
/// each vertex; no unused vertex; every position and column finite; ids unique and below next_id.
ValidateReport validate(const TriangleMesh& mesh);

}  // namespace isoskin
