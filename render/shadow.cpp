#include "render/shadow.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "render/embree_scene.h"
#include "render/lights.h"

namespace isoskin {
namespace {

constexpr double kLift = 2e-4;  // rays start this share of the depth above the surface, clear of its own triangles

// Directions spread over the light's disc on a golden-angle spiral, turned by the pixel.
Vec3 towards_light(const Vec3& key, int sample, int samples, double radius, double turn) {
  const Vec3 side = glm::normalize(glm::cross(key, std::abs(key.x) < 0.7f ? Vec3(1, 0, 0) : Vec3(0, 1, 0)));
  const double angle = turn + sample * std::numbers::pi * (3.0 - std::sqrt(5.0));
  const double r = radius * std::sqrt((sample + 0.5) / samples);
  return key + static_cast<float>(r * std::cos(angle)) * side +
         static_cast<float>(r * std::sin(angle)) * glm::cross(key, side);
}

bool hidden(RTCScene scene, const Vec3& from, const Vec3& direction) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray{};
  ray.org_x = from.x;
  ray.org_y = from.y;
  ray.org_z = from.z;
  ray.dir_x = direction.x;
  ray.dir_y = direction.y;
  ray.dir_z = direction.z;
  ray.tfar = std::numeric_limits<float>::infinity();
  ray.mask = ~0u;
  rtcOccluded1(scene, &context, &ray);
  return ray.tfar < 0.0f;
}

}  // namespace

void add_shadows(Image& image, const TriangleMesh& mesh, const Camera& camera, const ShadowOptions& options) {
  const CameraRays rays = camera_rays(camera);
  if (rays.width != image.width || rays.height != image.height) {
    throw std::invalid_argument("add_shadows: camera and image differ in size");
  }
  const EmbreeDevice device;
  const EmbreeScene scene(device, triangle_geometry(device, mesh, rays.eye));
  const auto& a = image.at("A");
  const VectorChannels position(image, "P"), normal(image, "N");
  const Vec3 key = key_light(rays);
  const double radius = std::tan(options.softness * std::numbers::pi / 180.0);
  auto& shadow = image.add("shadow");
  tbb::parallel_for(0, image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * image.width + x;
      if (a[pixel] == 0.0f) continue;
      const DVec3 p = DVec3(position[pixel]) - rays.eye;
      const DVec3 n(normal[pixel]);
      const Vec3 from(p + (kLift * glm::length(p)) * (glm::dot(n, p) > 0.0 ? -n : n));
      int hits = 0;
      for (int s = 0; s < options.samples; ++s) {
        const double turn = 2.0 * std::numbers::pi * unit_hash(x, y, 1);
        hits += hidden(scene.get(), from, towards_light(key, s, options.samples, radius, turn));
      }
      shadow[pixel] = static_cast<float>(hits) / static_cast<float>(options.samples);
    }
  });
}

}  // namespace isoskin
