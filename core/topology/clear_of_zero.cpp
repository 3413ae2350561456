#include "core/topology/clear_of_zero.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/field/skeleton_field.h"

namespace isoskin {
namespace {

/// The second derivative that, with the value, tells how thin the surface is about a critical point; 0 where there is
/// none: at a maximum outside and a minimum inside.
double telling_curvature(const CriticalPoint& point) {
  const DVec3 size = glm::abs(point.hessian.values);
  const bool inside = point.value > 0.0;
  switch (point.kind) {
    case CriticalKind::maximum:
    case CriticalKind::minimum:
      return inside == (point.kind == CriticalKind::maximum) ? std::max({size.x, size.y, size.z}) : 0.0;
    case CriticalKind::two_saddle:  // a neck, or the gap along its axis
      return inside ? std::max(size.x, size.y) : size.z;
    case CriticalKind::one_saddle:  // a film, or the tunnel through it
      return inside ? size.x : std::max(size.y, size.z);
    case CriticalKind::degenerate:
      return 0.0;
  }
  return 0.0;
}

/// Of a metaball's potential, as SkeletonField has it.
double share_at(double distance, double radius) {
  const double q = 1.0 - distance * distance / (radius * radius);
  return q > 0.0 ? q * q * q : 0.0;
}

}  // namespace

std::shared_ptr<const Field> clear_of_zero(const Field& field, std::span<const CriticalPoint> points,
                                           const ClearOptions& options) {
  const auto* skeleton = dynamic_cast<const SkeletonField*>(&field);
  if (!skeleton) return nullptr;
  std::vector<SkeletonElement> elements = skeleton->elements();
  std::vector<double> value;
  for (const CriticalPoint& point : points) value.push_back(point.value);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const CriticalPoint& point = points[i];
    const double missing = 0.5 * telling_curvature(point) * options.length * options.length - std::abs(value[i]);
    if (!(missing > 0.0) || (value[i] > 0.0) != (point.value > 0.0)) continue;
    const DVec3 size = glm::abs(point.hessian.values);
    constexpr double kSteepest = 6.0;  // second derivative of a ball of weight and radius 1, at most
    const double allowed = options.curvature * std::min({size.x, size.y, size.z}) / kSteepest;  // weight by radius^2
    const double radius = std::min(std::sqrt(missing / allowed), options.farthest * options.length);
    SkeletonElement ball;
    ball.a = ball.b = point.position;
    ball.radius = radius;
    ball.weight = std::copysign(std::min(missing, allowed * radius * radius), point.value);
    const auto pushed = [&](std::size_t k) {
      return value[k] + ball.weight * share_at(glm::distance(points[k].position, point.position), radius);
    };
    bool keeps_signs = true;
    for (std::size_t k = 0; k < points.size(); ++k) keeps_signs &= (pushed(k) > 0.0) == (value[k] > 0.0);
    if (!keeps_signs) continue;
    for (std::size_t k = 0; k < points.size(); ++k) value[k] = pushed(k);
    elements.push_back(ball);
  }
  if (elements.size() == skeleton->elements().size()) return nullptr;
  return std::make_shared<SkeletonField>(std::move(elements), skeleton->iso());
}

}  // namespace isoskin
