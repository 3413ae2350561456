#include "render/shadow.h"

#include <gtest/gtest.h>

#include <cmath>

#include "render/lights.h"
#include "render/rasterize.h"
#include "render/shade.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

// A ball that floats above the middle of a large square.
constexpr float kBallRadius = 0.5f;
const Vec3 kBall(0.0f, 0.0f, 1.2f);

TriangleMesh ball_above_floor() {
  TriangleMesh mesh = test_meshes::icosphere(5, kBallRadius, kBall);
  const Index first = static_cast<Index>(mesh.vertex_count());
  for (const Vec3 corner : {Vec3(-4, -4, 0), Vec3(4, -4, 0), Vec3(4, 4, 0), Vec3(-4, 4, 0)}) {
    mesh.vertices.position.push_back(corner);
    mesh.vertices.rest.push_back(corner);
  }
  for (const Index i : {0u, 1u, 2u, 0u, 2u, 3u}) mesh.vertex.push_back(first + i);
  return mesh;
}

const Camera kCamera{{-2, -5, 4}, {0, 0, 0.4}, {0, 0, 1}, 34.0, 160, 120};

}  // namespace

TEST(Shadow, TheFloorLosesTheLightThatTheBallHides) {
  const TriangleMesh mesh = ball_above_floor();
  Image image = rasterize(mesh, {}, kCamera);
  const ShadowOptions options;
  add_shadows(image, mesh, kCamera, options);
  const DVec3 key(key_light(camera_rays(kCamera)));
  const VectorChannels position(image, "P");
  const double spread = std::tan(options.softness * std::acos(-1.0) / 180.0);
  std::size_t dark = 0, light = 0;
  for (std::size_t pixel = 0; pixel < image.pixels(); ++pixel) {
    const DVec3 p(position[pixel]);
    if (image.at("A")[pixel] == 0.0f || p.z > 1e-3) continue;
    const DVec3 to_ball = DVec3(kBall) - p;
    const double along = glm::dot(to_ball, key), beside = glm::length(to_ball - along * key);
    const double blur = spread * along + 0.01;  // and the ball's triangles
    if (beside < kBallRadius - blur) {
      ASSERT_EQ(image.at("shadow")[pixel], 1.0f);
      ++dark;
    } else if (along < 0.0 || beside > kBallRadius + blur) {
      ASSERT_EQ(image.at("shadow")[pixel], 0.0f);
      ++light;
    }
  }
  EXPECT_GT(dark, 100u);
  EXPECT_GT(light, 1000u);
}

TEST(Shadow, ShadedPicturesAreDarkerThere) {
  const TriangleMesh mesh = ball_above_floor();
  Image without = rasterize(mesh, {}, kCamera);
  Image with = without;
  add_shadows(with, mesh, kCamera);
  shade(without, kCamera);
  shade(with, kCamera);
  for (std::size_t pixel = 0; pixel < with.pixels(); ++pixel) {
    ASSERT_LE(with.at("G")[pixel], without.at("G")[pixel]);
    if (with.at("shadow")[pixel] == 1.0f && with.at("P.Z")[pixel] < 1e-3f) {
      ASSERT_LT(with.at("G")[pixel], 0.7f * without.at("G")[pixel]);
    }
  }
}

TEST(Shadow, WrongSizesAreRefused) {
  Image image = rasterize(ball_above_floor(), {}, kCamera);
  Camera other = kCamera;
  other.height = 10;
  EXPECT_THROW(add_shadows(image, ball_above_floor(), other), std::invalid_argument);
}
