// Necks and tunnels are cut where the new field has left them.
#include "core/topology/split_necks.h"

#include <random>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/mesh/validate.h"
#include "core/sampling/marching_cubes.h"
#include "tests/solid_field.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

constexpr double kEdge = 0.1;

SolidField field_of(SolidField::Solid solid) {
  return {std::move(solid), Box{DVec3(-3.0), DVec3(3.0)}};
}

TriangleMesh mesh_of(const SolidField& field) {
  const auto shared = std::make_shared<SolidField>(field);
  auto backend = make_reference_backend();
  backend->set_field(shared);
  const BrickLattice lattice = sample_lattice(*shared, *backend, kEdge);
  return marching_cubes(lattice, lattice_topology(lattice));
}

int euler_of(const TriangleMesh& mesh) {
  return int(mesh.vertex_count()) - int(mesh.triangle_count()) / 2;
}

/// Triangles nearer to `center` than `radius`, as quasi-critical ones that were not moved.
QuasiCritical cluster_about(const TriangleMesh& mesh, const DVec3& center, double radius, int side) {
  QuasiCritical cluster;
  cluster.side = side;
  for (Index t = 0; t < mesh.triangle_count(); ++t) {
    DVec3 middle(0.0);
    for (Index k = 0; k < 3; ++k) middle += DVec3(mesh.position(mesh.vertex[3 * t + k])) / 3.0;
    if (glm::distance(middle, center) > radius) continue;
    cluster.triangles.push_back(t);
    cluster.points.push_back(middle);
  }
  return cluster;
}

DVec3 random_unit(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);
  return glm::normalize(DVec3(x, y, z));
}

}  // namespace

TEST(SplitNecks, FindsTheAxisOfANeck) {
  std::mt19937 random(3);
  for (int i = 0; i < 5; ++i) {
    const DVec3 axis = random_unit(random);
    const TriangleMesh mesh = mesh_of(field_of(solid::rod(-1.0 * axis, 1.0 * axis, 0.25)));
    const QuasiCritical cluster = cluster_about(mesh, DVec3(0.0), 0.5, -1);
    EXPECT_GT(std::abs(glm::dot(neck_axis(mesh, cluster.triangles), axis)), 0.98);
  }
}

TEST(SplitNecks, CutsADumbbellInTwo) {
  std::mt19937 random(5);
  for (int i = 0; i < 6; ++i) {
    const DVec3 axis = random_unit(random);
    const auto balls = solid::both(solid::ball(-0.9 * axis, 0.6), solid::ball(0.9 * axis, 0.6));
    const TriangleMesh before = mesh_of(field_of(solid::both(balls, solid::rod(-0.9 * axis, 0.9 * axis, 0.2))));
    const SolidField after = field_of(balls);
    ASSERT_EQ(mesh_pieces(before).count(), 1u);
    TriangleMesh mesh = before;
    SplitOptions options;
    options.edge_length = kEdge;
    const PlannedPatch planned = plan_split(mesh, cluster_about(mesh, DVec3(0.0), 0.3, -1), after, options);
    ASSERT_TRUE(planned.patch) << planned.reason;
    ASSERT_TRUE(planned.patch->apply(mesh));
    const ValidateReport valid = validate(mesh);
    EXPECT_TRUE(valid) << valid.reason;
    EXPECT_EQ(euler_of(mesh), 4);
    EXPECT_EQ(mesh_pieces(mesh).count(), 2u);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      if (mesh.vertices.id[v] < before.next_id) continue;
      EXPECT_NEAR(after.value(DVec3(mesh.position(v))), 0.0, 0.25 * kEdge) << v;  // caps lie on the new surface
      EXPECT_EQ(mesh.vertices.velocity[v], Vec3(0.0f));
    }
  }
}

TEST(SplitNecks, ClosesATunnel) {
  const auto ring = solid::torus(DVec3(0.0), 0.7, 0.5);
  const TriangleMesh before = mesh_of(field_of(ring));
  ASSERT_EQ(euler_of(before), 0);
  const SolidField after = field_of(solid::both(ring, solid::plate(DVec3(0.0), 0.3, 0.2)));
  TriangleMesh mesh = before;
  SplitOptions options;
  options.edge_length = kEdge;
  const PlannedPatch planned = plan_split(mesh, cluster_about(mesh, DVec3(0.0), 0.3, 1), after, options);
  ASSERT_TRUE(planned.patch) << planned.reason;
  ASSERT_TRUE(planned.patch->apply(mesh));
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  EXPECT_EQ(euler_of(mesh), 2);
  EXPECT_EQ(mesh_pieces(mesh).count(), 1u);
}

TEST(SplitNecks, LeavesWhatTheFieldStillHolds) {
  const SolidField rod = field_of(solid::rod({-1, 0, 0}, {1, 0, 0}, 0.25));
  const TriangleMesh mesh = mesh_of(rod);
  SplitOptions options;
  options.edge_length = kEdge;
  EXPECT_FALSE(plan_split(mesh, cluster_about(mesh, DVec3(0.0), 0.4, -1), rod, options).patch);
  // A bare patch of a ball's side is no neck, whatever the field says.
  const SolidField nothing = field_of(solid::ball({9, 9, 9}, 0.1));
  const TriangleMesh ball = mesh_of(field_of(solid::ball(DVec3(0.0), 1.0)));
  QuasiCritical cap = cluster_about(ball, {1, 0, 0}, 0.3, 1);
  EXPECT_FALSE(plan_split(ball, cap, nothing, options).patch);
}

RC_GTEST_PROP(SplitNecks, RandomNecksStayManifold, ()) {
  const unsigned seed = *rc::gen::arbitrary<unsigned>();
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const DVec3 axis = random_unit(random);
  const double radius = 0.12 + 0.25 * uniform(random), gap = 0.1 + 0.5 * uniform(random);
  const double end = 0.6 + 0.5 * gap;
  const auto balls = solid::both(solid::ball(-end * axis, 0.6), solid::ball(end * axis, 0.5));
  TriangleMesh mesh = mesh_of(field_of(solid::both(balls, solid::rod(-end * axis, end * axis, radius))));
  test_meshes::jitter(mesh, 0.02f, seed);
  const int euler = euler_of(mesh);
  SplitOptions options;
  options.edge_length = kEdge;
  const PlannedPatch planned =
      plan_split(mesh, cluster_about(mesh, DVec3(0.0), radius + 0.4 * gap, -1), field_of(balls), options);
  if (!planned.patch) {
    RC_ASSERT(!planned.reason.empty());
    return;
  }
  RC_ASSERT(planned.patch->apply(mesh));
  RC_ASSERT(validate(mesh).reason == "");
  RC_ASSERT(euler_of(mesh) == euler + 2);
}

}  // namespace isoskin
