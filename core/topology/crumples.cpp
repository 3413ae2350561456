#include "core/topology/crumples.h"

#include "core/topology/triangle_pairs.h"

namespace isoskin {

std::vector<Index> crumpled_triangles(const TriangleMesh& mesh) {
  constexpr int kLayers = 6;
  std::vector<int> overlaps(mesh.triangle_count(), 0);
  for (const auto& [a, b] : overlapping_pairs(mesh)) {
    ++overlaps[a];
    ++overlaps[b];
  }
  std::vector<Index> crumpled;
  for (Index t = 0; t < overlaps.size(); ++t)
    if (overlaps[t] >= kLayers) crumpled.push_back(t);
  return crumpled;
}

}  // namespace isoskin
