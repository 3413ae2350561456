#include "core/mechanics/project.h"

#include <cmath>

namespace isoskin {
namespace {

bool finite(const DVec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool usable(const FieldSample& s) {
  return std::isfinite(s.value) && finite(s.gradient) && glm::dot(s.gradient, s.gradient) > 0.0;
}

bool on_surface(const FieldSample& s, double tolerance) {
  return std::abs(s.value) <= tolerance * glm::length(s.gradient);
}

struct Iterate {
  DVec3 point{0.0};
  FieldSample sample;
};

Projection bracketed(const Field& field, Iterate a, Iterate b, const Projection& failed,
                     const ProjectOptions& options) {
  bool bisect = false;
  for (int i = 0; i < options.max_bisection; ++i) {
    const double width = glm::length(b.point - a.point);
    if (width <= options.tolerance) {
      return {std::abs(a.sample.value) <= std::abs(b.sample.value) ? a.point : b.point, ProjectStatus::converged};
    }
    const double t = bisect ? 0.5 : a.sample.value / (a.sample.value - b.sample.value);
    Iterate middle{a.point + t * (b.point - a.point), {}};
    middle.sample = field.sample(middle.point);
    if (!usable(middle.sample)) return failed;
    if (on_surface(middle.sample, options.tolerance)) return {middle.point, ProjectStatus::converged};
    const bool same_side_as_a = (middle.sample.value > 0.0) == (a.sample.value > 0.0);
    (same_side_as_a ? a : b) = middle;
    bisect = !bisect && glm::length(b.point - a.point) > 0.5 * width;
  }
  return failed;
}

}  // namespace

Projection project_point(const Field& field, const DVec3& point, const ProjectOptions& options) {
  const Projection failed{point, ProjectStatus::quasi_critical};
  if (!finite(point)) return failed;
  Iterate now{point, field.sample(point)};
  for (int i = 0;; ++i) {
    if (!usable(now.sample)) return failed;
    if (on_surface(now.sample, options.tolerance)) return {now.point, ProjectStatus::converged};
    if (i == options.max_newton) return failed;
    const double slope2 = glm::dot(now.sample.gradient, now.sample.gradient);
    DVec3 step = -now.sample.value / slope2 * now.sample.gradient;
    const double length = glm::length(step);
    if (!std::isfinite(length)) return failed;  // a gradient so small that the step overflows
    if (length > options.max_step) step *= options.max_step / length;
    Iterate next{now.point + step, {}};
    if (glm::length(next.point - point) > options.reach) return failed;
    next.sample = field.sample(next.point);
    if ((next.sample.value > 0.0) != (now.sample.value > 0.0) && usable(next.sample)) {
      if (on_surface(next.sample, options.tolerance)) return {next.point, ProjectStatus::converged};
      return bracketed(field, now, next, failed, options);
    }
    now = next;
  }
}

}  // namespace isoskin
