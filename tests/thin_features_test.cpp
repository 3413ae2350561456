#include "core/topology/thin_features.h"

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/mesh/small_pieces.h"
#include "core/mesh/validate.h"
#include "core/topology/clear_of_zero.h"
#include "core/topology/droplets.h"
#include "core/topology/flaps.h"
#include "core/topology/thin_motion.h"
#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

CriticalPoint saddle(CriticalKind kind, double value, const DVec3& eigenvalues) {
  CriticalPoint p;
  p.kind = kind;
  p.value = value;
  p.hessian.values = eigenvalues;
  return p;
}

/// A tube of radius r about z, as the waist of F = v - (x^2 + y^2) / 2 + z^2 / 2 with v = r^2 / 2.
TEST(ThinFeatures, are_the_waist_of_thin_necks_only) {
  const TriangleMesh mesh = test_meshes::torus(24, 12, 1.0f, 0.3f);  // vertices all over
  ThinOptions options;
  options.edge_length = 1.0;
  const auto held = [&](const CriticalPoint& p) { return thin_feature_vertices(mesh, std::span(&p, 1), options); };
  const DVec3 neck(-1, -1, 1), tunnel(-1, 1, 1);
  EXPECT_TRUE(held(saddle(CriticalKind::two_saddle, 0.5, neck)).empty());    // radius 1: thick
  EXPECT_TRUE(held(saddle(CriticalKind::two_saddle, -0.1, neck)).empty());   // a gap
  EXPECT_TRUE(held(saddle(CriticalKind::one_saddle, 0.1, tunnel)).empty());  // a membrane
  EXPECT_TRUE(held(saddle(CriticalKind::maximum, 0.1, {-1, -1, -1})).empty());
  // Radius 0.2, thin up to 0.8: the hyperboloid is as wide as that at |z| = sqrt(0.64 - 0.04).
  const std::vector<Index> vertices = held(saddle(CriticalKind::two_saddle, 0.02, neck));
  std::vector<Index> wanted;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Vec3& p = mesh.position(v);
    if (std::hypot(p.x, p.y) <= 0.8f && std::abs(p.z) <= std::sqrt(0.6f)) wanted.push_back(v);
  }
  EXPECT_FALSE(wanted.empty());
  EXPECT_EQ(vertices, wanted);
}

TEST(ThinFeatures, of_a_tunnel_lie_along_its_negative_axis) {
  const TriangleMesh mesh = test_meshes::torus(24, 12, 1.0f, 0.3f);
  ThinOptions options;
  CriticalPoint p = saddle(CriticalKind::one_saddle, -0.02, {-1, 1, 1});  // along x
  const std::vector<Index> vertices = thin_feature_vertices(mesh, std::span(&p, 1), options);
  std::vector<Index> wanted;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Vec3& q = mesh.position(v);
    if (std::hypot(q.y, q.z) <= 0.8f && std::abs(q.x) <= std::sqrt(0.6f)) wanted.push_back(v);
  }
  EXPECT_EQ(vertices, wanted);
}

TriangleMesh octahedron(float radius, const Vec3& center) {
  std::vector<Vec3> points{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  for (Vec3& p : points) p = center + radius * p;
  return make_mesh(points, {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5});
}

void add(TriangleMesh& mesh, TriangleMesh other) {
  for (Index& id : other.vertices.id) id += mesh.next_id;
  other.next_id += mesh.next_id;
  append(mesh, other);
}

TEST(SmallPieces, are_octahedra_and_less) {
  TriangleMesh mesh = test_meshes::icosphere(1);
  const Index first = Index(mesh.vertex_count()), first_halfedge = Index(mesh.vertex.size());
  add(mesh, octahedron(0.1f, Vec3(3, 0, 0)));
  add(mesh, test_meshes::tetrahedron());
  std::vector<Index> wanted(mesh.vertex_count() - first);
  for (std::size_t i = 0; i < wanted.size(); ++i) wanted[i] = first + Index(i);
  EXPECT_EQ(small_piece_vertices(mesh), wanted);
  EXPECT_EQ(small_piece_vertices(mesh, {3, first_halfedge / 3 + 5}),
            std::vector<Index>(wanted.begin(), wanted.begin() + 6));
  EXPECT_FALSE(is_small_piece(mesh, 5));
  EXPECT_TRUE(is_small_piece(mesh, first_halfedge + 7));
}

TEST(GrowSmallPieces, cuts_those_that_have_grown) {
  const auto field = std::make_shared<analytic::SphereField>(DVec3(0.5, 0.0, 0.0), 1.0);
  auto backend = make_reference_backend();
  backend->set_field(field);
  ProjectOptions project;
  for (const auto& [edge_length, triangles] : {std::pair(1.0, 8u), {0.8, 32u}, {0.3, 128u}}) {
    TriangleMesh mesh = test_meshes::icosphere(2, 1.0f, Vec3(0.5f, 0.0f, 0.0f));
    const std::size_t rest = mesh.triangle_count();
    add(mesh, octahedron(1.0f, Vec3(0.5f, 0.0f, 0.0f)));
    EXPECT_EQ(grow_small_pieces(mesh, *backend, project, edge_length), triangles > 8 ? 1u : 0u);
    EXPECT_EQ(mesh.triangle_count(), rest + triangles);
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
    for (const Vec3& p : mesh.vertices.position) EXPECT_NEAR(glm::distance(p, Vec3(0.5f, 0.0f, 0.0f)), 1.0f, 1e-3f);
  }
}

/// Two balls joined by a thin neck along x.
SkeletonField neck_at(double y) {
  std::vector<SkeletonElement> balls(2);
  for (int i = 0; i < 2; ++i) {
    balls[i].a = balls[i].b = {i == 0 ? -0.699 : 0.699, y, 0.0};
    balls[i].radius = 1.0;
  }
  return SkeletonField(balls, 0.265302);
}

TEST(ThinMotion, keeps_a_ring_about_a_waist_that_moves_aside_by_more_than_its_radius) {
  const SkeletonField before = neck_at(0.0), after = neck_at(0.1);
  CriticalOptions critical;
  critical.edge_length = 0.15;
  CriticalPath path;
  path.first = refine_critical_point(before, {0, 0, 0}, critical).value();
  path.last = refine_critical_point(after, {0, 0.1, 0}, critical).value();
  const double waist = std::sqrt(2.0 * path.first.value / std::abs(path.first.hessian.values[0]));
  ASSERT_GT(path.first.value, 0.0);
  ASSERT_LT(waist, 0.05);
  TriangleMesh mesh;
  mesh.vertices.resize(6);
  const auto way = [](Index v) { return DVec3(0.0, std::cos(v * M_PI / 3.0), std::sin(v * M_PI / 3.0)); };
  ProjectOptions project;
  for (Index v = 0; v < 6; ++v) mesh.vertices.position[v] = Vec3(project_point(before, waist * way(v), project).point);
  ThinOptions options;
  options.edge_length = critical.edge_length;
  CriticalTracking tracking;
  tracking.paths = {path};
  const ThinMotion motion(mesh, tracking, {}, before, after, options);
  for (Vec3& p : mesh.vertices.position) p = Vec3(project_point(after, DVec3(p), project).point);
  motion.apply(mesh, after, 0.5);
  for (Index v = 0; v < 6; ++v) {
    const DVec3 p(mesh.position(v)), d = p - DVec3(0, 0.1, 0);
    EXPECT_NEAR(after.value(p), 0.0, 1e-5);
    EXPECT_GT(glm::dot(glm::normalize(d), way(v)), 0.99);
    EXPECT_NEAR(mesh.vertices.velocity[v].y, 0.2, 0.01);
  }
}

/// Two balls of radius 1 that just touch, or do not.
TEST(ClearOfZero, widens_necks_and_gaps_but_keeps_their_signs) {
  for (const double iso : {0.2405, 0.2407, 0.18}) {
    SkeletonElement left, right;
    left.a = left.b = {-0.71, 0.0, 0.0};
    right.a = right.b = {0.71, 0.0, 0.0};
    const double middle = 2.0 * std::pow(1.0 - 0.71 * 0.71, 3.0);  // F + iso at the origin, 0.244
    const SkeletonField field({left, right}, iso + middle - 0.2406);
    CriticalOptions critical;
    critical.edge_length = 0.1;
    const CriticalPoint saddle = describe_critical_point(field, DVec3(0.0), critical);
    ASSERT_EQ(saddle.kind, CriticalKind::two_saddle);
    ClearOptions options;
    options.length = 0.05;
    const auto wider = clear_of_zero(field, std::span(&saddle, 1), options);
    if (iso == 0.18) {
      EXPECT_EQ(wider, nullptr);  // a thick neck
      continue;
    }
    ASSERT_NE(wider, nullptr);
    const double value = wider->value(DVec3(0.0));
    const DVec3 size = glm::abs(saddle.hessian.values);
    const double curvature = saddle.value > 0.0 ? std::max(size.x, size.y) : size.z;
    EXPECT_EQ(value > 0.0, saddle.value > 0.0);
    EXPECT_NEAR(std::abs(value), 0.5 * curvature * 0.05 * 0.05, 1e-9);
    EXPECT_EQ(describe_critical_point(*wider, DVec3(0.0), critical).kind, CriticalKind::two_saddle);
    EXPECT_EQ(wider->value({0.4, 0.0, 0.0}), field.value({0.4, 0.0, 0.0}));  // beyond the farthest
  }
}

/// A vertex of a sphere that has come to lie on its far side pulls a double sheet through the ball.
TEST(Flaps, that_span_a_ball_are_collapsed) {
  const SkeletonField field({SkeletonElement{}}, 0.2);
  const float radius = float(std::sqrt(1.0 - std::cbrt(0.2)));
  TriangleMesh mesh = test_meshes::icosphere(3);
  for (Vec3& p : mesh.vertices.position) p = radius * glm::normalize(p);
  const std::size_t vertices = mesh.vertex_count();
  const auto backend = make_reference_backend();
  backend->set_field(std::make_shared<SkeletonField>(field));
  const IsFar is_far = [](double value, double slope) { return std::abs(value) > 0.2 * std::max(slope, 0.5); };
  EXPECT_EQ(collapse_flaps(mesh, field, *backend, {}, is_far), 0u);
  mesh.vertices.position[100] = -mesh.vertices.position[100];
  EXPECT_EQ(collapse_flaps(mesh, field, *backend, std::vector<std::uint8_t>(vertices, 1), is_far), 0u);
  EXPECT_EQ(collapse_flaps(mesh, field, *backend, {}, is_far), 1u);
  EXPECT_EQ(mesh.vertex_count(), vertices - 1);
  EXPECT_TRUE(validate(mesh));
  EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
  EXPECT_EQ(collapse_flaps(mesh, field, *backend, {}, is_far), 0u);
}

}  // namespace
}  // namespace isoskin
