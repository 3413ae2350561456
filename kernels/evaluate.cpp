#include "kernels/evaluate.h"

namespace isoskin::opencl {

Evaluator::Evaluator(Device& device)
    : device_(&device),
      both_(device, field_kernels(), "evaluate"),
      values_(device, field_kernels(), "evaluate_values"),
      hessian_(device, field_kernels(), "evaluate_hessian") {}

void Evaluator::evaluate(const DeviceField& field, std::span<const Vec3> points, std::span<float> values,
                         std::span<Vec3> gradients) {
  if (points.empty()) return;
  const auto count = static_cast<cl_uint>(points.size());
  const Borrowed in(*device_, points.data(), points.size_bytes());
  Borrowed out(*device_, values.data(), values.size_bytes(), Access::write);
  if (gradients.empty()) {
    device_->launch_packets(values_(field), field.width(), count, field, in, out, count);
    out.collect();
    device_->finish();
  } else {
    Borrowed slopes(*device_, gradients.data(), gradients.size_bytes(), Access::write);
    device_->launch_packets(both_(field), field.width(), count, field, in, out, slopes, count);
    out.collect();
    slopes.collect();
    device_->finish();
  }
}

void Evaluator::evaluate_hessian(const DeviceField& field, std::span<const Vec3> points, std::span<float> hessians) {
  if (points.empty()) return;
  const auto count = static_cast<cl_uint>(points.size());
  const Borrowed in(*device_, points.data(), points.size_bytes());
  Borrowed out(*device_, hessians.data(), hessians.size_bytes(), Access::write);
  device_->launch_packets(hessian_(field), field.width(), count, field, in, out, count);
  out.collect();
  device_->finish();
}

}  // namespace isoskin::opencl
