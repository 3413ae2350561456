// Fields known in closed form, for everybody's tests: positive inside, range() never too narrow.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>

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

/// F = the least distance to the faces' planes, positive in the box: C0, with edges.
class BoxField final : public Field {
public:
  explicit BoxField(const Box& box) : box_(box) {}

  FieldSample sample(const DVec3& p) const override {
    FieldSample s{std::numeric_limits<double>::infinity(), DVec3(0.0)};
    for (int i = 0; i < 3; ++i) {
      for (const double side : {-1.0, 1.0}) {
        const double value = side < 0.0 ? p[i] - box_.low[i] : box_.high[i] - p[i];
        if (!(value < s.value)) continue;
        s = {value, DVec3(0.0)};
        s.gradient[i] = -side;
      }
    }
    return s;
  }
  Box bounds() const override { return box_; }
  Interval range(const Box& box) const override {  // one-Lipschitz in the maximum norm, hence in the Euclidean
    const double middle = value(box.center()), half = 0.5 * std::max({box.size().x, box.size().y, box.size().z});
    const double slack = 1e-12 * (std::abs(middle) + half);
    return {middle - half - slack, middle + half + slack};
  }
  bool is_c2() const override { return false; }

private:
  Box box_;
};

/// F = (sin x cos y + sin y cos z + sin z cos x) / k with coordinates times k = 2 pi / wavelength, less `offset`: half
/// of space, everywhere saddles. Cut it with a box.
class GyroidField final : public Field {
public:
  explicit GyroidField(double wavelength = 1.0, double offset = 0.0) : k_(2.0 * M_PI / wavelength), offset_(offset) {}

  FieldSample sample(const DVec3& p) const override {
    const DVec3 s = glm::sin(k_ * p), c = glm::cos(k_ * p);
    return {(s.x * c.y + s.y * c.z + s.z * c.x) / k_ - offset_,
            DVec3(c.x * c.y - s.z * s.x, c.y * c.z - s.x * s.y, c.z * c.x - s.y * s.z)};
  }
  Box bounds() const override {
    return {DVec3(-std::numeric_limits<double>::infinity()), DVec3(std::numeric_limits<double>::infinity())};
  }
  Interval range(const Box& box) const override {
    // Each derivative is (cos a, sin a) . (cos b, -sin c), at most sqrt(2).
    const double middle = value(box.center()), reach = 1.0001 * std::sqrt(6.0) * 0.5 * box.diagonal();
    return {middle - reach, middle + reach};
  }

private:
  double k_, offset_;
};

/// The intersection (minimum) or the union (maximum) of two fields.
class PairField final : public Field {
public:
  enum class Kind { intersection, both };
  PairField(Kind kind, std::shared_ptr<const Field> a, std::shared_ptr<const Field> b)
      : kind_(kind), a_(std::move(a)), b_(std::move(b)) {}

  FieldSample sample(const DVec3& p) const override {
    const FieldSample a = a_->sample(p), b = b_->sample(p);
    return (a.value < b.value) == (kind_ == Kind::intersection) ? a : b;
  }
  Box bounds() const override {
    Box a = a_->bounds();
    const Box b = b_->bounds();
    if (kind_ == Kind::intersection) return {glm::max(a.low, b.low), glm::min(a.high, b.high)};
    a.add(b);
    return a;
  }
  Interval range(const Box& box) const override {
    const Interval a = a_->range(box), b = b_->range(box);
    if (kind_ == Kind::intersection) return {std::min(a.low, b.low), std::min(a.high, b.high)};
    return {std::max(a.low, b.low), std::max(a.high, b.high)};
  }
  bool is_c2() const override { return false; }

private:
  Kind kind_;
  std::shared_ptr<const Field> a_, b_;
};

/// A sphere about the origin cut by the plane z = height: flat on top, a sharp circle.
inline std::shared_ptr<const Field> capped_sphere(double radius, double height) {
  const Box all{DVec3(-2.0 * radius), DVec3(2.0 * radius)};
  return std::make_shared<PairField>(PairField::Kind::intersection, std::make_shared<SphereField>(DVec3(0.0), radius),
                                     std::make_shared<PlaneField>(DVec3(0.0, 0.0, 1.0), height, all));
}

/// A gyroid in the cube of half-width `half`: many handles.
inline std::shared_ptr<const Field> boxed_gyroid(double half, double wavelength, double offset = 0.0) {
  return std::make_shared<PairField>(PairField::Kind::intersection, std::make_shared<GyroidField>(wavelength, offset),
                                     std::make_shared<BoxField>(Box{DVec3(-half), DVec3(half)}));
}

/// Two square sheets of half-width `half` and the given thickness, a gap apart, facing each other along z.
inline std::shared_ptr<const Field> two_sheets(double half, double thickness, double gap) {
  const double inner = 0.5 * gap, outer = inner + thickness;
  return std::make_shared<PairField>(
      PairField::Kind::both, std::make_shared<BoxField>(Box{DVec3(-half, -half, -outer), DVec3(half, half, -inner)}),
      std::make_shared<BoxField>(Box{DVec3(-half, -half, inner), DVec3(half, half, outer)}));
}

/// The eight Morse events, each on a closed smooth surface. With a the sum of the first `positive` squared coordinates
/// and b that of the others, F = c - (a - 1)^2 - b. The origin is critical, with value c - 1 and `positive` positive
/// eigenvalues, and nothing else happens near c = 1:
///   positive  kind      c < 1             c > 1           c rises      c falls
///   0         maximum   nothing           a ball          create       destroy
///   1         2-saddle  two balls         one             connect      cut
///   2         1-saddle  a torus           a ball          spackle      pierce
///   3         minimum   a ball, hollow    a ball          burst        open
class MorseField final : public Field {
public:
  MorseField(int positive, double c) : positive_(positive), c_(c) {}

  FieldSample sample(const DVec3& p) const override {
    const double well = square(p) - 1.0;
    FieldSample s{c_ - well * well, DVec3(0.0)};
    for (int i = 0; i < 3; ++i) {
      if (i >= positive_) s.value -= p[i] * p[i];
      s.gradient[i] = i < positive_ ? -4.0 * well * p[i] : -2.0 * p[i];
    }
    return s;
  }
  DMat3 hessian(const DVec3& p) const override {
    const double well = square(p) - 1.0;
    DMat3 h(0.0);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < positive_ && i < positive_; ++j) h[i][j] = -8.0 * p[i] * p[j];
      h[i][i] -= i < positive_ ? 4.0 * well : 2.0;
    }
    return h;
  }
  Box bounds() const override {
    const double b = positive_ == 0 ? c_ - 1.0 : c_;
    if (b < 0.0) return {};
    DVec3 half(std::sqrt(b));
    for (int i = 0; i < positive_; ++i) half[i] = std::sqrt(1.0 + std::sqrt(c_));
    return {-half, half};
  }
  Interval range(const Box& box) const override {
    Interval a, b;
    for (int i = 0; i < 3; ++i) {
      const double near = std::max({box.low[i], -box.high[i], 0.0});
      const double far = std::max(std::abs(box.low[i]), std::abs(box.high[i]));
      Interval& sum = i < positive_ ? a : b;
      sum.low += near * near;
      sum.high += far * far;
    }
    const double low = a.low - 1.0, high = a.high - 1.0;
    const double well_low = low <= 0.0 && high >= 0.0 ? 0.0 : std::min(low * low, high * high);
    const double well_high = std::max(low * low, high * high);
    const double slack = 1e-12 * (std::abs(c_) + well_high + b.high);
    return {c_ - well_high - b.high - slack, c_ - well_low - b.low + slack};
  }

private:
  double square(const DVec3& p) const {
    double sum = 0.0;
    for (int i = 0; i < positive_; ++i) sum += p[i] * p[i];
    return sum;
  }

  int positive_;
  double c_;
};

}  // namespace isoskin::analytic
