#include "render/shade.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "render/lights.h"
#include "render/perlin.h"

namespace isoskin {
namespace {

constexpr double kPatternShare = 1.0 / 18.0, kOcclusionShare = 1.0 / 14.0;  // of the picture's height at the target
constexpr int kOcclusionSamples = 20, kOcclusionTurns = 7;                  // points on a spiral about the pixel
constexpr float kOcclusionBias = 0.06f;  // cosine below which a neighbour does not hide the sky: a flat surface's own

float pattern_value(Pattern pattern, const Vec3& p) {
  if (pattern == Pattern::plain) return 0.0f;
  if (pattern == Pattern::noise) return fractal_noise(p);
  const IVec3 cell(glm::floor(p));
  return static_cast<float>((cell.x + cell.y + cell.z) & 1);
}

struct Scene {
  const Image& image;
  const CameraRays& rays;
  const ShadeOptions& options;
  double pattern_size, occlusion_radius;
  const std::vector<float>&a, &z;
  VectorChannels position, normal;
  std::optional<VectorChannels> rest;
  const std::vector<float>*back, *wire, *shadow, *noise;
};

// The share of the sky that neighbours on the screen hide ("Alchemy" estimator: McGuire et al. 2011, HPG).
float occlusion(const Scene& scene, int x, int y, const Vec3& p, const Vec3& n) {
  const std::size_t here = static_cast<std::size_t>(y) * scene.rays.width + x;
  const float radius = static_cast<float>(scene.occlusion_radius);
  const double reach = scene.occlusion_radius * scene.rays.height / (2.0 * scene.rays.half_height * scene.z[here]);
  const double turn = 2.0 * std::numbers::pi * unit_hash(x, y, 0);
  float hidden = 0.0f;
  for (int s = 0; s < kOcclusionSamples; ++s) {
    const double share = (s + 0.5) / kOcclusionSamples;
    const double angle = turn + 2.0 * std::numbers::pi * kOcclusionTurns * share;
    const int sx = x + static_cast<int>(std::lround(reach * share * std::cos(angle)));
    const int sy = y + static_cast<int>(std::lround(reach * share * std::sin(angle)));
    if (sx < 0 || sy < 0 || sx >= scene.rays.width || sy >= scene.rays.height || (sx == x && sy == y)) continue;
    const std::size_t there = static_cast<std::size_t>(sy) * scene.rays.width + sx;
    if (scene.a[there] == 0.0f) continue;
    const Vec3 to = scene.position[there] - p;
    const float distance = glm::length(to);
    if (distance <= 0.0f || distance > radius) continue;
    const float fade = 1.0f - distance * distance / (radius * radius);
    hidden += fade * std::max(0.0f, glm::dot(n, to) / distance - kOcclusionBias);
  }
  return std::min(1.0f, 2.6f * hidden / kOcclusionSamples);
}

// Light comes from fixed places about the camera, so that every view is lit alike.
Vec3 lit(const Scene& scene, const Vec3& albedo, const Vec3& n, const Vec3& to_eye, float open, float unshadowed) {
  const DVec3 &right = scene.rays.right, &up = scene.rays.up, &toward = -scene.rays.forward;
  const Vec3 key = key_light(scene.rays);
  const Vec3 fill = glm::normalize(Vec3(0.85 * right + 0.10 * up + 0.50 * toward));
  const float facing = std::max(0.0f, glm::dot(n, to_eye));

  const float key_cosine = glm::dot(n, key);
  const float wrapped = std::max(0.0f, (key_cosine + 0.25f) / 1.25f);
  const float direct = wrapped * wrapped * (0.45f + 0.55f * open) * unshadowed;
  const float fill_light = std::max(0.0f, 0.5f + 0.5f * glm::dot(n, fill));
  const float sky = 0.5f + 0.5f * glm::dot(n, Vec3(up));
  Vec3 light = direct * Vec3(1.16f, 1.08f, 0.96f);
  light += open * fill_light * Vec3(0.15f, 0.19f, 0.27f);
  light += open * glm::mix(Vec3(0.06f, 0.05f, 0.05f), Vec3(0.20f, 0.25f, 0.32f), sky);

  const Vec3 half = glm::normalize(key + to_eye);
  const float gloss = std::pow(std::max(0.0f, glm::dot(n, half)), 70.0f) * std::max(0.0f, key_cosine) * unshadowed;
  const float fresnel = std::pow(1.0f - facing, 4.0f);
  const float rim = fresnel * (0.25f + 0.75f * sky) * open;
  return albedo * light + Vec3(0.42f * gloss * (0.4f + 0.6f * open)) + rim * Vec3(0.36f, 0.43f, 0.50f);
}

Vec3 pixel_color(const Scene& scene, int x, int y) {
  const std::size_t pixel = static_cast<std::size_t>(y) * scene.rays.width + x;
  const Vec3 p = scene.position[pixel];
  const Vec3 to_eye = glm::normalize(Vec3(scene.rays.eye) - p);
  const bool behind = scene.back && (*scene.back)[pixel] > 0.5f;
  const Vec3 n = behind ? -scene.normal[pixel] : scene.normal[pixel];
  const float open = 1.0f - static_cast<float>(scene.options.occlusion) *
                                (scene.options.occlusion > 0.0 ? occlusion(scene, x, y, p, n) : 0.0f);
  const Vec3 at = (scene.rest ? *scene.rest : scene.position)[pixel];
  const float mixed = scene.noise ? (*scene.noise)[pixel]
                                  : pattern_value(scene.options.pattern, at / static_cast<float>(scene.pattern_size));
  Vec3 albedo = glm::mix(scene.options.color, scene.options.second, mixed);
  if (behind) albedo = glm::mix(albedo, scene.options.back_color, 0.85f);

  Vec3 color = lit(scene, albedo, n, to_eye, open, scene.shadow ? 1.0f - (*scene.shadow)[pixel] : 1.0f);
  if (scene.wire) {
    const float half_width = 0.5f * static_cast<float>(scene.options.wire_width);
    const float line = 1.0f - glm::smoothstep(half_width - 0.5f, half_width + 0.5f, (*scene.wire)[pixel]);
    color = glm::mix(color, scene.options.wire_color, 0.85f * line);
  }
  return color;
}

}  // namespace

double pattern_size(const ShadeOptions& options, const Camera& camera) {
  if (options.pattern_size > 0.0) return options.pattern_size;
  return kPatternShare * 2.0 * camera_rays(camera).half_height * glm::length(camera.target - camera.eye);
}

void shade(Image& image, const Camera& camera, const ShadeOptions& options) {
  const CameraRays rays = camera_rays(camera);
  if (rays.width != image.width || rays.height != image.height) {
    throw std::invalid_argument("shade: camera and image differ in size");
  }
  const double height = 2.0 * rays.half_height * glm::length(camera.target - camera.eye);
  const Scene scene{image,
                    rays,
                    options,
                    pattern_size(options, camera),
                    options.occlusion_radius > 0.0 ? options.occlusion_radius : kOcclusionShare * height,
                    image.at("A"),
                    image.at("Z"),
                    VectorChannels(image, "P"),
                    VectorChannels(image, "N"),
                    image.has("rest.X") ? std::optional(VectorChannels(image, "rest")) : std::nullopt,
                    image.has("back") ? &image.at("back") : nullptr,
                    options.wire_width > 0.0 ? &image.at("wire") : nullptr,
                    image.has("shadow") ? &image.at("shadow") : nullptr,
                    options.pattern == Pattern::noise && image.has("noise") ? &image.at("noise") : nullptr};
  auto &r = image.add("R"), &g = image.add("G"), &b = image.add("B");
  tbb::parallel_for(0, image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * image.width + x;
      if (scene.a[pixel] == 0.0f) continue;
      const Vec3 color = scene.a[pixel] * pixel_color(scene, x, y);
      r[pixel] = color.x;
      g[pixel] = color.y;
      b[pixel] = color.z;
    }
  });
}

}  // namespace isoskin
