// Necks and tunnels thinner than the mesh can follow.
#pragma once

#include <span>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/topology/critical_points.h"

namespace isoskin {

struct ThinOptions {
  double edge_length = 1.0;  // e, world units
  double thin = 0.8;         // necks and tunnels are thin where their smaller radius is below this; units of e
  double longest = 3.0;      // such a part reaches no farther along its axis than this; units of e
};

/// Vertices on the thin part of a neck (about a 2-saddle inside) or tunnel (about a 1-saddle outside), ascending. There
/// F is about v + (l1 x^2 + l2 y^2 + l3 z^2) / 2, so the waist has the radius sqrt(2 |v| / l) and widens along its axis
/// with the root of the ratio of the eigenvalues. Elements of edge e do not fit round it: relaxed, they fold over, and
/// coarsened, the waist becomes a prism that the surface leaves. Kept as they are and projected, they follow it, small,
/// until it is wide enough or is cut. `frozen` (one byte a vertex, may be empty): vertices that are not asked for.
/// Parallel.
std::vector<Index> thin_feature_vertices(const TriangleMesh& mesh, std::span<const CriticalPoint> points,
                                         const ThinOptions& options, const std::vector<std::uint8_t>& frozen = {});

}  // namespace isoskin
