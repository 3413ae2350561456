#include "core/refine/geometric_mesh.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/mesh/validate.h"
#include "core/refine/untangle.h"
#include "core/topology/triangle_pairs.h"
#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

constexpr double kEdge = 0.15;

/// A ball of radius 1, and a thread of radius 0.1 from its centre to z = 1.8.
class Thread final : public Field {
public:
  static constexpr double kRadius = 0.1, kTip = 1.8;
  FieldSample sample(const DVec3& p) const override {
    const DVec3 axis(0.0, 0.0, std::clamp(p.z, 0.0, kTip - kRadius));
    const double ball = 1.0 - glm::length(p), thread = kRadius - glm::length(p - axis);
    const DVec3 from = ball > thread ? p : p - axis;
    return {std::max(ball, thread), -from / std::max(glm::length(from), 1e-9)};
  }
  Box bounds() const override { return {DVec3(-1.0), DVec3(1.0, 1.0, kTip)}; }
  /// F is a distance: it changes no faster than the place.
  Interval range(const Box& box) const override {
    const double middle = value(box.center()), reach = 0.5 * box.diagonal();
    return {middle - reach, middle + reach};
  }
};

struct Made {
  GeometricMesh mesh;
  GeometricReport report;
};

RefineOptions finely() {
  RefineOptions refine;
  refine.sagitta = 0.003f;
  refine.shortest = float(kEdge / 3.0);
  return refine;
}

Made make(const std::shared_ptr<const Field>& field, const TriangleMesh& mechanical, int fillings,
          const RefineOptions& refine = finely()) {
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(field);
  const BrickLattice lattice = sample_lattice(*field, *backend, kEdge / 3.0);
  GeometricOptions options;
  options.refine = refine;
  options.project = {1e-5f, float(0.5 * kEdge), 32, 32};
  options.edge_length = kEdge;
  options.certify.tolerance = 2.0 * kEdge / 3.0;
  options.fillings = fillings;
  Made made;
  made.mesh = geometric_mesh(mechanical, *field, lattice, lattice_topology(lattice), *backend, options, &made.report);
  return made;
}

double highest(const TriangleMesh& mesh) {
  double z = -HUGE_VAL;
  for (const Vec3& p : mesh.vertices.position) z = std::max(z, double(p.z));
  return z;
}

void expect_on_surface(const GeometricMesh& made, const Field& field, double most) {
  const ValidateReport valid = validate(made.mesh);
  ASSERT_TRUE(valid) << valid.reason;
  ASSERT_EQ(made.normal.size(), made.mesh.vertex_count());
  double worst = 0.0;
  for (const Vec3& p : made.mesh.vertices.position) worst = std::max(worst, field.distance_estimate(DVec3(p)));
  EXPECT_LT(worst, most);
}

}  // namespace

TEST(GeometricMesh, FollowsAThreadThatTheMechanicalMeshCutsShort) {
  const auto field = std::make_shared<Thread>();
  TriangleMesh skin = test_meshes::icosphere(3);  // the ball alone
  for (std::size_t v = 0; v < skin.vertex_count(); ++v) {
    skin.vertices.rest[v] = Vec3(1.0f, 2.0f, 3.0f) * skin.position(Index(v));
    skin.vertices.velocity[v] = Vec3(0.0f, 0.0f, 5.0f);
  }
  const Made without = make(field, skin, 0);
  EXPECT_GT(without.report.still_hidden, 10u);
  EXPECT_LT(highest(without.mesh.mesh), 1.3);

  const Made made = make(field, skin, 2);
  expect_on_surface(made.mesh, *field, 0.01);
  EXPECT_GE(made.report.fillings, 1);
  EXPECT_EQ(made.report.still_hidden, 0u);
  EXPECT_NEAR(highest(made.mesh.mesh), Thread::kTip, 0.01);
  const MeshPieces pieces = mesh_pieces(made.mesh.mesh);
  ASSERT_EQ(pieces.count(), 1u);
  EXPECT_EQ(pieces.euler[0], 2);
  // Far from the thread the mechanical vertices are there as they were; what is new has its attributes from nearby.
  const VertexTable& table = made.mesh.mesh.vertices;
  std::size_t kept = 0;
  for (std::size_t v = 0; v < table.size(); ++v) {
    EXPECT_NEAR(table.velocity[v].z, 5.0f, 1e-4f);
    EXPECT_LT(glm::length(table.rest[v]), 3.01f);
    if (table.id[v] >= skin.next_id) continue;
    ++kept;
    const Vec3& was = skin.position(table.id[v]);
    if (was.z < 0.0f || std::hypot(was.x, was.y) > 0.5f) {
      EXPECT_EQ(table.position[v], was);
    }
  }
  EXPECT_GT(kept, skin.vertex_count() * 9 / 10);
}

TEST(GeometricMesh, NothingIsFilledWhereTheRefinedMeshShowsTheField) {
  const auto field = std::make_shared<analytic::SphereField>();
  const TriangleMesh skin = test_meshes::icosphere(3);
  const Made made = make(field, skin, 2), without = make(field, skin, 0);
  expect_on_surface(made.mesh, *field, 1e-4);
  EXPECT_EQ(made.report.hidden, 0u);
  EXPECT_EQ(made.report.fillings, 0);
  EXPECT_EQ(made.mesh.mesh.vertex, without.mesh.mesh.vertex);
}

TEST(GeometricMesh, WhatMayStayCoarseIsNotFilled) {
  const double radius = kEdge / 1.0515;  // of an icosahedron with such edges
  const auto field = std::make_shared<analytic::SphereField>(DVec3(0.0), radius);
  TriangleMesh skin = test_meshes::icosphere(0);
  for (Vec3& p : skin.vertices.position) p *= float(radius);
  RefineOptions coarse;
  coarse.angle = 65.0f;  // 63.4 between its corners
  const Made made = make(field, skin, 2, coarse);
  EXPECT_EQ(made.report.hidden, 0u);
  EXPECT_EQ(made.mesh.mesh.triangle_count(), skin.triangle_count());
  coarse.sagitta = 0.01f;
  EXPECT_GT(make(field, skin, 2, coarse).mesh.mesh.triangle_count(), skin.triangle_count());
}

TEST(GeometricMesh, WhatIsFoldedIsSmoothedAndTheRestStays) {
  const auto field = std::make_shared<analytic::SphereField>();
  TriangleMesh skin = test_meshes::icosphere(3);
  const auto fold_over = [&](const Vec3& from, const Vec3& to) {
    for (Vec3& p : skin.vertices.position)
      if (glm::distance(p, from) < 0.2f) p = glm::normalize(p + to - from);
  };
  fold_over(Vec3(1, 0, 0), glm::normalize(Vec3(1.0f, 0.5f, 0.0f)));
  fold_over(Vec3(0, 0, -1), glm::normalize(Vec3(0.3f, 0.3f, -1.0f)));
  EXPECT_GT(count_self_intersections(skin), 10u);
  const GeometricMesh made = make(field, skin, 2).mesh;
  expect_on_surface(made, *field, 1e-4);
  EXPECT_EQ(count_self_intersections(made.mesh), 0u);
  EXPECT_NEAR(mesh_pieces(made.mesh).volume[0], 4.0 / 3.0 * 3.14159265358979, 0.05);
  const VertexTable& table = made.mesh.vertices;
  for (std::size_t v = 0; v < table.size(); ++v)
    if (table.id[v] < skin.next_id && skin.position(table.id[v]).y < -0.6f) {
      EXPECT_EQ(table.position[v], skin.position(table.id[v]));
    }
}

TEST(GeometricMesh, ADropletHasItsVolumeThoughItsMeshIsPressedFlat) {
  constexpr double kRadius = 0.3;
  const auto field = std::make_shared<analytic::SphereField>(DVec3(0.0), kRadius);
  TriangleMesh skin = test_meshes::icosphere(1);
  for (Vec3& p : skin.vertices.position) p = float(kRadius) * glm::normalize(Vec3(1.0f) + 0.3f * p);
  const double volume = 4.0 / 3.0 * 3.14159265358979 * std::pow(kRadius, 3.0);
  EXPECT_LT(mesh_pieces(make(field, skin, 0).mesh.mesh).volume[0], 0.5 * volume);
  const Made made = make(field, skin, 2);
  expect_on_surface(made.mesh, *field, 1e-3);
  const MeshPieces pieces = mesh_pieces(made.mesh.mesh);
  ASSERT_EQ(pieces.count(), 1u);
  EXPECT_EQ(pieces.euler[0], 2);
  EXPECT_NEAR(pieces.volume[0], volume, 0.05 * volume);
}

// Smoothing finds nothing beside it that would hold it.
TEST(GeometricMesh, ADropletFoldedAsAWholeIsFilledAnew) {
  const double radius = kEdge;
  const auto field = std::make_shared<analytic::SphereField>(DVec3(0.0), radius);
  TriangleMesh skin = test_meshes::icosphere(0);
  for (Vec3& p : skin.vertices.position) p *= float(radius);
  const Vec3 from = skin.position(skin.vertex[0]), to = skin.position(skin.vertex[1]);
  skin.vertices.position[skin.vertex[0]] = float(radius) * glm::normalize(from + 1.3f * (to - from));
  EXPECT_GT(count_self_intersections(make(field, skin, 0).mesh.mesh), 20u);
  const GeometricMesh made = make(field, skin, 2).mesh;
  expect_on_surface(made, *field, 1e-4);
  EXPECT_EQ(count_self_intersections(made.mesh), 0u);
  EXPECT_EQ(mesh_pieces(made.mesh).count(), 1u);
}

TEST(GeometricMesh, PiecesAtAPointAreLookedAtAndNoneIsSmoothedToOne) {
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(std::make_shared<analytic::SphereField>(DVec3(0.0), 1.0));
  TriangleMesh skin = test_meshes::icosphere(3);
  const Index first = Index(skin.vertex_count()), first_triangle = Index(skin.triangle_count());
  TriangleMesh lone = test_meshes::icosphere(0, 0.05f, Vec3(0.0f, 0.0f, 1.0f));
  for (Index& id : lone.vertices.id) id += skin.next_id;
  lone.next_id += skin.next_id;
  append(skin, lone);
  RefinedSkinOptions how;
  how.project.reach = 0.1f;
  RefinedSkin refined;
  refined.update(skin, nullptr, *backend, how);
  EXPECT_GT(refined.crossings(skin).size(), 0u);

  TriangleMesh smoothed = skin;
  Tangles(skin).smooth(smoothed, {{first_triangle, 0, first_triangle + 1, 0}}, *backend, how.project);
  EXPECT_EQ(smoothed.vertices.position, skin.vertices.position);
  Tangles(skin).smooth(smoothed, {{0, 0, 1, 0}}, *backend, how.project);
  EXPECT_NE(smoothed.vertices.position, skin.vertices.position);

  for (Index v = first; v < skin.vertex_count(); ++v) skin.vertices.position[v] = Vec3(0.0f, 0.0f, 1.0f);
  const FieldChanges none;
  refined.update(skin, &none, *backend, how);
  RefinedSkin whole;
  whole.update(skin, nullptr, *backend, how);
  EXPECT_EQ(refined.crossings(skin), whole.crossings(skin));
}
