#include "core/mechanics/element.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "tests/random_rotation.h"

using namespace isoskin;

namespace {

using Real = long double;
using Flat = std::array<Real, 9>;

Flat flat(const Corners& p) {
  return {p[0].x, p[0].y, p[0].z, p[1].x, p[1].y, p[1].z, p[2].x, p[2].y, p[2].z};
}

Corners random_triangle(std::mt19937& rng, double size) {
  std::normal_distribution<double> g(0.0, size);
  Corners p;
  for (DVec3& c : p) c = {g(rng), g(rng), g(rng)};
  return p;
}

Corners moved(const Corners& p, const DMat3& q, const DVec3& t) {
  return {q * p[0] + t, q * p[1] + t, q * p[2] + t};
}

Corners rest_triangle(double e) {
  return {DVec3(0.0), DVec3(e, 0, 0), DVec3(0.5 * e, 0.5 * kSqrt3 * e, 0)};
}

Real dot3(const Real* a, const Real* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Elastic energy from edge lengths and signed area alone: with C = G^T G and J = det G the stretch S of the polar
// decomposition has tr S = sqrt(tr C + 2 J), and W = A0 (mu |S - I|^2 + lambda / 2 tr(S - I)^2), lambda of plane
// stress.
Real energy(const Flat& x, bool inverted, const ElementMaterial& m) {
  Real d1[3], d2[3];
  for (int k = 0; k < 3; ++k) {
    d1[k] = x[3 + k] - x[k];
    d2[k] = x[6 + k] - x[k];
  }
  const Real e = m.edge_length, root3 = std::sqrt(Real(3));
  Real c0[3], c1[3];
  for (int k = 0; k < 3; ++k) {
    c0[k] = d1[k] / e;
    c1[k] = (2 * d2[k] - d1[k]) / (root3 * e);
  }
  const Real i1 = dot3(c0, c0) + dot3(c1, c1);
  const Real gram = dot3(c0, c0) * dot3(c1, c1) - dot3(c0, c1) * dot3(c0, c1);
  const Real j = (inverted ? -1 : 1) * std::sqrt(std::max(gram, Real(0)));
  const Real trace = std::sqrt(std::max(i1 + 2 * j, Real(0)));
  const Real mu = m.young / (2 * (1 + Real(m.poisson)));
  const Real lambda = m.young * Real(m.poisson) / (1 - Real(m.poisson) * m.poisson);
  const Real area = root3 / 4 * e * e;
  return area * (mu * (i1 - 2 * trace + 2) + lambda / 2 * (trace - 2) * (trace - 2));
}

Real spring_energy(const Flat& x, const ElementMaterial& m) {
  Real sum = 0;
  for (int k = 0; k < 3; ++k) {
    Real d[3];
    for (int axis = 0; axis < 3; ++axis) d[axis] = x[3 * ((k + 1) % 3) + axis] - x[3 * k + axis];
    const Real stretch = std::sqrt(dot3(d, d)) - m.edge_length;
    sum += Real(0.25) * m.spring * stretch * stretch;  // half of k, times a half
  }
  return sum;
}

template <class Energy>
std::array<double, 9> minus_gradient(const Corners& p, const Energy& w, Real step) {
  std::array<double, 9> f;
  for (int k = 0; k < 9; ++k) {
    Flat low = flat(p), high = flat(p);
    low[k] -= step;
    high[k] += step;
    f[k] = double(-(w(high) - w(low)) / (2 * step));
  }
  return f;
}

using Dense9 = std::array<std::array<double, 9>, 9>;

template <class Product>
Dense9 dense(const Product& times) {
  Dense9 k{};
  for (int column = 0; column < 9; ++column) {
    Corners unit{DVec3(0.0), DVec3(0.0), DVec3(0.0)};
    unit[column / 3][column % 3] = 1.0;
    const Corners product = times(unit);
    for (int row = 0; row < 9; ++row) k[row][column] = product[row / 3][row % 3];
  }
  return k;
}

// Cholesky of k + shift I succeeds exactly when no eigenvalue lies below -shift.
bool no_eigenvalue_below(Dense9 k, double shift) {
  for (int i = 0; i < 9; ++i) k[i][i] += shift;
  for (int i = 0; i < 9; ++i) {
    for (int j = 0; j < i; ++j) k[i][i] -= k[i][j] * k[i][j];
    if (!(k[i][i] > 0.0)) return false;
    k[i][i] = std::sqrt(k[i][i]);
    for (int r = i + 1; r < 9; ++r) {
      for (int j = 0; j < i; ++j) k[r][i] -= k[r][j] * k[i][j];
      k[r][i] /= k[i][i];
    }
  }
  return true;
}

// The textbook constant strain triangle, A0 B^T C B with engineering shear, for corners `p` of the rest triangle in 2D.
std::array<std::array<double, 6>, 6> textbook_stiffness(const ElementMaterial& m) {
  const Corners p = rest_triangle(m.edge_length);
  const double area = 0.25 * kSqrt3 * m.edge_length * m.edge_length;
  double b[3][6] = {};
  for (int i = 0; i < 3; ++i) {
    const DVec3 &next = p[(i + 1) % 3], &prev = p[(i + 2) % 3];
    const double dx = (next.y - prev.y) / (2 * area), dy = (prev.x - next.x) / (2 * area);
    b[0][2 * i] = dx;
    b[1][2 * i + 1] = dy;
    b[2][2 * i] = dy;
    b[2][2 * i + 1] = dx;
  }
  const double s = m.young / (1 - m.poisson * m.poisson);
  const double c[3][3] = {{s, s * m.poisson, 0}, {s * m.poisson, s, 0}, {0, 0, s * (1 - m.poisson) / 2}};
  std::array<std::array<double, 6>, 6> k{};
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      for (int r = 0; r < 3; ++r)
        for (int q = 0; q < 3; ++q) k[i][j] += area * b[r][i] * c[r][q] * b[q][j];
  return k;
}

// Rotation of the polar decomposition of the 2x2 matrix [[a, b], [c, d]], det > 0, by Higham's iteration.
std::array<double, 4> polar_rotation(double a, double b, double c, double d) {
  for (int i = 0; i < 60; ++i) {
    const double det = a * d - b * c;
    const double na = 0.5 * (a + d / det), nb = 0.5 * (b - c / det), nc = 0.5 * (c - b / det), nd = 0.5 * (d + a / det);
    a = na, b = nb, c = nc, d = nd;
  }
  return {a, b, c, d};
}

const ElementMaterial kMaterial{0.7, 1000.0, 0.3, 100.0};

DVec3 own_normal(const Corners& p) {
  return glm::cross(p[1] - p[0], p[2] - p[0]);
}

}  // namespace

TEST(Element, RestShapeAnywhereHasNoForce) {
  std::mt19937 rng(1);
  for (int i = 0; i < 100; ++i) {
    const Corners p = moved(rest_triangle(0.7), test::random_rotation(rng), DVec3(3, -2, i));
    const Corners f = element_forces(element_frame(p, false, own_normal(p)), p, kMaterial);
    for (const DVec3& force : f) EXPECT_LT(glm::length(force), 1e-9);
    for (const DVec3& force : spring_forces(p, kMaterial)) EXPECT_LT(glm::length(force), 1e-9);
  }
}

TEST(Element, ForcesAreMinusTheGradientOfTheEnergyInvertedOrNot) {
  std::mt19937 rng(2);
  for (int i = 0; i < 400; ++i) {
    const bool inverted = i % 2 == 1;
    const Corners p = random_triangle(rng, 0.6);
    const DVec3 outward = (inverted ? -1.0 : 1.0) * own_normal(p);
    const auto w = [&](const Flat& x) { return energy(x, inverted, kMaterial); };
    const std::array<double, 9> oracle = minus_gradient(p, w, Real(1e-6));
    const Corners f = element_forces(element_frame(p, inverted, outward), p, kMaterial);
    for (int k = 0; k < 9; ++k) EXPECT_NEAR(f[k / 3][k % 3], oracle[k], 2e-4) << "triangle " << i << " entry " << k;
  }
}

TEST(Element, FrozenStiffnessIsTheTextbookMatrixTurnedByThePolarRotation) {
  std::mt19937 rng(3);
  const auto k2 = textbook_stiffness(kMaterial);
  for (int i = 0; i < 100; ++i) {
    const Corners p = random_triangle(rng, 0.6);
    const DVec3 normal = glm::normalize(own_normal(p));
    const DVec3 first = glm::normalize(p[1] - p[0]), second = glm::cross(normal, first);  // not the frame under test
    const DVec3 d1 = p[1] - p[0], d2 = p[2] - p[0];
    const double e = kMaterial.edge_length;
    const auto column1 = [&](const DVec3& axis) { return glm::dot(axis, 2.0 * d2 - d1) / (kSqrt3 * e); };
    const auto r = polar_rotation(glm::dot(first, d1) / e, column1(first), glm::dot(second, d1) / e, column1(second));
    const DVec3 axis[2] = {r[0] * first + r[2] * second, r[1] * first + r[3] * second};
    const ElementFrame frame = element_frame(p, false, normal);
    const Dense9 k = dense([&](const Corners& d) { return element_stiffness_times(frame, d, kMaterial); });
    for (int row = 0; row < 9; ++row) {
      for (int column = 0; column < 9; ++column) {
        double oracle = 0.0;
        for (int a = 0; a < 2; ++a)
          for (int b = 0; b < 2; ++b)
            oracle += axis[a][row % 3] * k2[2 * (row / 3) + a][2 * (column / 3) + b] * axis[b][column % 3];
        EXPECT_NEAR(k[row][column], oracle, 1e-8);
        EXPECT_NEAR(k[row][column], k[column][row], 1e-9);
      }
    }
  }
}

TEST(Element, StiffnessIsPositiveSemiDefiniteAndTheChangeOfForceInAFrozenFrame) {
  std::mt19937 rng(4);
  for (int i = 0; i < 100; ++i) {
    const Corners p = random_triangle(rng, 0.6), d = random_triangle(rng, 0.1);
    const ElementFrame frame = element_frame(p, i % 2 == 1, own_normal(p));
    const Dense9 k = dense([&](const Corners& x) { return element_stiffness_times(frame, x, kMaterial); });
    EXPECT_TRUE(no_eigenvalue_below(k, 1e-6));
    const Corners before = element_forces(frame, p, kMaterial);
    const Corners after = element_forces(frame, {p[0] + d[0], p[1] + d[1], p[2] + d[2]}, kMaterial);
    const Corners product = element_stiffness_times(frame, d, kMaterial);
    for (int c = 0; c < 3; ++c) EXPECT_LT(glm::length(after[c] - before[c] + product[c]), 1e-9);
  }
}

TEST(Element, StiffnessDoesNotDependOnTheEdgeLength) {
  std::mt19937 rng(5);
  const Corners p = random_triangle(rng, 0.6), d = random_triangle(rng, 0.1);
  ElementMaterial small = kMaterial;
  small.edge_length = 1e-3;
  const ElementFrame frame = element_frame(p, false, own_normal(p));
  const Corners a = element_stiffness_times(frame, d, kMaterial), b = element_stiffness_times(frame, d, small);
  for (int c = 0; c < 3; ++c) EXPECT_LT(glm::length(a[c] - b[c]), 1e-9);
}

TEST(Element, TurnsWithTheTriangleAndDoesNotCareWhichCornerIsFirst) {
  std::mt19937 rng(6);
  for (int i = 0; i < 100; ++i) {
    const bool inverted = i % 2 == 1;
    const Corners p = random_triangle(rng, 0.6);
    const DMat3 q = test::random_rotation(rng);
    const Corners turned = moved(p, q, DVec3(1, 2, 3));
    const DVec3 outward = (inverted ? -1.0 : 1.0) * own_normal(p);
    const Corners f = element_forces(element_frame(p, inverted, outward), p, kMaterial);
    const Corners g = element_forces(element_frame(turned, inverted, q * outward), turned, kMaterial);
    const Corners cycled{p[1], p[2], p[0]};
    const Corners h = element_forces(element_frame(cycled, inverted, outward), cycled, kMaterial);
    for (int c = 0; c < 3; ++c) {
      EXPECT_LT(glm::length(g[c] - q * f[c]), 1e-8);
      EXPECT_LT(glm::length(h[c] - f[(c + 1) % 3]), 1e-8);
    }
  }
}

TEST(Element, InvertedTriangleIsPushedBackThroughItself) {
  std::mt19937 rng(7);
  std::normal_distribution<double> noise(0.0, 0.2);
  for (int i = 0; i < 50; ++i) {
    Corners p = rest_triangle(0.7);
    for (DVec3& c : p) c = {c.x + (i ? noise(rng) : 0.0), -c.y + (i ? noise(rng) : 0.0), 0.0};  // i == 0: equilateral
    const DVec3 outward(0, 0, 1);
    const double before = own_normal(p).z;
    for (int step = 0; step < 4000; ++step) {  // gradient descent
      const bool inverted = own_normal(p).z < 0.0;
      const Corners f = element_forces(element_frame(p, inverted, outward), p, kMaterial);
      for (int c = 0; c < 3; ++c) p[c] += 2e-4 * f[c];
    }
    EXPECT_GT(own_normal(p).z, 0.0) << "started with twice the area " << before;
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(glm::length(p[(k + 1) % 3] - p[k]), 0.7, 1e-3);
  }
}

TEST(Element, SmallestHeightOfAnInvertedTriangleGrowsTowardTheOtherSide) {
  const Corners p{DVec3(0.0), DVec3(0.7, 0, 0), DVec3(0.3, -0.1, 0)};
  const Corners f = element_forces(element_frame(p, true, DVec3(0, 0, 1)), p, kMaterial);
  EXPECT_GT(f[2].y, 0.0);
  const Corners as_if_fine = element_forces(element_frame(p, false, DVec3(0, 0, -1)), p, kMaterial);
  EXPECT_LT(as_if_fine[2].y, 0.0);  // without the flip it would settle inside out
}

TEST(Element, FlatAndCollapsedTrianglesStayFinite) {
  const Corners line{DVec3(0.0), DVec3(1, 1, 0), DVec3(0.25, 0.25, 0)};
  for (const DVec3& outward : {DVec3(0, 0, 2), DVec3(0.0), DVec3(1, 1, 0)}) {
    const ElementFrame frame = element_frame(line, false, outward);
    EXPECT_NEAR(glm::length(frame.x), 1.0, 1e-12);
    EXPECT_NEAR(glm::length(frame.y), 1.0, 1e-12);
    EXPECT_NEAR(glm::dot(frame.x, frame.y), 0.0, 1e-12);
    EXPECT_NEAR(glm::dot(glm::cross(frame.x, frame.y), DVec3(1, 1, 0)), 0.0, 1e-12);
    const Corners f = element_forces(frame, line, kMaterial);
    EXPECT_GT(glm::length(f[2]), 0.0);  // it wants its height back
    EXPECT_LT(glm::length(f[0] + f[1] + f[2]), 1e-9);
  }
  const ElementFrame upright = element_frame(line, false, DVec3(0, 0, 2));
  EXPECT_GT(glm::cross(upright.x, upright.y).z, 0.99);

  const Corners point{DVec3(1.0), DVec3(1.0), DVec3(1.0)};
  const ElementFrame none = element_frame(point, false, DVec3(0, 0, 1));
  for (const DVec3& force : element_forces(none, point, kMaterial)) EXPECT_EQ(force, DVec3(0.0));
  for (const DVec3& k : element_stiffness_times(none, line, kMaterial)) EXPECT_EQ(k, DVec3(0.0));
  for (const DVec3& force : spring_forces(point, kMaterial)) EXPECT_EQ(force, DVec3(0.0));
}

TEST(Springs, ForcesAreMinusTheGradientOfTheirEnergy) {
  std::mt19937 rng(8);
  for (int i = 0; i < 200; ++i) {
    const Corners p = random_triangle(rng, 0.6);
    const auto w = [&](const Flat& x) { return spring_energy(x, kMaterial); };
    const std::array<double, 9> oracle = minus_gradient(p, w, Real(1e-6));
    const Corners f = spring_forces(p, kMaterial);
    for (int k = 0; k < 9; ++k) EXPECT_NEAR(f[k / 3][k % 3], oracle[k], 1e-5);
  }
}

TEST(Springs, StiffnessIsTheHessianWhileStretchedAndStaysPositiveWhileCompressed) {
  std::mt19937 rng(9);
  int stretched = 0;
  for (int i = 0; i < 200; ++i) {
    const Corners p = random_triangle(rng, 0.9);
    const Dense9 k = dense([&](const Corners& d) { return spring_stiffness_times(p, d, kMaterial); });
    EXPECT_TRUE(no_eigenvalue_below(k, 1e-6));
    bool all_longer = true;
    for (int c = 0; c < 3; ++c) all_longer = all_longer && glm::length(p[(c + 1) % 3] - p[c]) > kMaterial.edge_length;
    if (!all_longer) continue;
    ++stretched;
    for (int column = 0; column < 9; ++column) {
      Corners low = p, high = p;
      low[column / 3][column % 3] -= 1e-6;
      high[column / 3][column % 3] += 1e-6;
      const Corners f = spring_forces(low, kMaterial), g = spring_forces(high, kMaterial);
      for (int row = 0; row < 9; ++row) {
        EXPECT_NEAR(k[row][column], (f[row / 3][row % 3] - g[row / 3][row % 3]) / 2e-6, 1e-4);
      }
    }
  }
  EXPECT_GT(stretched, 20);
}
