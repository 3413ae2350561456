#include "render/shade.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "render/rasterize.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

const Camera kCamera{{0, -4, 1}, {0, 0, 0}, {0, 0, 1}, 34.0, 96, 72};

Image sphere(const Camera& camera = kCamera, Vec3 shift = Vec3(0)) {
  TriangleMesh mesh = test_meshes::icosphere(5);
  for (Vec3& p : mesh.vertices.position) p += shift;
  return rasterize(mesh, {}, camera, {.wire = true});
}

// A plane at depth 4 that fills the picture, facing the camera; columns from `step` on lie nearer.
Image plane(int step, float nearer) {
  const CameraRays rays = camera_rays(kCamera);
  Image image{kCamera.width, kCamera.height, {}};
  image.add("A", 1.0f);
  auto& z = image.add("Z");
  const DVec3 toward = -rays.forward;
  for (int axis = 0; axis < 3; ++axis) {
    image.add(std::string("N.") + "XYZ"[axis], static_cast<float>(toward[axis]));
    auto& p = image.add(std::string("P.") + "XYZ"[axis]);
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        const std::size_t pixel = static_cast<std::size_t>(y) * image.width + x;
        z[pixel] = x < step ? 4.0f : 4.0f - nearer;
        p[pixel] = static_cast<float>(rays.eye[axis] + z[pixel] * rays.direction(x, y)[axis]);
      }
    }
  }
  return image;
}

Vec3 color_at(const Image& image, int x, int y) {
  const std::size_t pixel = static_cast<std::size_t>(y) * image.width + x;
  return {image.at("R")[pixel], image.at("G")[pixel], image.at("B")[pixel]};
}

}  // namespace

TEST(Shade, ColoursWhatIsCoveredAndOnlyThat) {
  Image image = sphere();
  shade(image, kCamera);
  for (std::size_t pixel = 0; pixel < image.pixels(); ++pixel) {
    const float sum = image.at("R")[pixel] + image.at("G")[pixel] + image.at("B")[pixel];
    ASSERT_TRUE(std::isfinite(sum));
    ASSERT_EQ(sum > 0.0f, image.at("A")[pixel] > 0.0f);
  }
  // The key light comes from the upper left.
  EXPECT_GT(color_at(image, 40, 26).y, 1.5f * color_at(image, 56, 48).y);
}

TEST(Shade, ACheckerSticksToRestPositions) {
  const ShadeOptions options{.pattern = Pattern::checker, .pattern_size = 0.25, .occlusion = 0.0};
  Image here = sphere(), moved = here;
  for (float& x : moved.at("rest.X")) x += 0.25f;  // one square on: colours swap
  for (float& x : moved.at("rest.Y")) x += 0.25f;  // and back
  shade(here, kCamera, options);
  shade(moved, kCamera, options);
  std::size_t differ = 0;
  for (std::size_t pixel = 0; pixel < here.pixels(); ++pixel) differ += here.at("R")[pixel] != moved.at("R")[pixel];
  EXPECT_LT(differ, 20u);  // rounding at the squares' borders

  Camera with_it = kCamera;
  with_it.eye.x += 2.0;
  with_it.target.x += 2.0;
  Image elsewhere = sphere(with_it, {2, 0, 0});  // positions move, rest positions of the moved mesh do not
  shade(elsewhere, with_it, options);
  differ = 0;
  for (std::size_t pixel = 0; pixel < here.pixels(); ++pixel) {
    differ += std::abs(here.at("R")[pixel] - elsewhere.at("R")[pixel]) > 1e-3f;
  }
  EXPECT_LT(differ, 20u);
}

TEST(Shade, PatternsHaveBothColours) {
  for (const Pattern pattern : {Pattern::checker, Pattern::noise}) {
    Image image = plane(1000, 0.0f);
    shade(image, kCamera,
          {.pattern = pattern, .pattern_size = 0.2, .color = {1, 0, 0}, .second = {0, 1, 0}, .occlusion = 0.0});
    const auto [low, high] = std::minmax_element(image.at("R").begin(), image.at("R").end());
    EXPECT_LT(*low, 0.3f * *high);
  }
}

TEST(Shade, TheBackIsRed) {
  TriangleMesh mesh = test_meshes::icosphere(5);
  Image front = rasterize(mesh, {}, kCamera);
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) std::swap(mesh.vertex[3 * t], mesh.vertex[3 * t + 1]);
  Image back = rasterize(mesh, {}, kCamera);
  shade(front, kCamera);
  shade(back, kCamera);
  EXPECT_GT(color_at(front, 48, 36).z, color_at(front, 48, 36).x);
  EXPECT_GT(color_at(back, 48, 36).x, 2.0f * color_at(back, 48, 36).z);
}

TEST(Shade, LinesAreDrawnWhereTheWireIsNear) {
  Image image = plane(1000, 0.0f);
  auto& wire = image.add("wire", 10.0f);
  wire[36 * 96 + 48] = 0.2f;
  shade(image, kCamera, {.wire_width = 1.5, .occlusion = 0.0});
  EXPECT_LT(color_at(image, 48, 36).y, 0.4f * color_at(image, 50, 36).y);
  image.channel.erase("wire");
  EXPECT_THROW(shade(image, kCamera, {.wire_width = 1.5}), InputError);
}

TEST(Shade, CornersAreDarkerThanOpenPlanes) {
  Image corner = plane(48, 0.1f), open = plane(1000, 0.0f);
  shade(corner, kCamera);
  shade(open, kCamera);
  EXPECT_LT(color_at(corner, 47, 36).y, 0.9f * color_at(open, 47, 36).y);
  EXPECT_NEAR(color_at(corner, 10, 36).y, color_at(open, 10, 36).y, 1e-6);
}

TEST(Shade, WrongInputIsRefused) {
  Image image = sphere();
  Camera other = kCamera;
  other.width = 50;
  EXPECT_THROW(shade(image, other), std::invalid_argument);
  image.channel.erase("P.Y");
  EXPECT_THROW(shade(image, kCamera), InputError);
}
