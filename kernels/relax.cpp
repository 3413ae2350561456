#include "kernels/relax.h"

#include <algorithm>
#include <cmath>

namespace isoskin::opencl {

Relaxer::Relaxer(Device& device)
    : elements_(device),
      cg_(device),
      sharpener_(device),
      vertex_normals_(device),
      inverted_before_(device),
      inverted_(device) {}

void Relaxer::launch(const DeviceField& field, ResidentMesh& mesh, Projector& projector, Normals& normals,
                     const RelaxOptions& options, const ProjectOptions& project) {
  const float longest = options.max_move * options.edge_length;
  cg_.reset();
  for (steps_ = 0; steps_ < options.steps; ++steps_) {
    mark_inverted(field, mesh, normals, inverted_before_);
    elements_.forces(mesh, vertex_normals_, inverted_before_, options);
    cg_.solve(mesh, vertex_normals_, elements_, options);
    cg_.move(mesh, longest);
    projector.launch(field, mesh.positions, mesh.status, mesh.vertex_count(), project);
    for (int pull = 0; options.sharp && pull < options.sharp_pulls; ++pull) {
      sharpener_.pull(field, mesh, project, longest);
      projector.launch(field, mesh.positions, mesh.status, mesh.vertex_count(), project);
    }
  }
  mark_inverted(field, mesh, normals, inverted_);
}

RelaxReport Relaxer::report() {
  cg_.fetch_state(cg_state_);
  View<std::uint8_t> inverted(inverted_before_, Access::read);
  RelaxReport report;
  report.steps = steps_;
  report.inverted = std::ranges::count(inverted.span(), 1);
  elements_.let_go();
  cg_.let_go();
  report.cg_iterations = cg_state_.iterations;
  report.residual = cg_state_.start > 0.0f ? std::sqrt(static_cast<double>(cg_state_.rr) / cg_state_.start) : 0.0;
  return report;
}

void Relaxer::mark_inverted(const DeviceField& field, ResidentMesh& mesh, Normals& normals,
                            Array<std::uint8_t>& inverted) {
  vertex_normals_.resize(mesh.vertex_count());
  inverted.resize(mesh.triangle_count());
  normals.vertex_normals(field, mesh, vertex_normals_);
  normals.mark_inverted(field, mesh, vertex_normals_, inverted);
}

}  // namespace isoskin::opencl
