// The mesh a backend holds between calls: positions and status stay on the device, topology is uploaded once.
#pragma once

#include <vector>

#include "core/mechanics/project.h"
#include "core/mesh/triangle_mesh.h"
#include "kernels/device.h"

namespace isoskin::opencl {

struct ResidentMesh {
  explicit ResidentMesh(Device& device)
      : positions(device), status(device), vertex(device), first(device), corner(device) {}

  /// Copies positions and topology in; every status becomes converged.
  void set(const TriangleMesh& mesh);

  std::size_t vertex_count() const { return positions.size(); }
  std::size_t triangle_count() const { return vertex.size() / 3; }

  Array<Vec3> positions;
  Array<ProjectStatus> status;
  Array<Index> vertex;         // 3 a triangle
  Array<Index> first, corner;  // VertexCorners
};

}  // namespace isoskin::opencl
