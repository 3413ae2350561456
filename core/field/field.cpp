#include "core/field/field.h"

#include <cmath>

namespace isoskin {

void Field::values(const DVec3& origin, double spacing, const IVec3& count, std::span<double> out) const {
  std::size_t next = 0;
  for (int x = 0; x < count.x; ++x)
    for (int y = 0; y < count.y; ++y)
      for (int z = 0; z < count.z; ++z) out[next++] = value(origin + spacing * DVec3(x, y, z));
}

DMat3 Field::hessian(const DVec3& p) const {
  const double step = 1e-4 * (resolution() > 0.0 ? resolution() : 1.0);
  DMat3 h(0.0);
  for (int axis = 0; axis < 3; ++axis) {
    DVec3 offset(0.0);
    offset[axis] = step;
    h[axis] = (sample(p + offset).gradient - sample(p - offset).gradient) / (2.0 * step);
  }
  return 0.5 * (h + glm::transpose(h));
}

double Field::distance_estimate(const DVec3& p, double least_slope) const {
  const FieldSample s = sample(p);
  return std::abs(s.value) / std::max(glm::length(s.gradient), least_slope);
}

DVec3 outward_normal(const DVec3& gradient) {
  const double length = glm::length(gradient);
  return length > 0.0 ? -gradient / length : DVec3(0.0);
}

}  // namespace isoskin
