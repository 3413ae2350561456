// The skin round a tube is found however crumpled it is.
#include "core/topology/annulus.h"

#include <gtest/gtest.h>

#include "core/counter_random.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

const DVec3 kMiddle(1.0, 0.0, 0.0), kAlong(0.0, 1.0, 0.0);  // of the torus's tube at one place

TriangleMesh crumpled_torus(unsigned seed) {
  TriangleMesh torus = test_meshes::torus(48, 24);
  for (Index v = 0; v < torus.vertex_count(); ++v) {
    Vec3& p = torus.vertices.position[v];
    if (glm::distance(DVec3(p), kMiddle) < 0.45) p += 0.3f * Vec3(counter_point(seed, v) - 0.5);
  }
  return torus;
}

TEST(Annulus, goes_round_a_crumpled_tube) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const TriangleMesh torus = crumpled_torus(seed);
    const auto annulus = annulus_about(torus, {kMiddle, kAlong}, 1, {0.2, 0.8});
    ASSERT_TRUE(annulus) << seed;
    for (const int side : {0, 1}) {
      const std::vector<Index>& border = annulus->border[std::size_t(side)];
      for (std::size_t k = 0; k < border.size(); ++k) {
        EXPECT_EQ(torus.to(border[k]), torus.from(border[(k + 1) % border.size()]));
        EXPECT_EQ(torus.position(torus.from(border[k])).y > 0.0f, side == 0);
      }
    }
  }
}

TEST(Annulus, neither_a_disc_nor_what_encloses_the_other_side_nor_what_is_far) {
  const TriangleMesh torus = test_meshes::torus(48, 24);
  EXPECT_FALSE(annulus_about(torus, {kMiddle, kAlong}, -1, {0.8}));
  EXPECT_FALSE(annulus_about(torus, {DVec3(1.4, 0.0, 0.0), DVec3(1.0, 0.0, 0.0)}, 1, {0.3}));
  EXPECT_FALSE(annulus_about(torus, {kMiddle, kAlong}, 1, {0.2}));
  EXPECT_FALSE(annulus_about(torus, {DVec3(0.0), DVec3(0.0, 0.0, 1.0)}, 1, {0.5}));
}

}  // namespace
}  // namespace isoskin
