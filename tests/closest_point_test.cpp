#include "core/sampling/closest_point.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "analytic_fields.h"
#include "test_meshes.h"

using namespace isoskin;

namespace {

/// Distance from p to a triangle by its definition: to the plane where the foot lies within, else to the edges.
double distance_to_triangle(const DVec3& p, const DVec3& a, const DVec3& b, const DVec3& c) {
  const auto to_segment = [&](const DVec3& u, const DVec3& v) {
    const double length = glm::dot(v - u, v - u);
    const double t = length > 0.0 ? std::clamp(glm::dot(p - u, v - u) / length, 0.0, 1.0) : 0.0;
    return glm::length(p - u - t * (v - u));
  };
  double best = std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
  const DVec3 n = glm::cross(b - a, c - a);
  const auto left = [&](const DVec3& u, const DVec3& v) { return glm::dot(glm::cross(v - u, p - u), n) >= 0.0; };
  if (glm::length(n) > 0.0 && left(a, b) && left(b, c) && left(c, a))
    best = std::min(best, std::abs(glm::dot(p - a, n)) / glm::length(n));
  return best;
}

struct Triangle {
  DVec3 a, b, c;
  Triangle(const TriangleMesh& m, std::size_t t)
      : a(m.position(m.vertex[3 * t])), b(m.position(m.vertex[3 * t + 1])), c(m.position(m.vertex[3 * t + 2])) {}
  double distance(const DVec3& p) const { return distance_to_triangle(p, a, b, c); }
  DVec3 normal() const { return glm::cross(b - a, c - a); }
};

DVec3 place(const TriangleMesh& mesh, const SurfacePoint& at) {
  const Triangle t(mesh, at.triangle);
  return DVec3(at.weight.x) * t.a + DVec3(at.weight.y) * t.b + DVec3(at.weight.z) * t.c;
}

}  // namespace

TEST(ClosestPoint, EqualsBruteForce) {
  TriangleMesh mesh = test_meshes::torus(30, 17);
  test_meshes::jitter(mesh, 0.02f, 4);
  const ClosestPoint closest(mesh);
  std::mt19937 random(1);
  std::uniform_real_distribution<float> near(-2.0f, 2.0f);
  for (int i = 0; i < 400; ++i) {
    const Vec3 p = i % 4 ? Vec3(near(random), near(random), near(random)) : mesh.position(Index(i));
    double expected = std::numeric_limits<double>::infinity();
    for (std::size_t t = 0; t < mesh.triangle_count(); ++t)
      expected = std::min(expected, Triangle(mesh, t).distance(DVec3(p)));
    const SurfacePoint at = closest.nearest(p);
    ASSERT_NE(at.triangle, kNone);
    EXPECT_NEAR(at.distance, expected, 1e-6);
    EXPECT_NEAR(glm::length(place(mesh, at) - DVec3(p)), expected, 1e-5);
    EXPECT_NEAR(at.weight.x + at.weight.y + at.weight.z, 1.0, 1e-6);
    EXPECT_GE(std::min({at.weight.x, at.weight.y, at.weight.z}), -1e-6);
  }
}

TEST(ClosestPoint, TiesGoToTheSmallestTriangle) {
  const TriangleMesh mesh = test_meshes::icosphere(2);
  const ClosestPoint closest(mesh);
  ClosestPoint::Neighbour neighbour;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    Index first = 0;
    while (mesh.vertex[first] != v) ++first;
    EXPECT_EQ(closest.nearest(mesh.position(v)).triangle, first / 3);
    EXPECT_EQ(closest.nearest(mesh.position(v), Vec3(0), 1.0f, &neighbour).triangle, first / 3);
    EXPECT_EQ(closest.nearest(mesh.position(v)).distance, 0.0f);
  }
}

TEST(ClosestPoint, SideTellsTwoSheetsApart) {
  const TriangleMesh mesh = test_meshes::cube(4, 1.0f);
  const ClosestPoint closest(mesh);
  const Vec3 p(0.3f, 0.2f, 0.9f);
  EXPECT_NEAR(closest.nearest(p).distance, 0.1f, 1e-6);
  EXPECT_NEAR(closest.nearest(p, Vec3(0, 0, 1)).distance, 0.1f, 1e-6);
  const SurfacePoint below = closest.nearest(p, Vec3(0, 0, -1));
  EXPECT_GE(glm::dot(Triangle(mesh, below.triangle).normal(), DVec3(0, 0, -1)), 0.0);
  EXPECT_GT(below.distance, 0.5f);
  EXPECT_NEAR(closest.nearest(p, Vec3(0, 0, -1), 0.2f).distance, 0.1f, 1e-6);  // nothing else is that near
}

TEST(ClosestPoint, SidedSearchEqualsBruteForce) {
  const TriangleMesh mesh = test_meshes::torus(24, 13);
  const ClosestPoint closest(mesh);
  std::mt19937 random(2);
  std::normal_distribution<float> any;
  ClosestPoint::Neighbour neighbour;  // far away most times: it must not matter
  for (int i = 0; i < 200; ++i) {
    const Vec3 p(any(random), any(random), any(random)),
        side = glm::normalize(Vec3(any(random), any(random), any(random)));
    double expected = std::numeric_limits<double>::infinity();
    for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
      const Triangle c(mesh, t);
      if (glm::dot(c.normal(), DVec3(side)) >= 0.0) expected = std::min(expected, c.distance(DVec3(p)));
    }
    const SurfacePoint alone = closest.nearest(p, side), after = closest.nearest(p, side, 10.0f, &neighbour);
    EXPECT_NEAR(alone.distance, expected, 1e-5);
    EXPECT_EQ(after.triangle, alone.triangle);
    EXPECT_EQ(after.weight, alone.weight);
  }
}

TEST(ClosestPoint, EmptyMeshHasNone) {
  const TriangleMesh mesh;
  EXPECT_EQ(ClosestPoint(mesh).nearest(Vec3(0)).triangle, kNone);
}

TEST(CarryAttributes, LinearColumnsArriveOnTheNewSurface) {
  const auto backend = make_reference_backend();
  backend->set_field(std::make_shared<analytic::SphereField>());
  TriangleMesh old = test_meshes::icosphere(4);
  for (std::size_t v = 0; v < old.vertex_count(); ++v) {
    old.vertices.rest[v] = 2.0f * old.position(v) + Vec3(1, 0, 0);
    old.vertices.velocity[v] = Vec3(old.position(v).z, 0, 0);
  }
  TriangleMesh mesh = test_meshes::icosphere(3);
  const Vec3 kept = mesh.vertices.rest[3];
  carry_attributes(mesh, 10, old, *backend);
  EXPECT_EQ(mesh.vertices.rest[3], kept);
  for (std::size_t v = 10; v < mesh.vertex_count(); ++v) {
    const Vec3 p = mesh.position(v);
    EXPECT_LT(glm::length(mesh.vertices.rest[v] - 2.0f * p - Vec3(1, 0, 0)), 0.01f);
    EXPECT_NEAR(mesh.vertices.velocity[v].x, p.z, 0.01f);
  }
  const std::vector<Vec3> before = mesh.vertices.rest;
  carry_attributes(mesh, 0, TriangleMesh{}, *backend);
  EXPECT_EQ(mesh.vertices.rest, before);
}

TEST(CarryAttributes, ThinSheetsTakeFromTheirOwnSide) {
  // Old surface: a plate 0.1 thick, its sides told apart by their velocity; the new one is 0.06 thinner on each side.
  const auto backend = make_reference_backend();
  backend->set_field(std::make_shared<analytic::SphereField>(DVec3(0, 0, -100), 100.0));
  TriangleMesh old = test_meshes::cube(8, 1.0f);
  for (std::size_t v = 0; v < old.vertex_count(); ++v) {
    const bool top = old.position(v).z > 0;
    old.vertices.position[v].z = top ? 0.05f : -0.05f;
    old.vertices.velocity[v] = Vec3(top ? 1.0f : -1.0f);
  }
  TriangleMesh mesh = make_mesh({{0, 0, -0.01f}, {0.1f, 0, -0.01f}, {0, 0.1f, -0.01f}, {0, 0, -0.1f}},
                                {0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2});
  carry_attributes(mesh, 0, old, *backend);
  for (int v = 0; v < 3; ++v) EXPECT_EQ(mesh.vertices.velocity[v].x, 1.0f);  // nearer to the lower side, but facing up
}
