// Launches evaluate.cl: values, gradients and Hessians of a field at the caller's points.
#pragma once

#include <span>

#include "kernels/device_field.h"

namespace isoskin::opencl {

class Evaluator {
public:
  explicit Evaluator(Device& device);
  /// As Backend::evaluate and Backend::evaluate_hessian; sizes are the caller's duty.
  void evaluate(const DeviceField& field, std::span<const Vec3> points, std::span<float> values,
                std::span<Vec3> gradients);
  void evaluate_hessian(const DeviceField& field, std::span<const Vec3> points, std::span<float> hessians);

private:
  Device* device_;
  FieldKernel both_, values_, hessian_;
};

}  // namespace isoskin::opencl
