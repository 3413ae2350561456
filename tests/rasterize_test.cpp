#include "render/rasterize.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <thread>

#include "render/gl_context.h"
#include "render/perlin.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

constexpr double kRadian = 180.0 / 3.14159265358979323846;

// An open mesh of separate triangles, three fresh vertices each.
TriangleMesh triangles(const std::vector<Vec3>& corners) {
  TriangleMesh mesh;
  mesh.vertices.resize(corners.size());
  mesh.vertices.position = corners;
  for (Index v = 0; v < corners.size(); ++v) {
    mesh.vertex.push_back(v);
    mesh.vertices.rest[v] = Vec3(2.0f * corners[v].y, corners[v].x, static_cast<float>(v));
  }
  return mesh;
}

struct Meeting {
  bool hit = false;
  double depth = 0.0;
  DVec3 weight{0.0};
  double margin = 0.0;  // how far the pixel's centre is from the nearest edge, pixels
};

// Ray and triangle in float64, by signed volumes: shares nothing with the shader.
Meeting meet(const CameraRays& rays, const TriangleMesh& mesh, std::size_t t, int x, int y) {
  const auto corner = [&](int i) { return DVec3(mesh.position(mesh.vertex[3 * t + i])) - rays.eye; };
  const auto weights_at = [&](double px, double py) {
    const DVec3 d = rays.direction(px, py);
    const DVec3 volume(glm::dot(d, glm::cross(corner(1), corner(2))), glm::dot(d, glm::cross(corner(2), corner(0))),
                       glm::dot(d, glm::cross(corner(0), corner(1))));
    return volume / (volume.x + volume.y + volume.z);
  };
  Meeting m;
  m.weight = weights_at(x, y);
  const DVec3 across = weights_at(x + 0.01, y), down = weights_at(x, y + 0.01);
  m.margin = 1e30;
  for (int i = 0; i < 3; ++i) {
    const double slope = std::hypot(across[i] - m.weight[i], down[i] - m.weight[i]) / 0.01;
    m.margin = std::min(m.margin, std::abs(m.weight[i]) / slope);
    m.depth += m.weight[i] * glm::dot(corner(i), rays.forward);
  }
  m.hit = m.weight.x > 0.0 && m.weight.y > 0.0 && m.weight.z > 0.0 && m.depth >= rays.near_depth;
  return m;
}

Vec3 vector_at(const Image& image, const char* layer, std::size_t pixel) {
  return VectorChannels(image, layer)[pixel];
}

std::vector<Vec3> sphere_normals(const TriangleMesh& mesh) {
  std::vector<Vec3> normals;
  for (const Vec3& p : mesh.vertices.position) normals.push_back(glm::normalize(p));
  return normals;
}

}  // namespace

TEST(Rasterize, ATriangleCoversExactlyThePixelsWhoseCentresItHolds) {
  const Camera camera{{0, -5, 0}, {0, 0, 0}, {0, 0, 1}, 40.0, 97, 61};
  const CameraRays rays = camera_rays(camera);
  std::mt19937 random(11);
  std::uniform_real_distribution<float> real(-2.5f, 2.5f);
  std::size_t covered = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const TriangleMesh mesh = triangles({{real(random), real(random), real(random)},
                                         {real(random), real(random), real(random)},
                                         {real(random), real(random), real(random)}});
    const Image image = rasterize(mesh, {}, camera);
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const Meeting m = meet(rays, mesh, 0, x, y);
        if (m.margin < 1.0 / 128.0) continue;  // OpenGL snaps corners to 1/256 pixel
        const std::size_t pixel = static_cast<std::size_t>(y) * camera.width + x;
        ASSERT_EQ(image.at("A")[pixel], m.hit ? 1.0f : 0.0f) << trial << " at " << x << ", " << y;
        if (!m.hit) continue;
        ++covered;
        ASSERT_NEAR(image.at("Z")[pixel], m.depth, 1e-4);
        const DVec3 p = rays.eye + m.depth * rays.direction(x, y);
        ASSERT_LT(glm::length(DVec3(vector_at(image, "P", pixel)) - p), 1e-4);
        const DVec3 rest = m.weight.x * DVec3(mesh.vertices.rest[0]) + m.weight.y * DVec3(mesh.vertices.rest[1]) +
                           m.weight.z * DVec3(mesh.vertices.rest[2]);
        ASSERT_LT(glm::length(DVec3(vector_at(image, "rest", pixel)) - rest), 1e-3);
      }
    }
  }
  EXPECT_GT(covered, 10000u);
}

TEST(Rasterize, ATriangleThroughTheEyePlaneIsCutAtTheNearDepth) {
  const Camera camera{{0, 0, 0}, {0, 1, 0}, {0, 0, 1}, 60.0, 80, 80};
  const CameraRays rays = camera_rays(camera);
  const TriangleMesh mesh = triangles({{-3, -4, -0.8f}, {4, -3, -0.7f}, {0.3f, 9, -0.9f}});
  const Image image = rasterize(mesh, {}, camera);
  std::size_t covered = 0;
  for (int y = 0; y < 80; ++y) {
    for (int x = 0; x < 80; ++x) {
      const DVec3 d = rays.direction(x, y);
      const DVec3 a(mesh.position(0)), n = glm::cross(DVec3(mesh.position(1)) - a, DVec3(mesh.position(2)) - a);
      const double depth = glm::dot(n, a) / glm::dot(n, d);
      const Meeting m = meet(rays, mesh, 0, x, y);
      if (m.margin < 1.0 / 128.0) continue;
      const bool hit = m.hit && depth >= rays.near_depth;
      ASSERT_EQ(image.at("A")[static_cast<std::size_t>(y) * 80 + x], hit ? 1.0f : 0.0f) << x << ", " << y;
      covered += hit;
    }
  }
  EXPECT_GT(covered, 200u);
}

TEST(Rasterize, ASphereHasItsDepthNormalsAndSilhouette) {
  const TriangleMesh mesh = test_meshes::icosphere(6);
  const Camera camera{{0.3, -4, 0.8}, {0, 0, 0}, {0, 0, 1}, 34.0, 200, 160};
  const CameraRays rays = camera_rays(camera);
  const Image image = rasterize(mesh, sphere_normals(mesh), camera);
  // The inscribed mesh's triangles lie at most this deep below the sphere.
  const double sag = 2e-4;
  std::size_t covered = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * camera.width + x;
      const DVec3 d = rays.direction(x, y);
      const double b = glm::dot(rays.eye, d), a = glm::dot(d, d);
      const auto discriminant = [&](double r) { return b * b - a * (glm::dot(rays.eye, rays.eye) - r * r); };
      const double outer = discriminant(1.0), inner = discriminant(1.0 - sag);
      if (outer < 0.0) {
        ASSERT_EQ(image.at("A")[pixel], 0.0f);
      }
      if (inner < 1e-3) continue;
      ASSERT_EQ(image.at("A")[pixel], 1.0f);
      ++covered;
      const double nearest = (-b - std::sqrt(outer)) / a, farthest = (-b - std::sqrt(inner)) / a;
      ASSERT_GE(image.at("Z")[pixel], nearest - 1e-5);
      ASSERT_LE(image.at("Z")[pixel], farthest + 1e-5);
      ASSERT_EQ(image.at("back")[pixel], 0.0f);
      const DVec3 n(vector_at(image, "N", pixel)), p(vector_at(image, "P", pixel));
      ASSERT_NEAR(glm::length(n), 1.0, 1e-6);
      ASSERT_LT(std::acos(std::min(1.0, glm::dot(n, glm::normalize(p)))) * kRadian, 0.05);
    }
  }
  EXPECT_GT(covered, 5000u);
}

TEST(Rasterize, TheNearerTriangleWins) {
  const TriangleMesh far_first = triangles({{-2, 2, -2}, {2, 2, -2}, {0, 2, 3}, {-2, 1, -2}, {2, 1, -2}, {0, 1, 3}});
  const TriangleMesh near_first = triangles({{-2, 1, -2}, {2, 1, -2}, {0, 1, 3}, {-2, 2, -2}, {2, 2, -2}, {0, 2, 3}});
  const Camera camera{{0, -3, 0}, {0, 0, 0}, {0, 0, 1}, 30.0, 33, 33};
  for (const auto* mesh : {&far_first, &near_first}) {
    EXPECT_NEAR(rasterize(*mesh, {}, camera).at("Z")[16 * 33 + 16], 4.0, 1e-6);
  }
}

TEST(Rasterize, WireIsTheDistanceToTheNearestEdgeInPixels) {
  // Parallel to the picture, so that pixels are uniform: 1 unit is 100 pixels at depth 5.
  const double fov = 2.0 * kRadian * std::atan(1.0 / 5.0);
  const Camera camera{{0, -5, 0}, {0, 0, 0}, {0, 0, 1}, fov, 200, 200};
  const TriangleMesh mesh = triangles({{-0.8f, 0, -0.7f}, {0.8f, 0, -0.7f}, {-0.8f, 0, 0.9f}});
  const Image image = rasterize(mesh, {}, camera, {.wire = true});
  std::size_t covered = 0;
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) {
      const double u = (x + 0.5) / 100.0 - 1.0, v = 1.0 - (y + 0.5) / 100.0;
      const double distance = 100.0 * std::min({u + 0.8, v + 0.7, (0.1 - u - v) / std::sqrt(2.0)});
      if (distance < 0.02) continue;
      ++covered;
      ASSERT_NEAR(image.at("wire")[static_cast<std::size_t>(y) * 200 + x], distance, 0.01) << x << ", " << y;
    }
  }
  EXPECT_NEAR(static_cast<double>(covered), 0.5 * 160 * 160, 320.0);
}

TEST(Rasterize, NoiseIsPerlinsOfTheRestPosition) {
  EXPECT_NEAR(perlin_noise(Vec3(3.14f, 42.0f, 7.0f)), 0.13691995878400012, 1e-6);  // of Perlin's own program in doubles
  for (const Vec3& p : {Vec3(0.0f), Vec3(-3.0f, 17.0f, 300.0f)}) EXPECT_EQ(perlin_noise(p), 0.0f);
  EXPECT_NEAR(perlin_noise({-0.3f, 0.6f, 1.2f}), perlin_noise({255.7f, 0.6f, -254.8f}), 1e-4f);

  TriangleMesh mesh = test_meshes::icosphere(4);
  for (Vec3& rest : mesh.vertices.rest) rest = 3.0f * rest - Vec3(0.4f, 7.0f, 0.1f);
  const Camera camera = frame_box({DVec3(-1.0), DVec3(1.0)}, 96, 72);
  constexpr double kSize = 0.37;
  const Image image = rasterize(mesh, {}, camera, {.noise_size = kSize});
  const VectorChannels rest(image, "rest");
  std::size_t seen = 0, dark = 0, light = 0;
  for (std::size_t pixel = 0; pixel < image.pixels(); ++pixel) {
    if (image.at("A")[pixel] == 0.0f) continue;
    const float expected = fractal_noise(static_cast<float>(1.0 / kSize) * rest[pixel]);
    ASSERT_NEAR(image.at("noise")[pixel], expected, 1e-3f) << pixel;
    ++seen;
    dark += expected < 0.25f;
    light += expected > 0.75f;
  }
  EXPECT_GT(seen, 1000u);
  EXPECT_GT(dark, seen / 10);
  EXPECT_GT(light, seen / 10);
  EXPECT_FALSE(rasterize(mesh, {}, camera).has("noise"));
}

TEST(Rasterize, FlippedTrianglesAreSeenFromBehind) {
  TriangleMesh mesh = test_meshes::icosphere(3);
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) std::swap(mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]);
  const Camera camera{{0, -4, 0}, {0, 0, 0}, {0, 0, 1}, 34.0, 64, 64};
  const Image image = rasterize(mesh, {}, camera);
  for (std::size_t pixel = 0; pixel < image.pixels(); ++pixel) {
    ASSERT_EQ(image.at("back")[pixel], image.at("A")[pixel]);
    // Area-weighted normals follow the triangles, so they now point inward, away from the eye.
    if (image.at("A")[pixel] > 0.0f) {
      ASSERT_GT(image.at("N.Y")[pixel], 0.0f);
    }
  }
}

TEST(Rasterize, FarFromTheOriginNothingIsLost) {
  const DVec3 away(8192, -4096, 2048);
  TriangleMesh mesh = test_meshes::icosphere(3);
  for (Vec3& p : mesh.vertices.position) p = glm::round(p * 1024.0f) / 1024.0f;  // so that moving is exact
  TriangleMesh moved = mesh;
  for (Vec3& p : moved.vertices.position) p += Vec3(away);
  const Camera camera{{0, -4, 1}, {0, 0, 0}, {0, 0, 1}, 34.0, 90, 90};
  Camera with_it = camera;
  with_it.eye += away;
  with_it.target += away;
  const Image here = rasterize(mesh, {}, camera), there = rasterize(moved, {}, with_it);
  EXPECT_EQ(here.at("A"), there.at("A"));
  for (std::size_t pixel = 0; pixel < here.pixels(); ++pixel) {
    if (here.at("A")[pixel] == 0.0f) continue;
    ASSERT_NEAR(here.at("Z")[pixel], there.at("Z")[pixel], 1e-5);
  }
}

TEST(Rasterize, NothingGivesAnEmptyImage) {
  const Image image = rasterize(TriangleMesh{}, {}, {.width = 5, .height = 4});
  EXPECT_THAT(image.at("A"), ::testing::Each(0.0f));
  EXPECT_THAT(image.at("Z"), ::testing::Each(std::numeric_limits<float>::infinity()));
}

TEST(Rasterize, SameBytesAgainAndFromAnotherThread) {
  const TriangleMesh mesh = test_meshes::torus(60, 30);
  const Camera camera{{0, -4, 2}, {0, 0, 0}, {0, 0, 1}, 44.0, 150, 120};
  const Image first = rasterize(mesh, {}, camera, {.wire = true});
  Image second, third;
  second = rasterize(mesh, {}, camera, {.wire = true});
  std::thread([&] { third = rasterize(mesh, {}, camera, {.wire = true}); }).join();
  EXPECT_EQ(first.channel, second.channel);
  EXPECT_EQ(first.channel, third.channel);
}

TEST(Rasterize, TheLargestImageWorks) {
  const TriangleMesh mesh = triangles({{-9, 0, -9}, {9, 0, -9}, {0, 0, 9}});
  const Image image = rasterize(mesh, {}, {.width = kMaxImageSide, .height = 3});
  EXPECT_EQ(image.at("A")[kMaxImageSide + kMaxImageSide / 2], 1.0f);
}

TEST(Rasterize, WrongNumberOfNormalsIsRefused) {
  const std::vector<Vec3> two(2);
  EXPECT_THROW(rasterize(test_meshes::tetrahedron(), two, {}), std::invalid_argument);
}

TEST(AreaWeightedNormals, AreThoseOfTheSphere) {
  const TriangleMesh mesh = test_meshes::icosphere(5);
  const auto normals = area_weighted_normals(mesh);
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    ASSERT_LT(glm::length(normals[v] - glm::normalize(mesh.position(static_cast<Index>(v)))), 0.01f);
  }
}

TEST(GlContextDeathTest, WithoutADriverTheErrorIsOneClearLine) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        ::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/dev/null", 1);
        try {
          gl_renderer();
        } catch (const InputError& error) {
          std::fprintf(stderr, "%s\n", error.what());
          std::_Exit(2);
        }
        std::_Exit(0);
      },
      ::testing::ExitedWithCode(2), "rasterizer: no headless OpenGL 4.5 through EGL");
}
