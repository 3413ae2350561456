#include "core/field/skeleton_field.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <complex>
#include <functional>
#include <random>

#include "core/field/field_changes.h"

namespace isoskin {
namespace {

using Complex = std::complex<double>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// F written again from its definition, over complex numbers: an imaginary step of 1e-30 is the exact derivative.
Complex modulus(const Complex& x) {
  return x.real() < 0.0 ? -x : x;
}

Complex potential(const SkeletonElement& e, const Complex& d) {
  const double r = e.radius;
  const Complex q = d / r;
  switch (e.potential) {
    case Potential::inverse_square:
      return 1.0 / (q * q);
    case Potential::cauchy:
      return r / (1.0 + d * d);
    case Potential::metaball:
      return q.real() < 1.0 ? (1.0 - q * q) * (1.0 - q * q) * (1.0 - q * q) : 0.0;
    case Potential::blinn:
      return std::exp(-q * q);
    case Potential::wyvill: {
      const Complex c = q * q;
      return q.real() < 1.0 ? 1.0 - 4.0 / 9.0 * c * c * c + 17.0 / 9.0 * c * c - 22.0 / 9.0 * c : 0.0;
    }
  }
  return 0.0;
}

using Place = std::array<Complex, 3>;

Complex dot(const Place& a, const Place& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Place minus(const Place& a, const Complex& t, const DVec3& b) {
  return {a[0] - t * b.x, a[1] - t * b.y, a[2] - t * b.z};
}
Place plain(const DVec3& v) {
  return {v.x, v.y, v.z};
}

/// p minus the nearest point of the solid: the least over all its faces, edges and corners whose own nearest point lies
/// within them, from the normal equations of each.
Place solid_offset(const SkeletonElement& e, const Place& p) {
  const Place w = minus(p, 1.0, e.a);
  std::vector<std::array<DVec3, 3>> parts;  // corner and one or two edges, the second 0 where there is none
  std::vector<DVec3> corners;
  if (e.shape == Shape::triangle) {
    corners = {e.a, e.b, e.c};
    parts = {{e.a, e.b - e.a, e.c - e.a}, {e.a, e.b - e.a, {}}, {e.a, e.c - e.a, {}}, {e.b, e.c - e.b, {}}};
  } else {
    const std::array<DVec3, 3> edge{e.b - e.a, e.c - e.a, e.d - e.a};
    Complex inside[3];
    for (int i = 0; i < 3; ++i) inside[i] = dot(w, plain(edge[i])) / glm::dot(edge[i], edge[i]);
    if (std::all_of(inside, inside + 3, [](const Complex& t) { return t.real() > 0.0 && t.real() < 1.0; })) return {};
    for (int i = 0; i < 3; ++i)
      for (int far = 0; far < 4; ++far) {
        const DVec3 &u = edge[(i + 1) % 3], &v = edge[(i + 2) % 3];
        const DVec3 from = e.a + double(far % 2) * u + double(far / 2) * v;
        parts.push_back({from, edge[i], {}});
        corners.push_back(from);
        corners.push_back(from + edge[i]);
        if (far < 2) parts.push_back({e.a + double(far) * edge[i], u, v});
      }
  }
  Place best = minus(p, 1.0, corners[0]);
  const auto offer = [&](const Place& x) {
    if (dot(x, x).real() < dot(best, best).real()) best = x;
  };
  for (const DVec3& corner : corners) offer(minus(p, 1.0, corner));
  for (const auto& [from, u, v] : parts) {
    const Place x = minus(p, 1.0, from);
    const double uu = glm::dot(u, u), vv = glm::dot(v, v), uv = glm::dot(u, v), det = uu * vv - uv * uv;
    const Complex xu = dot(x, plain(u)), xv = dot(x, plain(v));
    const Complex s = vv > 0.0 ? (vv * xu - uv * xv) / det : xu / uu, t = vv > 0.0 ? (uu * xv - uv * xu) / det : 0.0;
    const double far_side = e.shape == Shape::triangle ? s.real() + t.real() : std::max(s.real(), t.real());
    if (s.real() >= 0.0 && t.real() >= 0.0 && far_side <= 1.0) offer(minus(minus(x, s, u), t, v));
  }
  return best;
}

Complex oracle(const std::vector<SkeletonElement>& elements, double iso, const std::array<Complex, 3>& p) {
  Complex sum = -iso;
  for (const SkeletonElement& e : elements) {
    Complex along = 0.0;
    double length2 = 0.0;
    for (int i = 0; i < 3; ++i) {
      along += (p[i] - e.a[i]) * (e.b[i] - e.a[i]);
      length2 += (e.b[i] - e.a[i]) * (e.b[i] - e.a[i]);
    }
    Complex t = length2 > 0.0 ? along / length2 : 0.0;
    if (t.real() <= 0.0) t = 0.0;
    if (t.real() >= 1.0) t = 1.0;
    const Place x = e.shape == Shape::segment ? minus(minus(p, 1.0, e.a), t, e.b - e.a) : solid_offset(e, p);
    Complex power = 0.0;
    for (int i = 0; i < 3; ++i)
      if (x[i] != 0.0) power += std::pow(modulus(x[i]), e.norm);
    sum += e.weight * potential(e, power == 0.0 ? 0.0 : std::pow(power, 1.0 / e.norm));
  }
  return sum;
}

DVec3 oracle_gradient(const SkeletonField& field, const DVec3& p) {
  DVec3 g(0.0);
  for (int i = 0; i < 3; ++i) {
    std::array<Complex, 3> x{p.x, p.y, p.z};
    x[i] += Complex(0.0, 1e-30);
    g[i] = oracle(field.elements(), field.iso(), x).imag() / 1e-30;
  }
  return g;
}

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
  DVec3 vector(double size) { return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)}; }
  int pick(int n) { return static_cast<int>(engine() % static_cast<unsigned>(n)); }
};

SkeletonElement random_element(Random& random) {
  constexpr double kNorms[] = {2.0, 2.0, 10.0, 4.0, 3.0, 1.0, 0.6};
  SkeletonElement e;
  e.a = random.vector(1.0);
  e.b = random.pick(2) ? e.a : random.vector(1.0);
  e.radius = random(0.3, 1.5);
  e.weight = random.pick(3) ? random(0.2, 1.5) : random(-1.0, 0.0);
  e.norm = kNorms[random.pick(7)];
  e.potential = static_cast<Potential>(random.pick(5));
  if (random.pick(2)) return e;
  e.shape = random.pick(2) ? Shape::triangle : Shape::box;
  e.b = random.vector(1.0);
  e.c = random.vector(1.0);
  if (e.shape == Shape::box) {
    const DVec3 u = e.b - e.a, v = glm::normalize(glm::cross(u, e.c - e.a));
    e.c = e.a + random(0.1, 1.0) * v;
    e.d = e.a + random(0.1, 1.0) * glm::normalize(glm::cross(u, v));
  }
  return e;
}

SkeletonField random_field(Random& random) {
  std::vector<SkeletonElement> elements;
  for (int n = 1 + random.pick(6); n > 0; --n) elements.push_back(random_element(random));
  return SkeletonField(elements, random(0.05, 0.8));
}

// The nearest point lies on another face, edge or corner a step away, or a coordinate or the potential's end is near.
bool near_kink_of_solid(const SkeletonElement& e, const DVec3& p, double step) {
  const ElementOffset here = offset_from(e, p);
  for (int side = 0; side < 27; ++side) {
    const DVec3 there(side % 3 - 1, side / 3 % 3 - 1, side / 9 - 1);
    const ElementOffset offset = offset_from(e, p + 4.0 * step * there);
    if (offset.slides != here.slides || glm::distance(offset.slide[0], here.slide[0]) > 1e-6) return true;
  }
  if (here.slides == 3) return e.potential == Potential::inverse_square;  // held constant there
  double power = 0.0;
  for (int i = 0; i < 3; ++i) {
    if (e.norm != 2.0 && std::abs(here.x[i]) < step) return true;
    power += std::pow(std::abs(here.x[i]), e.norm);
  }
  return glm::length(here.x) < 0.05 || std::abs(std::pow(power, 1.0 / e.norm) - e.radius) < 10.0 * step;
}

// True where a finite difference over `step` would straddle a kink or a jump of second derivatives of some element.
bool near_kink(const SkeletonField& field, const DVec3& p, double step) {
  for (const SkeletonElement& e : field.elements()) {
    if (e.shape != Shape::segment && near_kink_of_solid(e, p, step)) return true;
    if (e.shape != Shape::segment) continue;
    const DVec3 ab = e.b - e.a;
    const double length2 = glm::dot(ab, ab);
    const double t = length2 > 0.0 ? glm::dot(p - e.a, ab) / length2 : 0.0;
    if (length2 > 0.0 && (std::abs(t) * std::sqrt(length2) < step || std::abs(t - 1.0) * std::sqrt(length2) < step)) {
      return true;
    }
    const DVec3 x = p - e.a - glm::clamp(t, 0.0, 1.0) * ab;
    if (glm::length(x) < 0.05) return true;
    for (int i = 0; i < 3; ++i) {
      if (e.norm != 2.0 && std::abs(x[i]) < step) return true;
    }
    double power = 0.0;
    for (int i = 0; i < 3; ++i) power += std::pow(std::abs(x[i]), e.norm);
    if (std::abs(std::pow(power, 1.0 / e.norm) - e.radius) < 10.0 * step) return true;
  }
  return false;
}

TEST(SkeletonField, ValueAndGradientMatchComplexStepOracle) {
  EXPECT_TRUE(rc::check([](std::uint64_t seed) {
    Random random{std::mt19937_64(seed)};
    const SkeletonField field = random_field(random);
    for (int k = 0; k < 20; ++k) {
      const DVec3 p = random.vector(2.0);
      if (near_kink(field, p, 1e-4)) continue;
      const FieldSample s = field.sample(p);
      const double expected = oracle(field.elements(), field.iso(), {p.x, p.y, p.z}).real();
      const DVec3 gradient = oracle_gradient(field, p);
      RC_ASSERT(std::abs(s.value - expected) <= 1e-11 * (1.0 + std::abs(expected)));
      RC_ASSERT(s.value == field.value(p));
      RC_ASSERT(glm::length(s.gradient - gradient) <= 1e-9 * (1.0 + glm::length(gradient)));
    }
  }));
}

// Points of the solid, and none other: the distance is never more than to the nearest of many, nor less by more than
// they are apart.
TEST(SkeletonField, DistanceToSolidsMatchesBruteForce) {
  Random random{std::mt19937_64(3)};
  for (const Shape shape : {Shape::triangle, Shape::box}) {
    SkeletonElement e;
    e.shape = shape;
    e.a = DVec3(0.2, -0.1, 0.3);
    const DVec3 u(0.48, 0.6, 0.64), v(0.8, 0.0, -0.6), w(-0.36, 0.8, -0.48);  // orthonormal
    e.b = e.a + 0.9 * u;
    e.c = e.a + 0.6 * v + (shape == Shape::triangle ? 0.5 : 0.0) * u;
    e.d = e.a + 0.4 * w;
    constexpr int kParts = 24;
    for (int k = 0; k < 200; ++k) {
      const DVec3 p = e.a + random.vector(1.5);
      double nearest = 1e9;
      for (int i = 0; i <= kParts; ++i)
        for (int j = 0; j <= kParts; ++j)
          for (int l = 0; l <= (shape == Shape::box ? kParts : 0); ++l) {
            if (shape == Shape::triangle && i + j > kParts) continue;
            const DVec3 q =
                e.a + (double(i) * (e.b - e.a) + double(j) * (e.c - e.a) + double(l) * (e.d - e.a)) / double(kParts);
            nearest = std::min(nearest, glm::distance(p, q));
          }
      const double distance = glm::length(offset_from(e, p).x);
      EXPECT_LE(distance, nearest + 1e-12);
      EXPECT_GE(distance, nearest - 1.2 / kParts);
      const Interval alone = euclidean_distance(e, Box{p, p}.grown(0.05));
      EXPECT_TRUE(alone.contains(distance));
      EXPECT_GE(alone.low, distance - 0.05 * std::sqrt(3.0) - 1e-9);
      EXPECT_LE(alone.high, distance + 0.05 * std::sqrt(3.0) + 1e-9);
    }
    EXPECT_EQ(corners_of(e).count, shape == Shape::box ? 8 : 3);
    EXPECT_LT(glm::length(offset_from(e, center(e)).x), 1e-15);
  }
}

TEST(SkeletonField, HessianMatchesDifferencesOfOracleGradient) {
  EXPECT_TRUE(rc::check([](std::uint64_t seed) {
    Random random{std::mt19937_64(seed)};
    const SkeletonField field = random_field(random);
    constexpr double kStep = 1e-5;
    for (int k = 0; k < 10; ++k) {
      const DVec3 p = random.vector(1.5);
      if (near_kink(field, p, 1e-2)) continue;
      const DMat3 h = field.hessian(p);
      double size = 1.0;
      for (int i = 0; i < 3; ++i) size = std::max(size, glm::length(h[i]));
      for (int i = 0; i < 3; ++i) {
        DVec3 step(0.0);
        step[i] = kStep;
        const DVec3 expected = (oracle_gradient(field, p + step) - oracle_gradient(field, p - step)) / (2.0 * kStep);
        RC_ASSERT(glm::length(h[i] - expected) <= 2e-4 * size);
      }
    }
  }));
}

TEST(SkeletonField, HessianOfSmoothPotentialsIsAccurate) {
  for (const Potential potential :
       {Potential::inverse_square, Potential::cauchy, Potential::metaball, Potential::blinn, Potential::wyvill}) {
    const SkeletonField field({{DVec3(0.1), DVec3(0.1), 1.3, 0.7, 2.0, potential}}, 0.2);
    const DVec3 p(0.5, -0.3, 0.6);
    const DMat3 h = field.hessian(p);
    for (int i = 0; i < 3; ++i) {
      DVec3 step(0.0);
      step[i] = 1e-6;
      const DVec3 expected = (oracle_gradient(field, p + step) - oracle_gradient(field, p - step)) / 2e-6;
      EXPECT_NEAR(glm::length(h[i] - expected), 0.0, 1e-7);
    }
  }
}

TEST(SkeletonField, RangeContainsSampledValues) {
  EXPECT_TRUE(rc::check([](std::uint64_t seed) {
    Random random{std::mt19937_64(seed)};
    const SkeletonField field = random_field(random);
    const double size = std::pow(10.0, random(-6.0, 1.0));
    Box box;
    const DVec3 corner = random.vector(2.0);
    box.add(corner);
    box.add(corner + size * DVec3(random(0.0, 1.0), random(0.0, 1.0), random(0.0, 1.0)));
    const Interval range = field.range(box);
    for (int k = 0; k < 60; ++k) {
      DVec3 p;
      for (int i = 0; i < 3; ++i) {
        const int where = random.pick(4);
        p[i] = where == 0 ? box.low[i] : where == 1 ? box.high[i] : random(box.low[i], box.high[i]);
      }
      RC_ASSERT(range.contains(field.value(p)));
    }
  }));
}

TEST(SkeletonField, RangeTightensWithTheBox) {
  EXPECT_TRUE(rc::check([](std::uint64_t seed) {
    Random random{std::mt19937_64(seed)};
    const SkeletonField field = random_field(random);
    const DVec3 p = random.vector(1.5);
    if (near_kink(field, p, 1e-3)) return;
    const double slope = glm::length(field.sample(p).gradient);
    const Interval range = field.range(Box{p, p}.grown(1e-7));
    // Terms of opposite sign do not cancel in an interval sum: allow the sum of their slopes.
    double slopes = slope;
    for (const SkeletonElement& e : field.elements()) {
      slopes += glm::length(SkeletonField({e}, 0.0).sample(p).gradient);
    }
    RC_ASSERT(range.high - range.low <= 1e-6 * slopes * 3.0 + 1e-10);
  }));
}

TEST(SkeletonField, BoundsContainEverySignChange) {
  EXPECT_TRUE(rc::check([](std::uint64_t seed) {
    Random random{std::mt19937_64(seed)};
    std::vector<SkeletonElement> elements;
    for (int n = 1 + random.pick(4); n > 0; --n) {
      elements.push_back(random_element(random));
      elements.back().weight = std::abs(elements.back().weight);
    }
    const SkeletonField field(elements, random(0.2, 0.8));
    const Box box = field.bounds();
    // March along random lines far across: where the sign changes, the point lies in the box.
    for (int k = 0; k < 10; ++k) {
      const DVec3 from = random.vector(12.0), to = random.vector(1.0);
      DVec3 last = from;
      for (int i = 1; i <= 400; ++i) {
        const DVec3 p = from + (i / 200.0) * (to - from);
        if ((field.value(p) > 0.0) != (field.value(last) > 0.0)) {
          RC_ASSERT(!box.empty());
          const double slack = glm::length(p - last);
          for (int axis = 0; axis < 3; ++axis) {
            RC_ASSERT(p[axis] >= box.low[axis] - slack);
            RC_ASSERT(p[axis] <= box.high[axis] + slack);
          }
        }
        last = p;
      }
    }
  }));
}

TEST(SkeletonField, BoundsOfOneBallAreTight) {
  // R^2/d^2 = 0.01 at d = 10 R, far beyond the radius.
  const SkeletonField far_reaching({{DVec3(1.0), DVec3(1.0), 1.0, 1.0, 2.0, Potential::inverse_square}}, 0.01);
  const Box box = far_reaching.bounds();
  for (int i = 0; i < 3; ++i) {
    EXPECT_LE(box.low[i], -9.0);
    EXPECT_GE(box.low[i], -9.4);
    EXPECT_GE(box.high[i], 11.0);
    EXPECT_LE(box.high[i], 11.4);
  }
  const SkeletonField small({{DVec3(0.0), DVec3(0.0), 1.0, 1.0, 2.0, Potential::metaball}}, 0.5);
  const double radius = std::sqrt(1.0 - std::cbrt(0.5));
  EXPECT_GE(small.bounds().high.x, radius);
  EXPECT_LE(small.bounds().high.x, radius + 0.05);
}

TEST(SkeletonField, NoSurfaceMeansEmptyBounds) {
  EXPECT_TRUE(SkeletonField({}, 0.3).bounds().empty());
  EXPECT_TRUE(SkeletonField({{DVec3(0.0), DVec3(0.0), 1.0, 0.2, 2.0, Potential::metaball}}, 0.3).bounds().empty());
  EXPECT_TRUE(SkeletonField({{DVec3(0.0), DVec3(0.0), 1.0, 1.0, 2.0, Potential::cauchy}}, -0.3).bounds().empty());
}

TEST(SkeletonField, FiniteEverywhere) {
  for (int kind = 0; kind < 5; ++kind) {
    for (const double norm : {0.1, 0.6, 1.0, 2.0, 3.0, 10.0}) {
      for (const DVec3& b : {DVec3(0.0), DVec3(1.0, 2.0, 0.0)}) {
        const Shape shape = static_cast<Shape>(kind % 3);
        const SkeletonField field({{DVec3(0.0), b, 1.0, -2.0, norm, static_cast<Potential>(kind), shape}}, 0.1);
        for (const DVec3& p :
             {DVec3(0.0), DVec3(1e-300, 0.0, 0.0), DVec3(1e-9, 0.3, 0.0), DVec3(1e-7), DVec3(0.0, 0.5, 1e-320),
              DVec3(1e150), DVec3(-1e300, 1.0, 0.0), DVec3(1.0, 0.0, 0.0), DVec3(0.5, 1.0, 0.0)}) {
          const FieldSample s = field.sample(p);
          const DMat3 h = field.hessian(p);
          EXPECT_TRUE(std::isfinite(s.value)) << kind << ' ' << norm;
          for (int i = 0; i < 3; ++i) {
            EXPECT_TRUE(std::isfinite(s.gradient[i])) << kind << ' ' << norm << ' ' << p.x;
            for (int j = 0; j < 3; ++j) EXPECT_TRUE(std::isfinite(h[i][j])) << kind << ' ' << norm << ' ' << p.x;
          }
        }
      }
    }
  }
}

TEST(SkeletonField, ContinuityOfSecondDerivativesIsReported) {
  const auto is_c2 = [](const SkeletonElement& e) { return SkeletonField({e}, 0.1).is_c2(); };
  const DVec3 o(0.0), x(1.0, 0.0, 0.0);
  EXPECT_TRUE(is_c2({o, o, 1.0, 1.0, 2.0, Potential::metaball}));
  EXPECT_TRUE(is_c2({o, o, 1.0, 1.0, 4.0, Potential::inverse_square}));
  EXPECT_FALSE(is_c2({o, o, 1.0, 1.0, 2.0, Potential::wyvill}));
  EXPECT_FALSE(is_c2({o, x, 1.0, 1.0, 2.0, Potential::metaball}));
  EXPECT_FALSE(is_c2({o, o, 1.0, 1.0, 2.0, Potential::metaball, Shape::triangle, x}));
  EXPECT_FALSE(is_c2({o, o, 1.0, 1.0, 1.0, Potential::inverse_square}));
  EXPECT_FALSE(is_c2({o, o, 1.0, 1.0, 4.0, Potential::blinn}));
}

TEST(SkeletonField, ChangesOfAnyCornerAreSeen) {
  SkeletonElement box;
  box.shape = Shape::box;
  box.b = DVec3(1.0, 0.0, 0.0);
  box.c = DVec3(0.0, 1.0, 0.0);
  box.d = DVec3(0.0, 0.0, 1.0);
  const SkeletonField before({{}, box}, 0.2);
  EXPECT_TRUE(changes_between(before, SkeletonField({{}, box}, 0.2)).box.empty());
  for (DVec3 SkeletonElement::*corner : {&SkeletonElement::b, &SkeletonElement::c, &SkeletonElement::d}) {
    SkeletonElement longer = box;
    longer.*corner *= 2.0;
    EXPECT_EQ(changes_between(before, SkeletonField({{}, longer}, 0.2)).box.size(), 2u);
  }
  SkeletonElement triangle = box;
  triangle.shape = Shape::triangle;
  EXPECT_EQ(changes_between(before, SkeletonField({{}, triangle}, 0.2)).box.size(), 2u);
}

TEST(SkeletonField, RejectsBadElements) {
  const SkeletonElement good;
  for (const auto& [change, word] : std::vector<std::pair<std::function<void(SkeletonElement&)>, std::string>>{
           {[](SkeletonElement& e) { e.radius = 0.0; }, "radius"},
           {[](SkeletonElement& e) { e.radius = -1.0; }, "radius"},
           {[](SkeletonElement& e) { e.radius = kNan; }, "radius"},
           {[](SkeletonElement& e) { e.norm = 0.0; }, "norm"},
           {[](SkeletonElement& e) { e.norm = std::numeric_limits<double>::infinity(); }, "norm"},
           {[](SkeletonElement& e) { e.weight = kNan; }, "weight"},
           {[](SkeletonElement& e) { e.b.y = kNan; }, "position"},
           {[](SkeletonElement& e) { e.shape = Shape::triangle, e.c.z = kNan; }, "position"},
           {[](SkeletonElement& e) { e.shape = Shape::box, e.b.x = 1.0, e.c = DVec3(1.0, 1.0, 0.0); }, "edges"}}) {
    SkeletonElement bad = good;
    change(bad);
    try {
      SkeletonField({good, bad}, 0.1);
      FAIL() << word;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("element 1: " + word), std::string::npos) << error.what();
    }
  }
  EXPECT_THROW(SkeletonField({good}, kNan), InputError);
}

}  // namespace
}  // namespace isoskin
