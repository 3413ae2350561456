// Skin that overlaps is smoothed out along the surface.
#include "core/refine/untangle.h"

#include <gtest/gtest.h>

#include "core/mesh/validate.h"
#include "core/topology/triangle_pairs.h"
#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

struct Folded {
  TriangleMesh sphere = test_meshes::icosphere(3), skin = sphere;
  std::unique_ptr<Backend> backend = make_reference_backend();
  ProjectOptions project;

  Folded() {
    backend->set_field(std::make_shared<analytic::SphereField>(DVec3(0.0), 1.0));
    project.max_step = 0.1f;
    const Index a = skin.from(0), b = skin.to(skin.next(skin.twin[skin.next(0)]));
    std::swap(skin.vertices.position[a], skin.vertices.position[b]);
  }
};

TEST(Unfold, overlaps_go_and_the_skin_stays_on_the_surface) {
  Folded it;
  ASSERT_GT(count_self_intersections(it.skin), 0u);
  EXPECT_TRUE(unfold(it.skin, {}, *it.backend, it.project));
  EXPECT_EQ(count_self_intersections(it.skin), 0u);
  EXPECT_TRUE(validate(it.skin));
  EXPECT_EQ(it.skin.vertex, it.sphere.vertex);
  for (const Vec3& p : it.skin.vertices.position) EXPECT_NEAR(glm::length(p), 1.0f, 1e-3f);
}

TEST(Unfold, only_what_is_open_is_looked_at) {
  Folded it;
  const std::vector<Vec3> before = it.skin.vertices.position;
  std::vector<std::uint8_t> frozen(it.skin.vertex_count(), 1);
  frozen.back() = 0;
  EXPECT_FALSE(unfold(it.skin, OpenSet(it.skin, frozen), *it.backend, it.project));
  EXPECT_EQ(it.skin.vertices.position, before);
  for (Index h = 0; h < 60; ++h) frozen[it.skin.vertex[h]] = 0;
  EXPECT_TRUE(unfold(it.skin, OpenSet(it.skin, frozen), *it.backend, it.project));
  EXPECT_EQ(count_self_intersections(it.skin), 0u);
}

TEST(Unfold, a_skin_without_overlaps_stays_as_it_is) {
  Folded it;
  const std::vector<Vec3> before = it.sphere.vertices.position;
  EXPECT_FALSE(unfold(it.sphere, {}, *it.backend, it.project));
  EXPECT_EQ(it.sphere.vertices.position, before);
}

TEST(Tangles, what_hides_a_place_is_taken_back) {
  Folded it;
  const std::vector<Vec3> before = it.skin.vertices.position;
  const std::vector<Crossing> overlap{{0, 0, it.skin.twin[0] / 3, 0}};
  const Vec3 there = it.skin.position(it.skin.from(0));
  constexpr double kReach = 0.05;
  for (const auto& [place, hides] : {std::pair(there, true), std::pair(-there, false)}) {
    Tangles tangles(it.skin);
    ASSERT_TRUE(tangles.smooth(it.skin, overlap, *it.backend, it.project));
    ASSERT_NE(it.skin.vertices.position, before);
    EXPECT_EQ(tangles.take_back(it.skin, {}, {place}, kReach).size(), hides ? 1u : 0u);
    EXPECT_EQ(tangles.took_back(), hides);
    EXPECT_EQ(it.skin.vertices.position == before, hides);
  }
}

}  // namespace
}  // namespace isoskin
