// What shading and shadows must agree on: where the key light is, and the hash that jitters samples. Private to
// render/.
#pragma once

#include <cstdint>

#include "render/camera.h"

namespace isoskin {

/// Unit direction to the key light: from the upper left of the camera, behind it.
inline Vec3 key_light(const CameraRays& rays) {
  return Vec3(glm::normalize(-0.55 * rays.right + 0.75 * rays.up - 0.60 * rays.forward));
}

inline std::uint32_t hash(std::int32_t x, std::int32_t y, std::int32_t z) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8da6b343u ^ static_cast<std::uint32_t>(y) * 0xd8163841u ^
                    static_cast<std::uint32_t>(z) * 0xcb1ab31fu;
  h = (h ^ (h >> 16)) * 0x7feb352du;
  h = (h ^ (h >> 15)) * 0x846ca68bu;
  return h ^ (h >> 16);
}

/// 0 <= value < 1.
inline float unit_hash(std::int32_t x, std::int32_t y, std::int32_t z) {
  return static_cast<float>(hash(x, y, z) >> 8) * (1.0f / 16777216.0f);
}

}  // namespace isoskin
