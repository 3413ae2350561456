// Places that are remembered one after another.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// Tells whether a place is within the distance of one that was added.
class Places {
public:
  explicit Places(double distance)
      : distance_(distance), side_(std::max(kSide * distance, std::numeric_limits<double>::min())) {}

  void add(const DVec3& p) {
    places_.push_back({p, kNone});
    if (places_.size() > first_.size()) {
      first_.assign(std::max(kFewest, 2 * first_.size()), kNone);
      for (Index i = 0; i < places_.size(); ++i) link(i);
    } else {
      link(Index(places_.size() - 1));
    }
  }

  bool any_near(const DVec3& p) const {
    if (places_.empty()) return false;
    const IVec3 low = cell(p - distance_), high = cell(p + distance_);
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y)
        for (int z = low.z; z <= high.z; ++z)
          for (Index i = first_[slot({x, y, z})]; i != kNone; i = places_[i].next)
            if (glm::distance(places_[i].at, p) <= distance_) return true;
    return false;
  }

private:
  static constexpr std::size_t kFewest = 64;  // slots
  static constexpr double kSide = 8.0;        // of a cell, in distances: most balls about places lie in one or two

  IVec3 cell(const DVec3& p) const {
    constexpr double kFarthest = 1 << 30;
    return IVec3(glm::clamp(glm::floor(p / side_), DVec3(-kFarthest), DVec3(kFarthest)));
  }
  std::size_t slot(const IVec3& c) const {
    std::uint64_t k = std::uint32_t(c.x);
    k = k * 0x9E3779B97F4A7C15ull + std::uint32_t(c.y);
    k = k * 0x9E3779B97F4A7C15ull + std::uint32_t(c.z);
    k *= 0x9E3779B97F4A7C15ull;
    return (k ^ k >> 29) & (first_.size() - 1);
  }
  void link(Index i) {
    Index& first = first_[slot(cell(places_[i].at))];
    places_[i].next = std::exchange(first, i);
  }

  double distance_, side_;
  struct Place {
    DVec3 at;
    Index next;  // in the same slot
  };
  std::vector<Place> places_;
  std::vector<Index> first_;  // per slot, a power of two of them, which several cells may share
};

}  // namespace isoskin
