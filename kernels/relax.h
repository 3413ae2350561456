// One relaxation of the resident mesh, batched: everything is launched, then waited for once.
#pragma once

#include "kernels/cg.h"
#include "kernels/element.h"
#include "kernels/normals.h"
#include "kernels/project.h"
#include "kernels/sharp.h"

namespace isoskin::opencl {

class Relaxer {
public:
  explicit Relaxer(Device& device);
  /// As relax_skin() in core/mechanics/relax.h, on the resident positions and status.
  RelaxReport relax(const DeviceField& field, ResidentMesh& mesh, Projector& projector, Normals& normals,
                    const RelaxOptions& options, const ProjectOptions& project);

private:
  Elements elements_;
  ConjugateGradients cg_;
  Sharpener sharpener_;
  Array<Vec3> vertex_normals_;
  Array<std::uint8_t> inverted_;
};

}  // namespace isoskin::opencl
