// Fields known in closed form, for everybody's tests: positive inside, range() never too narrow.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/field/field.h"

namespace isoskin::analytic {

// Bounds of |p - c| over a box.
inline Interval distance_range(const Box& box, const DVec3& c) {
  const DVec3 near = glm::max(glm::max(box.low - c, c - box.high), DVec3(0.0));
  const DVec3 far = glm::max(glm::abs(box.low - c), glm::abs(box.high - c));
  return {glm::length(near) * (1.0 - 1e-12), glm::length(far) * (1.0 + 1e-12)};
}

/// F = radius - |p - center|, the exact signed distance.
class SphereField final : public Field {
public:
  explicit SphereField(const DVec3& center = DVec3(0.0), double radius = 1.0) : center_(center), radius_(radius) {}

  FieldSample sample(const DVec3& p) const override {
    const DVec3 x = p - center_;
    const double d = glm::length(x);
    return {radius_ - d, d > 0.0 ? -x / d : DVec3(0.0)};
  }
  Box bounds() const override { return radius_ > 0.0 ? Box{center_ - radius_, center_ + radius_} : Box{}; }
  Interval range(const Box& box) const override {
    const Interval d = distance_range(box, center_);
    return {radius_ - d.high - 1e-12 * radius_, radius_ - d.low + 1e-12 * radius_};
  }

private:
  DVec3 center_;
  double radius_;
};

/// F = minor - distance to the circle of radius `major` about the z axis, the exact signed distance (minor < major).
class TorusField final : public Field {
public:
  explicit TorusField(double major = 1.0, double minor = 0.4) : major_(major), minor_(minor) {}

  FieldSample sample(const DVec3& p) const override {
    const double rho = std::hypot(p.x, p.y);
    const double d = std::hypot(rho - major_, p.z);
    if (rho == 0.0 || d == 0.0) return {minor_ - d, DVec3(0.0)};
    const double s = (rho - major_) / (rho * d);
    return {minor_ - d, DVec3(-s * p.x, -s * p.y, -p.z / d)};
  }
  Box bounds() const override {
    const DVec3 half(major_ + minor_, major_ + minor_, minor_);
    return {-half, half};
  }
  Interval range(const Box& box) const override {
    const Box flat{DVec3(box.low.x, box.low.y, 0.0), DVec3(box.high.x, box.high.y, 0.0)};
    const Interval rho = distance_range(flat, DVec3(0.0));
    const Box profile{DVec3(rho.low, 0.0, box.low.z), DVec3(rho.high, 0.0, box.high.z)};
    const Interval d = distance_range(profile, DVec3(major_, 0.0, 0.0));
    const double slack = 1e-12 * (major_ + minor_);
    return {minor_ - d.high - slack, minor_ - d.low + slack};
  }

private:
  double major_, minor_;
};

/// F = offset - normal . p (normal of any length but zero): inside is the half space against the normal. The surface
/// has no bounds of its own: bounds() is the box given.
class PlaneField final : public Field {
public:
  explicit PlaneField(const DVec3& normal, double offset = 0.0, const Box& box = {DVec3(-1.0), DVec3(1.0)})
      : normal_(normal), offset_(offset), box_(box) {}

  FieldSample sample(const DVec3& p) const override { return {offset_ - glm::dot(normal_, p), -normal_}; }
  Box bounds() const override { return box_; }
  Interval range(const Box& box) const override {
    const double middle = sample(box.center()).value;
    const double half = 0.5 * glm::dot(glm::abs(normal_), box.size());
    const double slack = 1e-12 * (std::abs(offset_) + std::abs(middle) + half);
    return {middle - half - slack, middle + half + slack};
  }

private:
  DVec3 normal_;
  double offset_;
  Box box_;
};

}  // namespace isoskin::analytic
