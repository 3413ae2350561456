#include "kernels/project.h"

#include <algorithm>

namespace isoskin::opencl {

ProjectParams project_params(const ProjectOptions& options) {
  return {options.tolerance, options.max_step, options.max_newton, options.max_bisection, options.reach};
}

Projector::Projector(Device& device) : device_(&device), project_(device, field_kernels(), "project") {}

ProjectReport Projector::project(const DeviceField& field, std::span<Vec3> points, const ProjectOptions& options,
                                 std::span<ProjectStatus> status) {
  if (points.empty()) return {};
  std::vector<ProjectStatus> own(status.empty() ? points.size() : 0);
  if (status.empty()) status = own;
  Borrowed moved(*device_, points.data(), points.size_bytes(), Access::read_write);
  Borrowed flags(*device_, status.data(), status.size_bytes(), Access::write);
  launch(field, moved, flags, points.size(), options);
  moved.collect();
  flags.collect();
  device_->finish();
  return count_status(status);
}

ProjectReport count_status(std::span<const ProjectStatus> status) {
  const auto converged = std::count(status.begin(), status.end(), ProjectStatus::converged);
  return {status.size(), status.size() - static_cast<std::size_t>(converged)};
}

}  // namespace isoskin::opencl
