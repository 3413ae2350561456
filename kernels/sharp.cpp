#include "kernels/sharp.h"

#include "embedded/project.cl.h"
#include "embedded/sharp.cl.h"

namespace isoskin::opencl {

Sharpener::Sharpener(Device& device)
    : device_(&device),
      planes_(device, {source::project, source::sharp}, "centroid_planes"),
      pull_(device, {source::project, source::sharp}, "pull"),
      through_(device),
      normal_(device),
      area_(device) {}

void Sharpener::pull(const DeviceField& field, ResidentMesh& mesh, const ProjectOptions& options, float longest) {
  const auto triangles = static_cast<cl_uint>(mesh.triangle_count());
  const auto vertices = static_cast<cl_uint>(mesh.vertex_count());
  through_.resize(triangles);
  normal_.resize(triangles);
  area_.resize(triangles);
  device_->launch_packets(planes_(field), field.width(), triangles, field, mesh.positions, mesh.vertex, through_,
                          normal_, area_, project_params(options), triangles);
  device_->launch(pull_(field), vertices, mesh.first, mesh.corner, through_, normal_, area_, mesh.positions,
                  field.origin(), longest, vertices);
}

}  // namespace isoskin::opencl
