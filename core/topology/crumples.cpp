#include "core/topology/crumples.h"

#include "core/mesh/independent_edits.h"
#include "core/topology/point_grid.h"
#include "core/topology/triangle_pairs.h"

namespace isoskin {
namespace {

std::vector<Index> triangles_near(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted, float reach) {
  std::vector<Vec3> corners;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (wanted[h / 3]) corners.push_back(mesh.position(mesh.vertex[h]));
  const PointGrid near(corners, reach);
  return indices_where(mesh.triangle_count(), [&](Index t) {
    return near.any_near(mesh.position(mesh.vertex[3 * t])) || near.any_near(mesh.position(mesh.vertex[3 * t + 1])) ||
           near.any_near(mesh.position(mesh.vertex[3 * t + 2]));
  });
}

}  // namespace

std::vector<Index> crumpled_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& folded, float reach) {
  constexpr int kLayers = 6;
  const std::vector<Index> triangles = triangles_near(mesh, folded, reach);
  TriangleMesh part;
  part.vertices.position = mesh.vertices.position;
  for (const Index t : triangles)
    part.vertex.insert(part.vertex.end(), {mesh.vertex[3 * t], mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]});
  std::vector<int> overlaps(triangles.size(), 0);
  for (const auto& [a, b] : overlapping_pairs(part)) {
    ++overlaps[a];
    ++overlaps[b];
  }
  std::vector<Index> crumpled;
  for (Index i = 0; i < overlaps.size(); ++i)
    if (overlaps[i] >= kLayers) crumpled.push_back(triangles[i]);
  return crumpled;
}

}  // namespace isoskin
