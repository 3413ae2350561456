#include "core/topology/exact_sign.h"

#include <cmath>

#include <boost/multiprecision/cpp_int.hpp>

namespace isoskin {
namespace {

using Rational = boost::multiprecision::cpp_rational;

constexpr double kEpsilon = 0x1p-53;
constexpr double kBound2 = (3.0 + 16.0 * kEpsilon) * kEpsilon;  // of the sums of the terms' magnitudes
constexpr double kBound3 = (7.0 + 56.0 * kEpsilon) * kEpsilon;

int sign(const Rational& x) {
  return x.sign();
}

Rational difference(float x, float y) {
  return Rational(x) - Rational(y);
}

int exact(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  Rational m[3][3];
  for (int k = 0; k < 3; ++k) {
    m[0][k] = difference(a[k], d[k]);
    m[1][k] = difference(b[k], d[k]);
    m[2][k] = difference(c[k], d[k]);
  }
  const auto minor = [&](int i, int j) -> Rational { return m[i][0] * m[j][1] - m[j][0] * m[i][1]; };
  return sign(minor(1, 2) * m[0][2] + minor(2, 0) * m[1][2] + minor(0, 1) * m[2][2]);
}

}  // namespace

int orientation(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const DVec3 p = DVec3(a) - DVec3(d), q = DVec3(b) - DVec3(d), r = DVec3(c) - DVec3(d);
  const double qr = q.x * r.y, rq = r.x * q.y, rp = r.x * p.y, pr = p.x * r.y, pq = p.x * q.y, qp = q.x * p.y;
  const double det = p.z * (qr - rq) + q.z * (rp - pr) + r.z * (pq - qp);
  const double size = (std::abs(qr) + std::abs(rq)) * std::abs(p.z) + (std::abs(rp) + std::abs(pr)) * std::abs(q.z) +
                      (std::abs(pq) + std::abs(qp)) * std::abs(r.z);
  if (std::abs(det) > kBound3 * size) return det > 0.0 ? 1 : -1;
  return size == 0.0 ? 0 : exact(a, b, c, d);
}

int orientation(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c) {
  const double left = (double(a.x) - double(c.x)) * (double(b.y) - double(c.y));
  const double right = (double(a.y) - double(c.y)) * (double(b.x) - double(c.x));
  const double size = std::abs(left) + std::abs(right);
  if (std::abs(left - right) > kBound2 * size) return left > right ? 1 : -1;
  if (size == 0.0) return 0;
  return sign(Rational(difference(a.x, c.x) * difference(b.y, c.y) - difference(a.y, c.y) * difference(b.x, c.x)));
}

}  // namespace isoskin
