#include "core/topology/surgery.h"

#include <array>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/mesh/validate.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/mesh_probe.h"
#include "tests/random_rotation.h"
#include "tests/sanitized.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

using Operation = SurgeryReport (*)(TriangleMesh&, const SurgerySite&, const Field&, const SurgeryOptions&);

SkeletonElement ball(const DVec3& center, double radius, double weight = 1.0) {
  SkeletonElement e;
  e.a = e.b = center;
  e.radius = radius;
  e.weight = weight;
  return e;
}

int euler_of(const TriangleMesh& mesh) {
  return int(mesh.vertex_count()) - int(mesh.triangle_count()) / 2;
}

TriangleMesh mesh_of(const SkeletonField& field, double spacing) {
  auto backend = make_reference_backend();
  const auto shared = std::make_shared<SkeletonField>(field);
  backend->set_field(shared);
  const BrickLattice lattice = sample_lattice(*shared, *backend, spacing);
  return marching_cubes(lattice, lattice_topology(lattice));
}

/// One operation: elements, the critical point's place, and the level (iso) before and after.
struct Scene {
  const char* name;
  Operation operation;
  std::vector<SkeletonElement> elements;
  double gap;  // F at the critical point after, minus before: its sign says which way it crosses zero
  CriticalKind kind;
  int euler_change;
  int pieces_change;  // of the mesh
  int euler_before;
};

std::vector<Scene> scenes(double gap) {
  const std::vector<SkeletonElement> pair{ball({-0.7, 0, 0}, 1.0), ball({0.7, 0, 0}, 1.0)};
  // A ball with a dent from both sides: a membrane in between, or a hole.
  const std::vector<SkeletonElement> dented{ball({0, 0, 0}, 4.0), ball({0, 0, 0.7}, 1.0, -0.7),
                                            ball({0, 0, -0.7}, 1.0, -0.7)};
  const std::vector<SkeletonElement> blob{ball({0, 0, 0}, 1.0), ball({0.3, 0.1, 0}, 0.8)};
  const std::vector<SkeletonElement> hollow{ball({0, 0, 0}, 2.0), ball({0.05, 0, 0}, 1.0, -0.6)};
  return {{"create_component", create_component, blob, gap, CriticalKind::maximum, 2, 1, 0},
          {"destroy_component", destroy_component, blob, -gap, CriticalKind::maximum, -2, -1, 2},
          {"connect", connect, pair, gap, CriticalKind::two_saddle, -2, -1, 4},
          {"cut", cut, pair, -gap, CriticalKind::two_saddle, 2, 1, 2},
          {"spackle", spackle, dented, gap, CriticalKind::one_saddle, 2, 0, 0},
          {"pierce", pierce, dented, -gap, CriticalKind::one_saddle, -2, 0, 2},
          {"burst_bubble", burst_bubble, hollow, gap, CriticalKind::minimum, -2, -1, 4},
          {"open_bubble", open_bubble, hollow, -gap, CriticalKind::minimum, 2, 1, 2}};
}

struct Staged {
  SkeletonField before, after;
  SurgerySite site;
};

Staged stage(const Scene& scene, const DMat3& turn, const DVec3& shift) {
  std::vector<SkeletonElement> elements = scene.elements;
  for (SkeletonElement& e : elements) e.a = e.b = turn * e.a + shift;
  CriticalOptions options;
  DVec3 seed = shift;
  if (scene.kind == CriticalKind::maximum) seed += turn * DVec3(0.1, 0, 0);
  const auto point = refine_critical_point(SkeletonField(elements, 0.0), seed, options);
  EXPECT_TRUE(point && point->kind == scene.kind) << scene.name;
  const double level = point->value;
  SurgerySite site{*point, *point};
  site.before.value = -scene.gap;
  site.after.value = scene.gap;
  return {SkeletonField(elements, level + scene.gap), SkeletonField(elements, level - scene.gap), site};
}

bool same(const TriangleMesh& a, const TriangleMesh& b) {
  return a.vertex == b.vertex && a.twin == b.twin && a.vertices.position == b.vertices.position &&
         a.vertices.id == b.vertices.id && a.next_id == b.next_id;
}

void expect_attributes_carried(const TriangleMesh& old, const TriangleMesh& now) {
  std::map<Index, Index> row;
  for (Index v = 0; v < old.vertex_count(); ++v) row[old.vertices.id[v]] = v;
  Box rest;
  for (const Vec3& r : old.vertices.rest) rest.add(DVec3(r));
  for (Index v = 0; v < now.vertex_count(); ++v) {
    const auto at = row.find(now.vertices.id[v]);
    if (at == row.end()) {
      EXPECT_GE(now.vertices.id[v], old.next_id);
      EXPECT_EQ(now.vertices.age[v], 1u);
      continue;
    }
    EXPECT_EQ(now.position(v), old.position(at->second));
    EXPECT_EQ(now.vertices.rest[v], old.vertices.rest[at->second]);
    EXPECT_EQ(now.vertices.velocity[v], old.vertices.velocity[at->second]);
  }
}

/// Vertices that went or came are no farther from the critical point than a few edges and the size of the new feature.
void expect_a_small_neighbourhood(const TriangleMesh& old, const TriangleMesh& now, const Scene& scene,
                                  const CriticalPoint& at, double spacing) {
  if (scene.kind == CriticalKind::maximum || scene.kind == CriticalKind::minimum) return;  // the whole piece
  const DVec3 size = glm::abs(at.hessian.values);
  const double feature = std::sqrt(2.0 * std::abs(scene.gap) / std::min({size.x, size.y, size.z}));
  const double wide = 4.0 * spacing + 2.0 * feature;
  const std::set<Index> before(old.vertices.id.begin(), old.vertices.id.end());
  const std::set<Index> after(now.vertices.id.begin(), now.vertices.id.end());
  for (Index v = 0; v < old.vertex_count(); ++v) {
    if (after.count(old.vertices.id[v])) continue;
    EXPECT_LT(glm::distance(DVec3(old.position(v)), at.position), wide);
  }
  for (Index v = 0; v < now.vertex_count(); ++v) {
    if (before.count(now.vertices.id[v])) continue;
    EXPECT_LT(glm::distance(DVec3(now.position(v)), at.position), wide);
  }
}

class EightOperations : public testing::TestWithParam<int> {};

TEST_P(EightOperations, change_the_topology_once_in_every_rotation) {
  std::mt19937 random(7);
  int done = 0, asked = 0;
  for (const double gap : {0.003, 0.02, 0.06})
    for (const double spacing : {0.06, 0.1, 0.17})
      for (int turn = 0; turn < 8; ++turn) {
        const Scene scene = scenes(gap)[GetParam()];
        SCOPED_TRACE(testing::Message() << scene.name << " gap " << gap << " spacing " << spacing << " turn " << turn);
        const DMat3 rotation = turn == 0 ? DMat3(1.0) : test::random_rotation(random);
        const Staged staged = stage(scene, rotation, turn == 0 ? DVec3(0.0) : DVec3(0.31, 0.17, -0.23));
        TriangleMesh mesh = mesh_of(staged.before, spacing);
        for (Index v = 0; v < mesh.vertex_count(); ++v) {
          mesh.vertices.age[v] = 5;
          mesh.vertices.velocity[v] = Vec3(1.0f, 2.0f, float(v));
        }
        const TriangleMesh old = mesh;
        SurgeryOptions options;
        options.edge_length = spacing;
        const SurgeryReport report = scene.operation(mesh, staged.site, staged.after, options);
        // A lattice as coarse as the feature itself may not have seen what is to be operated on.
        const MeshPieces before = mesh_pieces(old);
        const bool resolved = euler_of(old) == scene.euler_before;
        ++asked;
        done += report.done;
        if (!resolved) {
          EXPECT_TRUE(report.done || same(mesh, old));
          continue;
        }
        ASSERT_TRUE(report.done) << report.reason;
        ASSERT_TRUE(validate(mesh)) << validate(mesh).reason;
        EXPECT_EQ(euler_of(mesh) - euler_of(old), scene.euler_change);
        EXPECT_EQ(int(mesh_pieces(mesh).count()) - int(before.count()), scene.pieces_change);
        EXPECT_EQ(mesh.triangle_count() + report.triangles_removed, old.triangle_count() + report.triangles_added);
        expect_attributes_carried(old, mesh);
        expect_a_small_neighbourhood(old, mesh, scene, staged.site.after, spacing);
      }
  EXPECT_GE(2 * done, asked);
}

INSTANTIATE_TEST_SUITE_P(Surgery, EightOperations, testing::Range(0, 8),
                         [](const auto& which) { return std::string(scenes(0.1)[which.param].name); });

TEST(Surgery, there_and_back_again) {
  // Each operation undone by its opposite, on the mesh the first one made.
  const std::pair<int, int> pairs[] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}};
  std::mt19937 random(11);
  for (const auto& [there, back] : pairs)
    for (int turn = 0; turn < 10; ++turn) {
      const double gap = 0.03;
      const DMat3 rotation = test::random_rotation(random);
      const Staged first = stage(scenes(gap)[there], rotation, DVec3(0.1));
      const Staged second = stage(scenes(gap)[back], rotation, DVec3(0.1));
      TriangleMesh mesh = mesh_of(first.before, 0.06);
      const int euler = euler_of(mesh);
      SurgeryOptions options;
      options.edge_length = 0.06;
      const SurgeryReport did = scenes(gap)[there].operation(mesh, first.site, first.after, options);
      ASSERT_TRUE(did.done) << scenes(gap)[there].name << ": " << did.reason;
      const SurgeryReport undid = scenes(gap)[back].operation(mesh, second.site, second.after, options);
      ASSERT_TRUE(undid.done) << scenes(gap)[back].name << ": " << undid.reason;
      EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
      EXPECT_EQ(euler_of(mesh), euler);
    }
}

TEST(Surgery, new_vertices_lie_on_the_surface) {
  for (const int which : {0, 2, 3, 4, 5, 7}) {
    const Staged staged = stage(scenes(0.04)[which], DMat3(1.0), DVec3(0.013, 0.021, 0.034));
    TriangleMesh mesh = mesh_of(staged.before, 0.06);
    const Index first_new = mesh.next_id;
    SurgeryOptions options;
    options.edge_length = 0.06;
    ASSERT_TRUE(scenes(0.04)[which].operation(mesh, staged.site, staged.after, options).done);
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      if (mesh.vertices.id[v] < first_new) continue;
      EXPECT_LT(staged.after.distance_estimate(DVec3(mesh.position(v))), 1e-4) << scenes(0.04)[which].name;
    }
  }
}

TEST(Surgery, refusals_leave_the_mesh_as_it_was) {
  const TriangleMesh torus = test_meshes::torus(24, 12);
  const SkeletonField field({ball({0, 0, 0}, 1.0)}, 0.3);
  SurgeryOptions options;
  options.edge_length = 0.25;
  options.reach = 4.0;
  CriticalPoint far;
  far.position = DVec3(30.0, 0.0, 0.0);
  CriticalPoint in_tube;
  in_tube.position = DVec3(1.0, 0.0, 0.0);
  for (const Scene& scene : scenes(0.01)) {
    TriangleMesh mesh = torus;
    const SurgeryReport report = scene.operation(mesh, {far, far}, field, options);
    EXPECT_FALSE(report.done) << scene.name;
    EXPECT_FALSE(report.reason.empty());
    EXPECT_TRUE(same(mesh, torus)) << scene.name;
  }
  TriangleMesh mesh = torus;
  const SurgeryReport report = destroy_component(mesh, {in_tube, in_tube}, field, options);
  EXPECT_FALSE(report.done);
  EXPECT_NE(report.reason.find("not a sphere"), std::string::npos) << report.reason;
  EXPECT_TRUE(same(mesh, torus));
}

/// Anything at all: random meshes, points and axes. An operation does it right or not at all.
TEST(Surgery, right_or_not_at_all) {
  std::array<int, 8> done{};
  int collars = 0;  // cuts whose borders had to be given vertices of their own
  for (unsigned seed = 0; seed < unsigned(test::repeats(1500, 900)); ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    TriangleMesh mesh;
    switch (seed % 4) {
      case 0:
        mesh = test_meshes::torus(3 + int(random() % 9), 3 + int(random() % 6));
        break;
      case 1:
        mesh = test_meshes::icosphere(int(random() % 3));
        break;
      case 2:
        mesh = test_meshes::cube(1 + int(random() % 4));
        break;
      default:
        mesh = test_meshes::tetrahedron();
        TriangleMesh other = test_meshes::icosphere(1, 0.7f, Vec3(0.9f, 0.2f, 0.1f));
        for (Index& id : other.vertices.id) id += mesh.next_id;
        other.next_id += mesh.next_id;
        append(mesh, other);
    }
    test_meshes::jitter(mesh, float(0.15 * (1.0 + unit(random))), seed + 1);
    const SkeletonField field({ball({unit(random), unit(random), unit(random)}, 1.0)}, 0.3);
    const auto anywhere = [&] {
      CriticalPoint point;
      const double x = unit(random), y = unit(random), z = unit(random);
      point.position = 1.2 * DVec3(x, y, z);
      point.hessian.vectors = test::random_rotation(random);
      return point;
    };
    const SurgerySite site{anywhere(), anywhere()};
    SurgeryOptions options;
    options.edge_length = 0.3;
    const std::vector<Scene> all = scenes(0.01);
    for (std::size_t i = 0; i < all.size(); ++i) {
      TriangleMesh changed = mesh;
      const SurgeryReport report = all[i].operation(changed, site, field, options);
      done[i] += report.done;
      if (!report.done) {
        ASSERT_TRUE(same(changed, mesh)) << all[i].name;
        ASSERT_FALSE(report.reason.empty());
        ASSERT_NE(report.reason, "the new triangles do not fit") << all[i].name;
        continue;
      }
      ASSERT_TRUE(validate(changed)) << all[i].name << ": " << validate(changed).reason;
      ASSERT_EQ(euler_of(changed) - euler_of(mesh), all[i].euler_change) << all[i].name;
      collars += (i == 3 || i == 4) && report.vertices_added > 2;
    }
  }
  // No random mesh has a cavity to burst, and no ball is a bubble.
  for (std::size_t i = 0; i < 6; ++i) EXPECT_GT(done[i], 0) << scenes(0.01)[i].name;
  EXPECT_GT(collars, 0);
}

TEST(GrowDisc, always_has_a_simple_border) {
  for (unsigned seed = 0; seed < 40; ++seed) {
    TriangleMesh mesh = seed % 2 ? test_meshes::torus(9, 5) : test_meshes::icosphere(2);
    test_meshes::jitter(mesh, 0.1f, seed);
    const Index start = Index(seed * 7 % mesh.triangle_count());
    const DVec3 at(mesh.position(mesh.vertex[3 * start]));
    const std::vector<Index> disc = grow_disc(mesh, {start}, [&](Index t) {
      return glm::distance(DVec3(mesh.position(mesh.vertex[3 * t])), at) < 0.2 + 0.05 * seed;
    });
    const std::vector<Index> border = disc_border(mesh, disc);
    std::set<Index> corners, all;
    for (const Index h : border) corners.insert(mesh.from(h));
    for (const Index t : disc)
      for (Index k = 0; k < 3; ++k) all.insert(mesh.vertex[3 * t + k]);
    EXPECT_EQ(corners.size(), border.size());
    // A disc: V - E + F = 1 with E = (3 F + border) / 2.
    EXPECT_EQ(2 * all.size() + 2 * disc.size(), 2 + 3 * disc.size() + border.size());
  }
}

}  // namespace
}  // namespace isoskin
