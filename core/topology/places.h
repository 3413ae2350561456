// Places that are remembered one after another.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <unordered_map>

#include "core/types.h"

namespace isoskin {

/// Tells whether a place is within the distance of one that was added.
class Places {
public:
  explicit Places(double distance)
      : distance_(distance), side_(std::max(kSide * distance, std::numeric_limits<double>::min())) {}

  void add(const DVec3& p) { in_cell_.emplace(key(cell(p)), p); }

  bool any_near(const DVec3& p) const {
    const IVec3 low = cell(p - distance_), high = cell(p + distance_);
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y)
        for (int z = low.z; z <= high.z; ++z) {
          const auto [begin, end] = in_cell_.equal_range(key({x, y, z}));
          for (auto at = begin; at != end; ++at)
            if (glm::distance(at->second, p) <= distance_) return true;
        }
    return false;
  }

private:
  static constexpr double kSide = 8.0;  // of a cell, in distances: most balls about places lie in one or two

  IVec3 cell(const DVec3& p) const {
    constexpr double kFarthest = 1 << 30;
    return IVec3(glm::clamp(glm::floor(p / side_), DVec3(-kFarthest), DVec3(kFarthest)));
  }
  static std::uint64_t key(const IVec3& c) {
    return (std::uint64_t(std::uint32_t(c.x)) * 0x9E3779B97F4A7C15ull) ^
           (std::uint64_t(std::uint32_t(c.y)) * 0xC2B2AE3D27D4EB4Full) ^ std::uint64_t(std::uint32_t(c.z));
  }

  double distance_, side_;
  std::unordered_multimap<std::uint64_t, DVec3> in_cell_;  // by the cells' keys, which others may share
};

}  // namespace isoskin
