// Fields made of balls, tori and their unions and differences, for tests of topology: F changes by at most the
// distance.
#pragma once

#include <cmath>
#include <functional>
#include <utility>

#include "core/field/field.h"

namespace isoskin {

class SolidField final : public Field {
public:
  using Solid = std::function<double(const DVec3&)>;  // positive inside, |F(p) - F(q)| <= |p - q|

  SolidField(Solid solid, const Box& bounds) : solid_(std::move(solid)), bounds_(bounds) {}

  FieldSample sample(const DVec3& p) const override {
    constexpr double kStep = 1e-5;
    DVec3 gradient;
    for (int a = 0; a < 3; ++a) {
      DVec3 d(0.0);
      d[a] = kStep;
      gradient[a] = (solid_(p + d) - solid_(p - d)) / (2.0 * kStep);
    }
    return {solid_(p), gradient};
  }
  double value(const DVec3& p) const override { return solid_(p); }
  Box bounds() const override { return bounds_; }
  Interval range(const Box& box) const override {
    const double middle = solid_(box.center()), reach = 0.5 * box.diagonal() * (1.0 + 1e-9);
    return {middle - reach, middle + reach};
  }

private:
  Solid solid_;
  Box bounds_;
};

namespace solid {

inline SolidField::Solid ball(const DVec3& center, double radius) {
  return [=](const DVec3& p) { return radius - glm::length(p - center); };
}
inline SolidField::Solid torus(const DVec3& center, double major, double minor) {
  return [=](const DVec3& p) {
    return minor - std::hypot(std::hypot(p.x - center.x, p.y - center.y) - major, p.z - center.z);
  };
}
/// A rod with round ends.
inline SolidField::Solid rod(const DVec3& a, const DVec3& b, double radius) {
  return [=](const DVec3& p) {
    const double t = std::min(1.0, std::max(0.0, glm::dot(p - a, b - a) / glm::dot(b - a, b - a)));
    return radius - glm::length(p - a - t * (b - a));
  };
}
/// A square plate with its edges rounded.
inline SolidField::Solid plate(const DVec3& center, double half_width, double half_thickness) {
  return [=](const DVec3& p) {
    const DVec3 q = p - center;
    const DVec3 out(std::max(std::abs(q.x) - half_width, 0.0), std::max(std::abs(q.y) - half_width, 0.0), q.z);
    return half_thickness - glm::length(out);
  };
}
inline SolidField::Solid both(SolidField::Solid a, SolidField::Solid b) {
  return [=](const DVec3& p) { return std::max(a(p), b(p)); };
}
inline SolidField::Solid without(SolidField::Solid a, SolidField::Solid b) {
  return [=](const DVec3& p) { return std::min(a(p), -b(p)); };
}

}  // namespace solid
}  // namespace isoskin
