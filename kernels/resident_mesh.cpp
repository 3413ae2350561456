#include "kernels/resident_mesh.h"

#include <algorithm>
#include <vector>

namespace isoskin::opencl {

void ResidentMesh::set(const TriangleMesh& mesh, std::span<const std::uint8_t> pinned_vertices) {
  const VertexCorners corners = vertex_corners(mesh);
  positions.assign(mesh.vertices.position);
  vertex.assign(mesh.vertex);
  first.assign(corners.first);
  corner.assign(corners.corner);
  if (pinned_vertices.empty())
    pinned.assign(std::vector<std::uint8_t>(mesh.vertex_count(), 0));
  else
    pinned.assign(pinned_vertices);
  status.resize(mesh.vertex_count());
  std::ranges::fill(View<ProjectStatus>(status, Access::write).span(), ProjectStatus::converged);
}

}  // namespace isoskin::opencl
