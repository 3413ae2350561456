#include "kernels/relax.h"

#include <algorithm>
#include <cmath>

namespace isoskin::opencl {

Relaxer::Relaxer(Device& device)
    : elements_(device), cg_(device), sharpener_(device), vertex_normals_(device), inverted_(device) {}

RelaxReport Relaxer::relax(const DeviceField& field, ResidentMesh& mesh, Projector& projector, Normals& normals,
                           const RelaxOptions& options, const ProjectOptions& project) {
  check(options);
  RelaxReport report;
  if (options.steps <= 0 || mesh.vertex_count() == 0) {
    report.steps = std::max(options.steps, 0);
    return report;
  }
  const float longest = options.max_move * options.edge_length;
  vertex_normals_.resize(mesh.vertex_count());
  inverted_.resize(mesh.triangle_count());
  cg_.reset();
  for (; report.steps < options.steps; ++report.steps) {
    normals.vertex_normals(field, mesh, vertex_normals_);
    normals.mark_inverted(field, mesh, vertex_normals_, inverted_);
    elements_.forces(mesh, vertex_normals_, inverted_, options);
    cg_.solve(mesh, vertex_normals_, elements_, options);
    cg_.move(mesh, longest);
    projector.launch(field, mesh.positions, mesh.status, mesh.vertex_count(), project);
    for (int pull = 0; options.sharp && pull < options.sharp_pulls; ++pull) {
      sharpener_.pull(field, mesh, project, longest);
      projector.launch(field, mesh.positions, mesh.status, mesh.vertex_count(), project);
    }
  }
  CgState cg{};
  cg_.fetch_state(cg);
  View<std::uint8_t> inverted(inverted_, Access::read);
  View<ProjectStatus> status(mesh.status, Access::read);
  report.inverted = std::ranges::count(inverted.span(), 1);
  report.quasi_critical = count_status(status.span()).quasi_critical;
  report.cg_iterations = cg.iterations;
  report.residual = cg.start > 0.0f ? std::sqrt(static_cast<double>(cg.rr) / cg.start) : 0.0;
  return report;
}

}  // namespace isoskin::opencl
