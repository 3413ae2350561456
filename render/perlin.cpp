#include "render/perlin.h"

#include <cmath>

namespace isoskin {
namespace {

constexpr std::array<std::uint8_t, 256> kOnce{
    151, 160, 137, 91,  90,  15,  131, 13,  201, 95,  96,  53,  194, 233, 7,   225, 140, 36,  103, 30,  69,  142,
    8,   99,  37,  240, 21,  10,  23,  190, 6,   148, 247, 120, 234, 75,  0,   26,  197, 62,  94,  252, 219, 203,
    117, 35,  11,  32,  57,  177, 33,  88,  237, 149, 56,  87,  174, 20,  125, 136, 171, 168, 68,  175, 74,  165,
    71,  134, 139, 48,  27,  166, 77,  146, 158, 231, 83,  111, 229, 122, 60,  211, 133, 230, 220, 105, 92,  41,
    55,  46,  245, 40,  244, 102, 143, 54,  65,  25,  63,  161, 1,   216, 80,  73,  209, 76,  132, 187, 208, 89,
    18,  169, 200, 196, 135, 130, 116, 188, 159, 86,  164, 100, 109, 198, 173, 186, 3,   64,  52,  217, 226, 250,
    124, 123, 5,   202, 38,  147, 118, 126, 255, 82,  85,  212, 207, 206, 59,  227, 47,  16,  58,  17,  182, 189,
    28,  42,  223, 183, 170, 213, 119, 248, 152, 2,   44,  154, 163, 70,  221, 153, 101, 155, 167, 43,  172, 9,
    129, 22,  39,  253, 19,  98,  108, 110, 79,  113, 224, 232, 178, 185, 112, 104, 218, 246, 97,  228, 251, 34,
    242, 193, 238, 210, 144, 12,  191, 179, 162, 241, 81,  51,  145, 235, 249, 14,  239, 107, 49,  192, 214, 31,
    181, 199, 106, 157, 184, 84,  204, 176, 115, 121, 50,  45,  127, 4,   150, 254, 138, 236, 205, 93,  222, 114,
    67,  29,  24,  72,  243, 141, 128, 195, 78,  66,  215, 61,  156, 180};

constexpr std::array<std::uint32_t, 512> twice() {
  std::array<std::uint32_t, 512> out{};
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = kOnce[i % kOnce.size()];
  return out;
}

// Dot product with one of the twelve directions to the middles of a cube's edges.
float gradient(std::uint32_t hash, const Vec3& p) {
  const std::uint32_t h = hash & 15u;
  const float u = h < 8u ? p.x : p.y;
  const float v = h < 4u ? p.y : h == 12u || h == 14u ? p.x : p.z;
  return ((h & 1u) ? -u : u) + ((h & 2u) ? -v : v);
}

}  // namespace

const std::array<std::uint32_t, 512> kPerlinPermutation = twice();

float perlin_noise(const Vec3& x) {
  const Vec3 low = glm::floor(x), p = x - low;
  const auto cell = [](float f) { return static_cast<std::uint32_t>(static_cast<std::int64_t>(f) & 255); };
  const std::uint32_t cx = cell(low.x), cy = cell(low.y), cz = cell(low.z);
  const Vec3 w = p * p * p * (p * (p * 6.0f - 15.0f) + 10.0f);
  const auto& n = kPerlinPermutation;
  const auto corner = [&](std::uint32_t i, std::uint32_t j, std::uint32_t k) {
    return gradient(n[n[n[cx + i] + cy + j] + cz + k], p - Vec3(float(i), float(j), float(k)));
  };
  const auto along_x = [&](std::uint32_t j, std::uint32_t k) {
    return glm::mix(corner(0, j, k), corner(1, j, k), w.x);
  };
  return glm::mix(glm::mix(along_x(0, 0), along_x(1, 0), w.y), glm::mix(along_x(0, 1), along_x(1, 1), w.y), w.z);
}

float fractal_noise(const Vec3& p) {
  float sum = 0.0f, weight = 0.5f, scale = 1.0f;
  for (int octave = 0; octave < 4; ++octave, weight *= 0.5f, scale *= 2.03f)
    sum += weight * perlin_noise(scale * p + 17.3f * static_cast<float>(octave));
  return glm::smoothstep(-0.25f, 0.25f, sum);
}

const char* const kPerlinShader = R"(
float perlin_gradient(uint hash, vec3 p) {
  uint h = hash & 15u;
  float u = h < 8u ? p.x : p.y;
  float v = h < 4u ? p.y : h == 12u || h == 14u ? p.x : p.z;
  return ((h & 1u) != 0u ? -u : u) + ((h & 2u) != 0u ? -v : v);
}
float perlin_corner(uvec3 cell, vec3 p, uint i, uint j, uint k) {
  uint hash = permutation[permutation[permutation[cell.x + i] + cell.y + j] + cell.z + k];
  return perlin_gradient(hash, p - vec3(i, j, k));
}
float perlin_noise(vec3 x) {
  vec3 low = floor(x), p = x - low;
  uvec3 cell = uvec3(ivec3(low) & 255);
  vec3 w = p * p * p * (p * (p * 6 - 15) + 10);
  float a = mix(perlin_corner(cell, p, 0u, 0u, 0u), perlin_corner(cell, p, 1u, 0u, 0u), w.x);
  float b = mix(perlin_corner(cell, p, 0u, 1u, 0u), perlin_corner(cell, p, 1u, 1u, 0u), w.x);
  float c = mix(perlin_corner(cell, p, 0u, 0u, 1u), perlin_corner(cell, p, 1u, 0u, 1u), w.x);
  float d = mix(perlin_corner(cell, p, 0u, 1u, 1u), perlin_corner(cell, p, 1u, 1u, 1u), w.x);
  return mix(mix(a, b, w.y), mix(c, d, w.y), w.z);
}
float fractal_noise(vec3 p) {
  float sum = 0, weight = 0.5, scale = 1;
  for (int octave = 0; octave < 4; ++octave) {
    sum += weight * perlin_noise(scale * p + 17.3 * float(octave));
    weight *= 0.5;
    scale *= 2.03;
  }
  return smoothstep(-0.25, 0.25, sum);
}
)";

}  // namespace isoskin
