// Launches project.cl: Newton projection of points onto F = 0.
#pragma once

#include <span>

#include "core/mechanics/project.h"
#include "kernels/device_field.h"

namespace isoskin::opencl {

struct ProjectParams {  // ProjectParams in project.cl
  float tolerance;
  float max_step;
  cl_int max_newton;
  cl_int max_bisection;
  float reach;
};

ProjectParams project_params(const ProjectOptions& options);

class Projector {
public:
  explicit Projector(Device& device);
  /// Launches only; `points` holds 3 floats a point, `status` one byte.
  template <class Points, class Status>
  void launch(const DeviceField& field, const Points& points, const Status& status, std::size_t count,
              const ProjectOptions& options) {
    device_->launch_packets(project_(field), field.width(), count, field, points, status, project_params(options),
                            static_cast<cl_uint>(count));
  }
  /// As Backend::project.
  ProjectReport project(const DeviceField& field, std::span<Vec3> points, const ProjectOptions& options,
                        std::span<ProjectStatus> status);

private:
  Device* device_;
  FieldKernel project_;
};

/// Points and how many of them are quasi-critical.
ProjectReport count_status(std::span<const ProjectStatus> status);

}  // namespace isoskin::opencl
