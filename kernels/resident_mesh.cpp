#include "kernels/resident_mesh.h"

#include <vector>

namespace isoskin::opencl {

void ResidentMesh::set(const TriangleMesh& mesh, std::span<const std::uint8_t> pinned_vertices) {
  const VertexCorners corners = vertex_corners(mesh);
  const std::vector<std::uint8_t> zeros(mesh.vertex_count(), 0);
  const std::vector<ProjectStatus> fresh(mesh.vertex_count(), ProjectStatus::converged);
  positions.send(mesh.vertices.position);
  vertex.send(mesh.vertex);
  first.send(corners.first);
  corner.send(corners.corner);
  pinned.send(pinned_vertices.empty() ? zeros : pinned_vertices);
  status.send(fresh);
  positions.device().finish();
}

}  // namespace isoskin::opencl
