// Borders of sets of triangles, and sheets joined along them: on spheres, through a sphere, and with random discs.
#include "core/topology/blend.h"

#include <map>
#include <random>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/mesh/validate.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

int euler_of(const TriangleMesh& mesh) {
  return int(mesh.vertex_count()) - int(mesh.triangle_count()) / 2;
}

Vec3 middle(const TriangleMesh& mesh, Index t) {
  return (mesh.position(mesh.vertex[3 * t]) + mesh.position(mesh.vertex[3 * t + 1]) +
          mesh.position(mesh.vertex[3 * t + 2])) /
         3.0f;
}

/// Triangles [first, last) that look along `axis` from `center` within an angle; at least one triangle's fan.
std::vector<Index> cap_of(const TriangleMesh& mesh, Index first, Index last, const Vec3& center, const Vec3& axis,
                          float angle) {
  std::vector<Index> cap;
  Index nearest = first;
  const auto cosine = [&](Index t) { return glm::dot(glm::normalize(middle(mesh, t) - center), axis); };
  for (Index t = first; t < last; ++t) {
    if (cosine(t) > cosine(nearest)) nearest = t;
    if (cosine(t) > std::cos(angle)) cap.push_back(t);
  }
  if (cap.empty()) cap.push_back(nearest);
  return with_neighbours(mesh, cap);
}

struct Pair {
  TriangleMesh mesh;
  std::vector<Index> a, b;
};

/// Two spheres of different fineness with discs that face each other.
Pair facing_spheres(int level_a, int level_b, float angle_a, float angle_b, const Vec3& axis, float jitter,
                    unsigned seed) {
  Pair pair;
  pair.mesh = test_meshes::icosphere(level_a);
  const Index count = Index(pair.mesh.triangle_count());
  TriangleMesh other = test_meshes::icosphere(level_b, 1.0f, 2.2f * axis);
  for (Index& id : other.vertices.id) id += pair.mesh.next_id;
  other.next_id += pair.mesh.next_id;
  append(pair.mesh, other);
  test_meshes::jitter(pair.mesh, jitter, seed);
  pair.a = cap_of(pair.mesh, 0, count, Vec3(0.0f), axis, angle_a);
  pair.b = cap_of(pair.mesh, count, Index(pair.mesh.triangle_count()), 2.2f * axis, -axis, angle_b);
  return pair;
}

}  // namespace

TEST(Blend, FindsBordersInOrder) {
  const TriangleMesh mesh = test_meshes::icosphere(3);
  const std::vector<Index> disc = with_neighbours(mesh, {7});
  const auto borders = find_borders(mesh, disc);
  ASSERT_EQ(borders.size(), 1u);
  EXPECT_EQ(euler_of(mesh, disc), 1);
  for (std::size_t i = 0; i < borders[0].size(); ++i) {
    EXPECT_EQ(mesh.to(borders[0][i]), mesh.from(borders[0][(i + 1) % borders[0].size()]));
    EXPECT_GE(borders[0][i], borders[0][0]);
  }
  std::vector<Index> band;
  for (Index t = 0; t < mesh.triangle_count(); ++t)
    if (std::abs(middle(mesh, t).z) < 0.3f) band.push_back(t);
  EXPECT_EQ(find_borders(mesh, band).size(), 2u);
  EXPECT_EQ(euler_of(mesh, band), 0);
  // Two triangles that share a vertex and no edge: the border touches itself.
  const Index h = mesh.twin[mesh.twin[0] / 3 * 3 + (mesh.twin[0] + 1) % 3];
  Index far = 0;
  for (Index k = mesh.turn(0), steps = 0; steps < 2; k = mesh.turn(k), ++steps) far = k / 3;
  EXPECT_TRUE(find_borders(mesh, {0, far}).empty()) << h;
}

TEST(Blend, JoinsTwoSpheresIntoOne) {
  const Pair pair = facing_spheres(3, 3, 0.3f, 0.5f, Vec3(1, 0, 0), 0.0f, 1);
  const PlannedPatch planned = plan_blend(pair.mesh, pair.a, pair.b);
  ASSERT_TRUE(planned.patch) << planned.reason;
  TriangleMesh mesh = pair.mesh;
  ASSERT_TRUE(planned.patch->apply(mesh));
  const ValidateReport valid = validate(mesh);
  EXPECT_TRUE(valid) << valid.reason;
  EXPECT_EQ(euler_of(mesh), euler_of(pair.mesh) - 2);
  EXPECT_EQ(mesh_pieces(mesh).count(), 1u);
  EXPECT_EQ(mesh.next_id, pair.mesh.next_id);  // nothing is new: the borders are welded
  std::map<Index, Index> row;
  for (Index v = 0; v < pair.mesh.vertex_count(); ++v) row[pair.mesh.vertices.id[v]] = v;
  std::size_t moved = 0;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    ASSERT_TRUE(row.count(mesh.vertices.id[v]));
    const Index before = row[mesh.vertices.id[v]];
    if (mesh.position(v) == pair.mesh.position(before)) continue;
    ++moved;
    EXPECT_NEAR(mesh.position(v).x, 1.1f, 0.1f);  // in the middle between the borders
    EXPECT_EQ(mesh.vertices.age[v], 1u);
    EXPECT_NEAR(mesh.vertices.rest[v].x, 1.1f, 0.1f);
  }
  EXPECT_EQ(moved, std::min(find_borders(pair.mesh, pair.a)[0].size(), find_borders(pair.mesh, pair.b)[0].size()));
}

TEST(Blend, PiercesASphere) {
  const TriangleMesh before = test_meshes::icosphere(3);
  const Index count = Index(before.triangle_count());
  const auto top = cap_of(before, 0, count, Vec3(0.0f), Vec3(0, 0, 1), 0.4f);
  const auto bottom = cap_of(before, 0, count, Vec3(0.0f), Vec3(0, 0, -1), 0.3f);
  TriangleMesh mesh = before;
  const PlannedPatch planned = plan_blend(mesh, top, bottom);
  ASSERT_TRUE(planned.patch) << planned.reason;
  ASSERT_TRUE(planned.patch->apply(mesh));
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  EXPECT_EQ(euler_of(mesh), 0);
}

TEST(Blend, TwistsLeast) {
  // Equal borders, one turned by 40 degrees: no welded vertex comes from farther than half an edge about the axis.
  const Pair pair = facing_spheres(3, 3, 0.4f, 0.4f, glm::normalize(Vec3(1, 0.4f, 0.2f)), 0.0f, 1);
  TriangleMesh mesh = pair.mesh;
  const PlannedPatch planned = plan_blend(mesh, pair.a, pair.b);
  ASSERT_TRUE(planned.patch) << planned.reason;
  ASSERT_TRUE(planned.patch->apply(mesh));
  double longest = 0.0;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    longest = std::max(longest, double(glm::distance(mesh.position(mesh.from(h)), mesh.position(mesh.to(h)))));
  EXPECT_LT(longest, 0.5);  // edges are 0.15, the gap between the borders about 0.4
}

TEST(Blend, RefusesWhatIsNoDisc) {
  const Pair pair = facing_spheres(2, 2, 0.4f, 0.4f, Vec3(1, 0, 0), 0.0f, 1);
  std::vector<Index> all(pair.mesh.triangle_count() / 2);
  for (Index t = 0; t < all.size(); ++t) all[t] = t;
  EXPECT_FALSE(plan_blend(pair.mesh, all, pair.b).patch);
  EXPECT_FALSE(plan_blend(pair.mesh, pair.a, pair.a).patch);
  EXPECT_FALSE(plan_blend(pair.mesh, {pair.a[0]}, with_neighbours(pair.mesh, {pair.a[0]})).patch);
}

struct RandomPair {
  Pair pair;
  float angle_a, angle_b;
};

RandomPair random_pair(unsigned seed, int level_a, int level_b) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> angle(0.1f, 1.0f);
  const float x = normal(random), y = normal(random), z = normal(random);
  const Vec3 axis = glm::normalize(Vec3(x, y, z + 1e-3f));
  const float angle_a = angle(random), angle_b = angle(random);
  return {facing_spheres(level_a, level_b, angle_a, angle_b, axis, 0.02f, seed), angle_a, angle_b};
}

// Borders of 18 and 17 vertices, of which the least twisted weld would double an edge.
TEST(Blend, TakesTheNextRotation) {
  const Pair pair = random_pair(3209, 2, 2).pair;
  TriangleMesh mesh = pair.mesh;
  const PlannedPatch planned = plan_blend(mesh, pair.a, pair.b);
  ASSERT_TRUE(planned.patch) << planned.reason;
  ASSERT_TRUE(planned.patch->apply(mesh));
  EXPECT_EQ(validate(mesh).reason, "");
  EXPECT_EQ(euler_of(mesh), euler_of(pair.mesh) - 2);
}

RC_GTEST_PROP(Blend, RandomDiscsOfRandomSpheres, ()) {
  const unsigned seed = *rc::gen::arbitrary<unsigned>();
  const int level_a = *rc::gen::inRange(2, 4), level_b = *rc::gen::inRange(2, 4);
  const auto [pair, angle_a, angle_b] = random_pair(seed, level_a, level_b);
  if (find_borders(pair.mesh, pair.a).size() != 1 || find_borders(pair.mesh, pair.b).size() != 1) return;
  TriangleMesh mesh = pair.mesh;
  const PlannedPatch planned = plan_blend(mesh, pair.a, pair.b);
  if (!planned.patch) {  // equalising very different borders may double an edge
    RC_ASSERT(!planned.reason.empty());
    RC_ASSERT(level_a != level_b || std::abs(angle_a - angle_b) > 0.05f);
    return;
  }
  RC_ASSERT(planned.patch->apply(mesh));
  RC_ASSERT(validate(mesh).reason == "");
  RC_ASSERT(euler_of(mesh) == euler_of(pair.mesh) - 2);
}

}  // namespace isoskin
