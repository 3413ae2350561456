#include "core/mesh/folds.h"

#include "core/parallel.h"

namespace isoskin {

std::vector<std::uint8_t> folded_triangles(const TriangleMesh& mesh, const std::vector<Vec3>& normals) {
  std::vector<std::uint8_t> folded(mesh.triangle_count());
  for_each_index(folded.size(), [&](std::size_t t) {
    const Index a = mesh.vertex[3 * t], b = mesh.vertex[3 * t + 1], c = mesh.vertex[3 * t + 2];
    const Vec3 faces = glm::cross(mesh.position(b) - mesh.position(a), mesh.position(c) - mesh.position(a));
    folded[t] = !(glm::dot(faces, normals[a] + normals[b] + normals[c]) > 0.0f);
  });
  return folded;
}

}  // namespace isoskin
