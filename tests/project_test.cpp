#include "core/mechanics/project.h"

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "tests/analytic_fields.h"

using namespace isoskin;

namespace {

/// Any function as a field; remembers where it was asked.
class LambdaField final : public Field {
public:
  explicit LambdaField(std::function<FieldSample(const DVec3&)> f) : f_(std::move(f)) {}
  FieldSample sample(const DVec3& p) const override {
    asked.push_back(p);
    return f_(p);
  }
  Box bounds() const override { return {DVec3(-10.0), DVec3(10.0)}; }
  Interval range(const Box&) const override { return {-HUGE_VAL, HUGE_VAL}; }

  mutable std::vector<DVec3> asked;

private:
  std::function<FieldSample(const DVec3&)> f_;
};

const ProjectOptions kOptions{1e-6f, 0.5f, 16, 40};

std::vector<DVec3> random_points(int count, double half) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> u(-half, half);
  std::vector<DVec3> points;
  for (int i = 0; i < count; ++i) points.push_back({u(rng), u(rng), u(rng)});
  return points;
}

void expect_stays(const Field& field, const DVec3& p) {
  const Projection r = project_point(field, p, kOptions);
  EXPECT_EQ(r.status, ProjectStatus::quasi_critical);
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(r.point[k] == p[k] || (std::isnan(r.point[k]) && std::isnan(p[k])));
}

}  // namespace

TEST(Project, DistanceFieldsGiveTheNearestPoint) {
  const analytic::TorusField torus(1.0, 0.4);
  for (const DVec3& p : random_points(500, 2.0)) {
    const Projection r = project_point(torus, p, kOptions);
    ASSERT_EQ(r.status, ProjectStatus::converged);
    EXPECT_LE(std::abs(torus.value(r.point)), 1.01e-6);
    EXPECT_NEAR(glm::length(r.point - p), std::abs(torus.value(p)), 1e-5);
  }
}

TEST(Project, QuadraticSphereConvergesInFewEvaluationsFromBothSides) {
  const LambdaField field([](const DVec3& p) { return FieldSample{1.0 - glm::dot(p, p), -2.0 * p}; });
  std::size_t evaluations = 0, count = 0;
  for (const DVec3& p : random_points(500, 1.5)) {
    if (glm::length(p) < 0.3) continue;
    field.asked.clear();
    const Projection r = project_point(field, p, kOptions);
    ASSERT_EQ(r.status, ProjectStatus::converged);
    EXPECT_NEAR(glm::length(r.point), 1.0, 2e-6);
    EXPECT_LT(glm::length(glm::normalize(r.point) - glm::normalize(p)), 1e-9);
    evaluations += field.asked.size();
    ++count;
  }
  EXPECT_LT(double(evaluations) / double(count), 7.0);
}

TEST(Project, StepsAreClamped) {
  const LambdaField steep([](const DVec3& p) { return FieldSample{5.0 - p.x, {-1, 0, 0}}; });
  const Projection r = project_point(steep, DVec3(0.0), kOptions);
  EXPECT_EQ(r.status, ProjectStatus::converged);
  EXPECT_NEAR(r.point.x, 5.0, 1e-6);
  for (std::size_t i = 1; i < steep.asked.size(); ++i) {
    EXPECT_LE(glm::length(steep.asked[i] - steep.asked[i - 1]), 0.5 + 1e-9);
  }
  EXPECT_EQ(project_point(steep, DVec3(-4, 0, 0), kOptions).status,
            ProjectStatus::quasi_critical);  // 9 away, 8 allowed
}

TEST(Project, CreasedFieldsWhereNewtonAloneCyclesAreFinishedBySearch) {
  // Newton on sign(x) sqrt|x| jumps from x to -x for ever.
  const LambdaField root([](const DVec3& p) {
    const double a = std::max(std::abs(p.x), 1e-300);
    return FieldSample{std::copysign(std::sqrt(a), p.x), {0.5 / std::sqrt(a), 0, 0}};
  });
  // A kink whose slopes differ a thousandfold.
  const LambdaField kink([](const DVec3& p) {
    const double slope = p.x > 0.1 ? 10.0 : 0.01;
    return FieldSample{slope * (p.x - 0.1) + 1e-5, {slope, 0, 0}};
  });
  for (const double x : {-0.24, -0.01, 0.003, 0.2}) {
    const Projection a = project_point(root, {x, 3.0, -1.0}, kOptions);
    EXPECT_EQ(a.status, ProjectStatus::converged) << x;
    EXPECT_NEAR(a.point.x, 0.0, 2e-6);
    EXPECT_EQ(a.point.y, 3.0);
    const Projection b = project_point(kink, {x, 0, 0}, kOptions);
    EXPECT_EQ(b.status, ProjectStatus::converged) << x;
    EXPECT_LE(std::abs(kink.sample(b.point).value), 0.011e-6 + 1e-6 * kink.sample(b.point).gradient.x);
  }
  const analytic::PlaneField plane(DVec3(0, 0, 4), 2.0);
  EXPECT_NEAR(project_point(plane, DVec3(0, 0, 3), kOptions).point.z, 0.5, 1e-6);
}

TEST(Project, CubeFieldConvergesOntoItsFaces) {
  const LambdaField cube([](const DVec3& p) {
    const DVec3 a = glm::abs(p);
    const int k = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
    FieldSample s{1.0 - a[k], DVec3(0.0)};
    s.gradient[k] = p[k] > 0.0 ? -1.0 : 1.0;
    return s;
  });
  for (const DVec3& p : random_points(500, 1.8)) {
    const Projection r = project_point(cube, p, kOptions);
    ASSERT_EQ(r.status, ProjectStatus::converged);
    EXPECT_NEAR(cube.sample(r.point).value, 0.0, 1e-6);
  }
}

TEST(Project, WhatDoesNotConvergeStaysWhereItWas) {
  const LambdaField no_surface([](const DVec3& p) { return FieldSample{-0.1 - glm::dot(p, p), -2.0 * p}; });
  const LambdaField flat([](const DVec3&) { return FieldSample{1.0, DVec3(0.0)}; });
  const LambdaField flat_zero([](const DVec3&) { return FieldSample{0.0, DVec3(0.0)}; });
  const LambdaField nan_value([](const DVec3&) { return FieldSample{NAN, {1, 0, 0}}; });
  const LambdaField nan_gradient([](const DVec3&) { return FieldSample{1.0, {NAN, 0, 0}}; });
  const LambdaField infinite([](const DVec3&) { return FieldSample{HUGE_VAL, {1, 0, 0}}; });
  const LambdaField almost_flat([](const DVec3&) { return FieldSample{1.0, {1e-150, 0, 0}}; });
  const LambdaField turns_nan([](const DVec3& p) { return FieldSample{p.x > 0.4 ? NAN : 1.0 - p.x, {-1, 0, 0}}; });
  for (const LambdaField* f : {&no_surface, &flat, &flat_zero, &nan_value, &nan_gradient, &infinite, &turns_nan}) {
    expect_stays(*f, {0.25, 0.5, -0.125});
  }
  expect_stays(almost_flat, {0.25, 0.5, -0.125});
  expect_stays(LambdaField([](const DVec3& p) { return FieldSample{1.0 - glm::dot(p, p), -2.0 * p}; }), DVec3(0.0));
}

TEST(Project, PointsThatAreNotFiniteAreNeverSampled) {
  const LambdaField field([](const DVec3&) { return FieldSample{1.0, {1, 0, 0}}; });
  expect_stays(field, {NAN, 0, 0});
  expect_stays(field, {0, HUGE_VAL, 0});
  expect_stays(field, {0, 0, -HUGE_VAL});
  EXPECT_TRUE(field.asked.empty());
  expect_stays(analytic::SphereField(), DVec3(1e30, 0, 0));  // too far for the steps allowed
}

TEST(Project, PointOnTheSurfaceDoesNotMove) {
  const analytic::SphereField sphere;
  const DVec3 p(0.6, 0.8, 0.0);
  ProjectOptions none = kOptions;
  none.max_newton = 0;
  const Projection r = project_point(sphere, p, none);
  EXPECT_EQ(r.status, ProjectStatus::converged);
  EXPECT_EQ(r.point, p);
  EXPECT_EQ(project_point(sphere, 1.1 * p, none).status, ProjectStatus::quasi_critical);
}
