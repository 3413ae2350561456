#include "kernels/resident_mesh.h"

#include <algorithm>

namespace isoskin::opencl {

void ResidentMesh::set(const TriangleMesh& mesh) {
  const VertexCorners corners = vertex_corners(mesh);
  positions.assign(mesh.vertices.position);
  vertex.assign(mesh.vertex);
  first.assign(corners.first);
  corner.assign(corners.corner);
  status.resize(mesh.vertex_count());
  std::ranges::fill(View<ProjectStatus>(status, Access::write).span(), ProjectStatus::converged);
}

}  // namespace isoskin::opencl
