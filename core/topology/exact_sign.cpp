#include "core/topology/exact_sign.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <boost/multiprecision/cpp_int.hpp>

namespace isoskin {
namespace {

// Wide enough for three factors of differences of any floats of one scale; as long as its value needs.
using Integer = boost::multiprecision::number<boost::multiprecision::cpp_int_backend<
    1024, 1024, boost::multiprecision::signed_magnitude, boost::multiprecision::unchecked, void>>;

constexpr double kEpsilon = 0x1p-53;
constexpr double kBound2 = (3.0 + 16.0 * kEpsilon) * kEpsilon;  // of the sums of the terms' magnitudes
constexpr double kBound3 = (7.0 + 56.0 * kEpsilon) * kEpsilon;

constexpr int kMantissa = 24;  // bits of a float

/// A coordinate of some points as integers, in units of a power of two they share.
template <std::size_t n>
std::array<Integer, n> whole(const std::array<float, n>& x) {
  std::array<int, n> mantissa, exponent;
  int unit = std::numeric_limits<int>::max();
  for (std::size_t i = 0; i < n; ++i) {
    mantissa[i] = int(std::ldexp(std::frexp(x[i], &exponent[i]), kMantissa));
    if (mantissa[i] != 0) unit = std::min(unit, exponent[i]);
  }
  std::array<Integer, n> out;
  for (std::size_t i = 0; i < n; ++i)
    if (mantissa[i] != 0) out[i] = Integer(mantissa[i]) << (exponent[i] - unit);
  return out;
}

int exact(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  Integer m[3][3];
  for (int k = 0; k < 3; ++k) {
    const auto x = whole<4>({a[k], b[k], c[k], d[k]});
    for (int i = 0; i < 3; ++i) m[i][k] = x[i] - x[3];
  }
  const auto minor = [&](int i, int j) -> Integer { return m[i][0] * m[j][1] - m[j][0] * m[i][1]; };
  return Integer(minor(1, 2) * m[0][2] + minor(2, 0) * m[1][2] + minor(0, 1) * m[2][2]).sign();
}

int exact(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c) {
  const auto x = whole<3>({a.x, b.x, c.x}), y = whole<3>({a.y, b.y, c.y});
  return Integer((x[0] - x[2]) * (y[1] - y[2]) - (y[0] - y[2]) * (x[1] - x[2])).sign();
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
  return exact(a, b, c);
}

}  // namespace isoskin
