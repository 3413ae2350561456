#include "render/camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <limits>

using namespace isoskin;
using ::testing::HasSubstr;

namespace {

std::string message_of(const auto& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no InputError";
}

std::filesystem::path file_with(const std::string& text) {
  const auto path = std::filesystem::temp_directory_path() / ("isoskin_camera_test_" + std::to_string(::getpid()));
  std::ofstream(path) << text;
  return path;
}

std::string message_for(const std::string& text) {
  const auto path = file_with(text);
  const std::string message = message_of([&] { load_camera(path); });
  std::filesystem::remove(path);
  return message;
}

void expect_near(const DVec3& a, const DVec3& b, double tolerance) {
  EXPECT_LE(glm::length(a - b), tolerance)
      << a.x << " " << a.y << " " << a.z << " and " << b.x << " " << b.y << " " << b.z;
}

}  // namespace

TEST(Camera, RaysPassThroughPixelCentres) {
  // Looks along +y with z up: x is right. At depth 1 the picture is 2 tan(45) = 2 high and 4 wide.
  const CameraRays rays = camera_rays({{1, 2, 3}, {1, 7, 3}, {0, 0, 1}, 90.0, 4, 2});
  expect_near(rays.direction(0, 0), {-1.5, 1.0, 0.5}, 1e-14);
  expect_near(rays.direction(3, 1), {1.5, 1.0, -0.5}, 1e-14);
  expect_near(rays.direction(1.5, 0.5), {0.0, 1.0, 0.0}, 1e-14);
  EXPECT_DOUBLE_EQ(rays.depth({4, 9, 1}), 7.0);
}

RC_GTEST_PROP(Camera, PixelInvertsDirection, ()) {
  const auto real = [](double low, double high) { return low + (high - low) * *rc::gen::inRange(0, 1000001) / 1e6; };
  const Camera camera{{real(-9, 9), real(-9, 9), real(-9, 9)},
                      {real(10, 20), real(-9, 9), real(-9, 9)},
                      {0, real(-0.3, 0.3), 1},
                      real(5, 120),
                      *rc::gen::inRange(1, 4096),
                      *rc::gen::inRange(1, 4096)};
  const CameraRays rays = camera_rays(camera);
  const double x = real(0, camera.width - 1), y = real(0, camera.height - 1), z = real(0.01, 100.0);
  const DVec3 point = rays.eye + z * rays.direction(x, y);
  RC_ASSERT(std::abs(rays.depth(point) - z) < 1e-10 * z);
  RC_ASSERT(std::abs(rays.pixel(point).x - x) < 1e-6);
  RC_ASSERT(std::abs(rays.pixel(point).y - y) < 1e-6);
}

TEST(Camera, TheFrameHoldsTheBoxAndIsTight) {
  const Box box{{-3, 5, 1}, {-1, 9, 1.5}};
  for (const auto& [width, height] : {std::pair{640, 480}, {200, 700}, {512, 512}}) {
    const FramingOptions options;
    const CameraRays rays = camera_rays(frame_box(box, width, height, options));
    double farthest = 0.0;  // 1 at the picture's border
    for (int corner = 0; corner < 8; ++corner) {
      const DVec3 p(corner & 1 ? -1 : -3, corner & 2 ? 9 : 5, corner & 4 ? 1.5 : 1);
      const glm::dvec2 pixel = rays.pixel(p);
      EXPECT_GT(rays.depth(p), rays.near_depth);
      farthest =
          std::max({farthest, std::abs((2 * pixel.x + 1) / width - 1), std::abs((2 * pixel.y + 1) / height - 1)});
    }
    EXPECT_NEAR(farthest, 1.0 - options.margin, 1e-9);
  }
}

TEST(Camera, APointAndAFlatBoxCanBeFramed) {
  EXPECT_NO_THROW(camera_rays(frame_box({{1, 1, 1}, {1, 1, 1}}, 64, 64)));
  EXPECT_NO_THROW(camera_rays(frame_box({{0, 0, 0}, {1, 0, 0}}, 64, 64)));
  EXPECT_THROW(frame_box(Box{}, 64, 64), InputError);
  EXPECT_THROW(frame_box({{0, 0, 0}, {std::numeric_limits<double>::infinity(), 1, 1}}, 64, 64), InputError);
}

TEST(Camera, WrongCamerasAreNamed) {
  EXPECT_THAT(message_of([] { camera_rays({{0, 0, 0}, {0, 0, 0}}); }), HasSubstr("same point"));
  EXPECT_THAT(message_of([] { camera_rays({{0, 0, 0}, {0, 0, 5}}); }), HasSubstr("up"));
  EXPECT_THAT(message_of([] { camera_rays({.fov = 180.0}); }), HasSubstr("fov"));
  EXPECT_THAT(message_of([] { camera_rays({.width = 0}); }), HasSubstr("size"));
  EXPECT_THAT(message_of([] { camera_rays({.height = 4097}); }), HasSubstr("4096"));
  EXPECT_THAT(message_of([] { camera_rays({.eye = DVec3(std::nan(""))}); }), HasSubstr("finite"));
}

TEST(Camera, FilesKeepEveryDigit) {
  const Camera camera{{1.0 / 3.0, -2e-7, 3e9}, {0.1, 0.2, 0.3}, {0, 1, 1e-3}, 33.3, 800, 600};
  const auto path = file_with("");
  save_camera(path, camera);
  const Camera back = load_camera(path);
  std::filesystem::remove(path);
  EXPECT_EQ(back.eye, camera.eye);
  EXPECT_EQ(back.target, camera.target);
  EXPECT_EQ(back.up, camera.up);
  EXPECT_EQ(back.fov, camera.fov);
  EXPECT_EQ(back.width, 800);
  EXPECT_EQ(back.height, 600);
}

TEST(Camera, AFileNeedsOnlyEyeAndTarget) {
  const auto path = file_with("eye = [0, -4, 1]\ntarget = [0, 0, 0.5]\n");
  const Camera camera = load_camera(path);
  std::filesystem::remove(path);
  EXPECT_EQ(camera.eye, DVec3(0, -4, 1));
  EXPECT_EQ(camera.target, DVec3(0, 0, 0.5));
  EXPECT_EQ(camera.fov, Camera{}.fov);
}

TEST(Camera, BadFilesNameTheLine) {
  EXPECT_THAT(message_of([] { load_camera("/nowhere/c.toml"); }), HasSubstr("/nowhere/c.toml: no such file"));
  EXPECT_THAT(message_for("eye = [0, 0\n"), HasSubstr(":1"));
  EXPECT_THAT(message_for("eye = [0, 0, 1]\ntraget = [0, 0, 0]\n"), HasSubstr(":2: unknown key traget"));
  EXPECT_THAT(message_for("eye = [0, 0]\n"), HasSubstr(":1: eye must be 3 finite numbers"));
  EXPECT_THAT(message_for("eye = [0, 0, nan]\n"), HasSubstr(":1: eye must be 3 finite numbers"));
  EXPECT_THAT(message_for("eye = [0, 0, 'x']\n"), HasSubstr(":1: eye must be 3 finite numbers"));
  EXPECT_THAT(message_for("\n\nfov = 'wide'\n"), HasSubstr(":3: fov must be a number"));
  EXPECT_THAT(message_for("size = [640, 0.5]\n"), HasSubstr(":1: size must be two whole numbers"));
  EXPECT_THAT(message_for("size = [640, 5000]\n"), HasSubstr("1 to 4096"));
  EXPECT_THAT(message_for("eye = [0, 0, 1]\n"), HasSubstr("target = [x, y, z] is missing"));
  EXPECT_THAT(message_for("eye = [0, 0, 1]\ntarget = [0, 0, 0]\n"), HasSubstr("up is zero or lies along"));
}
