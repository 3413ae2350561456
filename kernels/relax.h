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
  /// Enqueues only, as relax_skin() in core/mechanics/relax.h, on the resident positions and status; then marks the
  /// triangles that are inverted where it ends. Not with options.steps <= 0 or an empty mesh.
  void launch(const DeviceField& field, ResidentMesh& mesh, Projector& projector, Normals& normals,
              const RelaxOptions& options, const ProjectOptions& project);
  /// Waits for it, then gives back the memory of what is over. All but quasi_critical.
  RelaxReport report();
  Array<std::uint8_t>& inverted() { return inverted_; }

private:
  void mark_inverted(const DeviceField& field, ResidentMesh& mesh, Normals& normals, Array<std::uint8_t>& inverted);

  Elements elements_;
  ConjugateGradients cg_;
  Sharpener sharpener_;
  Array<Vec3> vertex_normals_;
  Array<std::uint8_t> inverted_before_, inverted_;  // at the start of the last step, and after it
  int steps_ = 0;
  CgState cg_state_{};
};

}  // namespace isoskin::opencl
