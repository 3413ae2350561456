// The mesh a backend holds between calls: positions and status stay on the device, topology is uploaded once.
#pragma once

#include <span>

#include "core/mechanics/project.h"
#include "core/mesh/triangle_mesh.h"
#include "kernels/device.h"

namespace isoskin::opencl {

struct ResidentMesh {
  explicit ResidentMesh(Device& device)
      : positions(device), status(device), pinned(device), vertex(device), first(device), corner(device) {}

  /// Copies positions and topology in; every status becomes converged. `pinned`: one byte a vertex, or none.
  void set(const TriangleMesh& mesh, std::span<const std::uint8_t> pinned = {});

  std::size_t vertex_count() const { return positions.size(); }
  std::size_t triangle_count() const { return vertex.size() / 3; }

  Array<Vec3> positions;
  Array<ProjectStatus> status;
  Array<std::uint8_t> pinned;  // 1: relaxation does not move this vertex
  Array<Index> vertex;         // 3 a triangle
  Array<Index> first, corner;  // VertexCorners
};

}  // namespace isoskin::opencl
