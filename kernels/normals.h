// Launches normals.cl: the field's outward normals at vertices and the triangles that face the wrong way.
#pragma once

#include "kernels/device_field.h"
#include "kernels/resident_mesh.h"

namespace isoskin::opencl {

class Normals {
public:
  explicit Normals(Device& device);

  /// Launches only. normals: 3 floats a vertex.
  template <class Out>
  void vertex_normals(const DeviceField& field, const ResidentMesh& mesh, const Out& normals) {
    device_->launch_packets(vertex_normals_(field), field.width(), mesh.vertex_count(), field, mesh.positions, normals,
                            static_cast<cl_uint>(mesh.vertex_count()));
  }
  /// Launches only. inverted: one byte a triangle.
  template <class In, class Out>
  void mark_inverted(const DeviceField& field, const ResidentMesh& mesh, const In& normals, const Out& inverted) {
    device_->launch(mark_inverted_(field), mesh.triangle_count(), mesh.positions, normals, mesh.vertex, inverted,
                    static_cast<cl_uint>(mesh.triangle_count()));
  }

private:
  Device* device_;
  FieldKernel vertex_normals_, mark_inverted_;
};

}  // namespace isoskin::opencl
