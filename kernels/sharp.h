// Launches sharp.cl: pulls resident vertices onto the field's sharp features.
#pragma once

#include "kernels/project.h"
#include "kernels/resident_mesh.h"

namespace isoskin::opencl {

class Sharpener {
public:
  explicit Sharpener(Device& device);
  /// Launches only: as pull_to_sharp_features() in core/mechanics/relax.h.
  void pull(const DeviceField& field, ResidentMesh& mesh, const ProjectOptions& options, float longest);

private:
  Device* device_;
  FieldKernel planes_, pull_;
  Array<Vec3> through_, normal_;
  Array<float> area_;
};

}  // namespace isoskin::opencl
