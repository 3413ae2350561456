#include "core/topology/critical_points.h"

#include <cfenv>
#include <cmath>
#include <random>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/field/skeleton_field.h"
#include "core/topology/critical_interval.h"
#include "tests/random_rotation.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

DMat3 random_symmetric(std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-3.0, 3.0);
  DMat3 m(0.0);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j) m[i][j] = m[j][i] = uniform(random);
  return m;
}

double largest(const DMat3& m) {
  double most = 0.0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) most = std::max(most, std::abs(m[i][j]));
  return most;
}

/// F = value + (p - c)^T H (p - c) / 2 + cubic x^3: everything about its critical point at c is known.
class LocalForm final : public Field {
public:
  LocalForm(const DVec3& center, double value, const DMat3& h, double cubic = 0.0)
      : center_(center), value_(value), h_(h), cubic_(cubic) {}
  FieldSample sample(const DVec3& p) const override {
    const DVec3 x = p - center_;
    return {value_ + 0.5 * glm::dot(x, h_ * x) + cubic_ * x.x * x.x * x.x,
            h_ * x + DVec3(3.0 * cubic_ * x.x * x.x, 0.0, 0.0)};
  }
  DMat3 hessian(const DVec3& p) const override {
    DMat3 h = h_;
    h[0][0] += 6.0 * cubic_ * (p.x - center_.x);
    return h;
  }
  Box bounds() const override { return {center_ - 1.0, center_ + 1.0}; }
  Interval range(const Box&) const override { return {-1e300, 1e300}; }

private:
  DVec3 center_;
  double value_;
  DMat3 h_;
  double cubic_;
};

SkeletonField random_balls(unsigned seed, int count, Potential potential, double iso) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(-1.0, 1.0), radius(0.7, 1.1);
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < count; ++i) {
    SkeletonElement e;
    const double x = place(random), y = place(random), z = place(random);
    e.a = e.b = DVec3(x, y, z);
    e.radius = radius(random);
    e.potential = potential;
    elements.push_back(e);
  }
  return {elements, iso};
}

TEST(SymmetricEigen, rebuilds_random_matrices) {
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    const DMat3 m = random_symmetric(random);
    const SymmetricEigen eigen = symmetric_eigen(m);
    EXPECT_LE(eigen.values[0], eigen.values[1]);
    EXPECT_LE(eigen.values[1], eigen.values[2]);
    DMat3 diagonal(0.0);
    for (int k = 0; k < 3; ++k) diagonal[k][k] = eigen.values[k];
    const DMat3& v = eigen.vectors;
    EXPECT_LT(largest(v * diagonal * glm::transpose(v) - m), 1e-13);
    EXPECT_LT(largest(glm::transpose(v) * v - DMat3(1.0)), 1e-14);
    EXPECT_NEAR(glm::determinant(v), 1.0, 1e-13);
  }
}

TEST(SymmetricEigen, knows_special_matrices) {
  const SymmetricEigen zero = symmetric_eigen(DMat3(0.0));
  EXPECT_EQ(zero.values, DVec3(0.0));
  const SymmetricEigen same = symmetric_eigen(DMat3(2.0));
  EXPECT_EQ(same.values, DVec3(2.0));
  const SymmetricEigen rank_one = symmetric_eigen(glm::outerProduct(DVec3(1, 2, 2), DVec3(1, 2, 2)));
  EXPECT_NEAR(rank_one.values[0], 0.0, 1e-14);
  EXPECT_NEAR(rank_one.values[1], 0.0, 1e-14);
  EXPECT_NEAR(rank_one.values[2], 9.0, 1e-14);
  EXPECT_NEAR(std::abs(glm::dot(rank_one.vectors[2], DVec3(1, 2, 2) / 3.0)), 1.0, 1e-14);
}

TEST(Classify, follows_the_signs) {
  EXPECT_EQ(classify({-3, -2, -1}, 1e-6), CriticalKind::maximum);
  EXPECT_EQ(classify({-3, -2, 1}, 1e-6), CriticalKind::two_saddle);
  EXPECT_EQ(classify({-3, 2, 2}, 1e-6), CriticalKind::one_saddle);
  EXPECT_EQ(classify({1, 2, 3}, 1e-6), CriticalKind::minimum);
  EXPECT_EQ(classify({-1, 1e-7, 3}, 1e-6), CriticalKind::degenerate);
  EXPECT_EQ(classify({0, 0, 0}, 1e-6), CriticalKind::degenerate);
}

TEST(RefineCriticalPoint, finds_every_kind_in_every_rotation) {
  std::mt19937 random(2);
  const DVec3 forms[4] = {{-2, -1, -3}, {-2, -1, 3}, {-2, 1, 3}, {1, 2, 3}};
  for (int i = 0; i < 400; ++i) {
    const DMat3 turn = test::random_rotation(random);
    DMat3 d(0.0);
    for (int k = 0; k < 3; ++k) d[k][k] = forms[i % 4][k];
    const DVec3 center(0.3, -0.2, 5.0);
    const LocalForm field(center, 0.25, turn * d * glm::transpose(turn), 0.1);
    const auto point = refine_critical_point(field, center + 0.5 * turn[0], {});
    ASSERT_TRUE(point);
    EXPECT_LT(glm::distance(point->position, center), 1e-8);
    EXPECT_NEAR(point->value, 0.25, 1e-12);
    EXPECT_EQ(int(point->kind), i % 4);
  }
}

TEST(RefineCriticalPoint, gives_up_where_there_is_none) {
  // A plane wave has a slope everywhere; a cubic's slope has a least value above zero.
  const LocalForm flat(DVec3(0), 1.0, DMat3(0.0));
  EXPECT_FALSE(refine_critical_point(flat, DVec3(0.1), {}));
  class Slope final : public Field {
  public:
    FieldSample sample(const DVec3& p) const override {
      return {p.x + p.x * p.x * p.x + p.y * p.y + p.z * p.z, {1.0 + 3.0 * p.x * p.x, 2.0 * p.y, 2.0 * p.z}};
    }
    DMat3 hessian(const DVec3& p) const override {
      DMat3 h(2.0);
      h[0][0] = 6.0 * p.x;
      return h;
    }
    Box bounds() const override { return {}; }
    Interval range(const Box&) const override { return {-1e300, 1e300}; }
  };
  EXPECT_FALSE(refine_critical_point(Slope(), DVec3(0.4, 0.2, -0.3), {}));
  const LocalForm far(DVec3(100.0, 0.0, 0.0), 1.0, DMat3(1.0));
  EXPECT_FALSE(refine_critical_point(far, DVec3(0.0), {}));  // beyond the reach
}

TEST(RefineCriticalPoint, names_degenerate_points) {
  DMat3 h(0.0);
  h[1][1] = 1.0, h[2][2] = -2.0;
  const auto cubic = refine_critical_point(LocalForm(DVec3(0), 0.5, h, 1.0), DVec3(0.3, 0.2, 0.1), {});
  ASSERT_TRUE(cubic);
  EXPECT_EQ(cubic->kind, CriticalKind::degenerate);
  const auto line = refine_critical_point(LocalForm(DVec3(0), 0.5, h), DVec3(0.3, 0.2, 0.1), {});
  ASSERT_TRUE(line);
  EXPECT_EQ(line->kind, CriticalKind::degenerate);
}

TEST(MergeCriticalPoints, does_not_depend_on_the_order) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<CriticalPoint> points(200);
  for (CriticalPoint& p : points) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    p.position = DVec3(x, y, z);
  }
  std::vector<CriticalPoint> shuffled = points;
  std::shuffle(shuffled.begin(), shuffled.end(), random);
  merge_critical_points(points, 0.2);
  merge_critical_points(shuffled, 0.2);
  ASSERT_EQ(points.size(), shuffled.size());
  EXPECT_LT(points.size(), 200u);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(points[i].position, shuffled[i].position);
    for (std::size_t j = 0; j < i; ++j) EXPECT_GT(glm::distance(points[i].position, points[j].position), 0.2);
  }
}

TEST(DerivativeBounds, contain_what_they_bound) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> place(-1.5, 1.5), size(0.01, 0.8), unit(0.0, 1.0);
  for (const Potential potential :
       {Potential::inverse_square, Potential::cauchy, Potential::metaball, Potential::blinn, Potential::wyvill}) {
    const SkeletonField field = random_balls(5, 6, potential, 0.3);
    for (int i = 0; i < 200; ++i) {
      const double x = place(random), y = place(random), z = place(random);
      const Box box{DVec3(x, y, z), DVec3(x, y, z) + size(random)};
      const DerivativeBounds bounds = derivative_bounds(field, box);
      for (int k = 0; k < 10; ++k) {
        const double a = unit(random), b = unit(random), c = unit(random);
        const DVec3 p = box.low + DVec3(a, b, c) * box.size();
        const DVec3 g = field.sample(p).gradient;
        const DMat3 h = field.hessian(p);
        const double packed[6] = {h[0][0], h[1][1], h[2][2], h[1][0], h[2][0], h[2][1]};
        const double slack = 1e-9;  // the field's own rounding
        for (int j = 0; j < 3; ++j) {
          EXPECT_GE(g[j], bounds.gradient[j].low - slack * (1.0 + std::abs(g[j])));
          EXPECT_LE(g[j], bounds.gradient[j].high + slack * (1.0 + std::abs(g[j])));
        }
        for (int j = 0; j < 6; ++j) {
          EXPECT_GE(packed[j], bounds.hessian[j].low - slack * (1.0 + std::abs(packed[j])));
          EXPECT_LE(packed[j], bounds.hessian[j].high + slack * (1.0 + std::abs(packed[j])));
        }
      }
    }
  }
}

TEST(IntervalSearch, two_balls_have_two_maxima_and_a_saddle) {
  std::vector<SkeletonElement> elements(2);
  elements[0].a = elements[0].b = DVec3(-0.6, 0.1, 0.2);
  elements[1].a = elements[1].b = DVec3(0.6, 0.1, 0.2);
  const SkeletonField field(elements, 0.3);
  const IntervalSearch found = find_all_critical_points(field, {DVec3(-2.0), DVec3(2.0)}, {}, {.values = {-0.25, 2.0}});
  EXPECT_TRUE(found.complete);
  EXPECT_TRUE(found.unresolved.empty());
  ASSERT_EQ(found.points.size(), 3u);
  EXPECT_EQ(found.points[0].kind, CriticalKind::maximum);
  EXPECT_EQ(found.points[1].kind, CriticalKind::two_saddle);
  EXPECT_EQ(found.points[2].kind, CriticalKind::maximum);
  EXPECT_LT(glm::distance(found.points[1].position, DVec3(0.0, 0.1, 0.2)), 1e-8);
  EXPECT_NEAR(found.points[1].value, 2.0 * std::pow(1.0 - 0.36, 3) - 0.3, 1e-12);
}

TEST(IntervalSearch, reports_a_degenerate_field) {
  // Two equal balls exactly where the saddle and both maxima become one: F_xx vanishes at 5 q = 1.
  std::vector<SkeletonElement> elements(2);
  const double half = std::sqrt(0.2);
  elements[0].a = elements[0].b = DVec3(-half, 0, 0);
  elements[1].a = elements[1].b = DVec3(half, 0, 0);
  const SkeletonField field(elements, 0.3);
  const IntervalSearch found =
      find_all_critical_points(field, {DVec3(-1.1), DVec3(1.0)}, {}, {.values = {-0.2, 2.0}, .least_box = 1e-2});
  EXPECT_TRUE(found.complete);
  EXPECT_TRUE(found.points.empty());
  EXPECT_FALSE(found.unresolved.empty());
}

TEST(IntervalSearch, morse_inequality_of_random_balls) {
  // With every critical value above the level counted, maxima - 2-saddles + 1-saddles - minima is the Euler
  // characteristic of the solid {F > level}; far below all of them it is that of the union of overlapping balls: here
  // the balls all hold the origin, so the union is star-shaped and the sum is 1.
  for (unsigned seed = 0; seed < 6; ++seed) {
    const SkeletonField balls = random_balls(seed, 5, Potential::metaball, 0.0);
    std::vector<SkeletonElement> elements = balls.elements();
    for (SkeletonElement& e : elements) e.radius = glm::length(e.a) + 0.3;
    const SkeletonField field(elements, 0.0);
    CriticalOptions options;
    options.edge_length = 0.1;
    options.reach = 40.0;
    const IntervalSearch found =
        find_all_critical_points(field, {DVec3(-3.0), DVec3(3.0)}, options, {.values = {1e-3, 10.0}});
    EXPECT_TRUE(found.complete);
    EXPECT_TRUE(found.unresolved.empty());
    int sum = 0;
    for (const CriticalPoint& p : found.points)
      sum += p.kind == CriticalKind::maximum || p.kind == CriticalKind::one_saddle ? 1 : -1;
    EXPECT_EQ(sum, 1) << "seed " << seed << " points " << found.points.size();
  }
}

TEST(IntervalSearch, leaves_the_rounding_mode_as_it_was) {
  const tbb::global_control here(tbb::global_control::max_allowed_parallelism, 1);  // all of it in this thread
  std::vector<SkeletonElement> elements(2);
  elements[0].a = elements[0].b = DVec3(-0.5, 0.0, 0.0);
  elements[1].a = elements[1].b = DVec3(0.5, 0.1, 0.0);
  const SkeletonField field(elements, 0.3);
  ASSERT_EQ(std::fegetround(), FE_TONEAREST);
  const IntervalSearch found = find_all_critical_points(field, {DVec3(-2.0), DVec3(2.0)}, {}, {.values = {-0.25, 2.0}});
  const int mode = std::fegetround();
  std::fesetround(FE_TONEAREST);
  EXPECT_EQ(mode, FE_TONEAREST);
  EXPECT_FALSE(found.points.empty());
}

TEST(IntervalSearch, refuses_what_it_cannot_bound) {
  std::vector<SkeletonElement> segment(1);
  segment[0].b = DVec3(1.0, 0.0, 0.0);
  const SkeletonField field(segment, 0.3);
  EXPECT_THROW(find_all_critical_points(field, {DVec3(-2.0), DVec3(2.0)}, {}, {}), std::invalid_argument);
}

TEST(FindCriticalPoints, agrees_with_the_complete_search_near_the_surface) {
  for (unsigned seed = 10; seed < 16; ++seed) {
    const auto field = std::make_shared<SkeletonField>(random_balls(seed, 6, Potential::metaball, 0.4));
    CriticalOptions options;
    options.edge_length = 0.1;
    const IntervalSearch all =
        find_all_critical_points(*field, {DVec3(-2.2), DVec3(2.2)}, options, {.values = {-0.35, 10.0}});
    ASSERT_TRUE(all.complete);
    auto backend = make_reference_backend();
    backend->set_field(field);
    // Seeds all around: a lattice finer than the features.
    std::vector<DVec3> seeds;
    for (int x = -10; x <= 10; ++x)
      for (int y = -10; y <= 10; ++y)
        for (int z = -10; z <= 10; ++z) seeds.push_back(0.2 * DVec3(x, y, z));
    const CriticalSearch fast = find_critical_points(*field, *backend, seeds, options);
    std::vector<CriticalPoint> wanted;
    for (const CriticalPoint& p : fast.points)
      if (p.value > -0.35 && p.value < 10.0) wanted.push_back(p);
    ASSERT_EQ(wanted.size(), all.points.size()) << "seed " << seed;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      EXPECT_LT(glm::distance(wanted[i].position, all.points[i].position), 1e-7);
      EXPECT_EQ(wanted[i].kind, all.points[i].kind);
    }
  }
}

TEST(LeastGradientVertices, a_pinched_neck_shows) {
  // Balls joined by a thin neck (and bumps, for a symmetric surface has whole rings of equal slopes).
  std::vector<SkeletonElement> elements(4);
  const DVec3 centers[4] = {{-0.7, 0, 0}, {0.7, 0, 0}, {0.8, 0.2, 0.1}, {-0.8, 0.05, -0.2}};
  for (int i = 0; i < 4; ++i) {
    elements[i].a = elements[i].b = centers[i];
    if (i > 1) elements[i].weight = 0.3;
  }
  const auto neck = refine_critical_point(SkeletonField(elements, 0.0), DVec3(0.0), {});
  ASSERT_TRUE(neck);
  ASSERT_EQ(neck->kind, CriticalKind::two_saddle);
  const auto field = std::make_shared<SkeletonField>(elements, neck->value - 0.01);
  auto backend = make_reference_backend();
  backend->set_field(field);
  TriangleMesh mesh = test_meshes::icosphere(4, 1.0f);
  // Along rays from the neck: the surface is star-shaped about it.
  for (Vec3& p : mesh.vertices.position) {
    double low = 0.0, high = 2.0;
    for (int i = 0; i < 40; ++i)
      (field->value(neck->position + DVec3(p) * (0.5 * (low + high))) > 0.0 ? low : high) = 0.5 * (low + high);
    p = Vec3(neck->position + low * DVec3(p));
  }
  CriticalOptions options;
  options.edge_length = 0.1;
  const std::vector<DVec3> seeds = least_gradient_vertices(mesh, *backend);
  EXPECT_LT(seeds.size(), mesh.vertex_count() / 10);
  const CriticalSearch found = find_critical_points(*field, *backend, seeds, options);
  const bool saddle_found = std::any_of(found.points.begin(), found.points.end(), [&](const CriticalPoint& p) {
    return p.kind == CriticalKind::two_saddle && glm::distance(p.position, neck->position) < 1e-7;
  });
  EXPECT_TRUE(saddle_found) << found.points.size() << " points from " << seeds.size() << " seeds";
}

}  // namespace
}  // namespace isoskin
