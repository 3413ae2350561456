// The eight canonical Morse events as scenes of metaballs (design 8).
#pragma once

#include <vector>

#include "core/field/skeleton_field.h"

namespace isoskin::test {

inline SkeletonElement ball(const DVec3& center, double radius, double weight = 1.0) {
  SkeletonElement e;
  e.a = e.b = center;
  e.radius = radius;
  e.weight = weight;
  return e;
}

/// A scene whose one critical point near the origin crosses zero at q = 0, rising with q.
struct MorseScene {
  const char* rising;
  const char* falling;
  std::vector<SkeletonElement> (*elements)(double q);
  double iso;
  double edge;  // e, world units: the droplets at the slowest speed must not fall between the certificate's corners
};

inline const MorseScene kMorseScenes[4] = {
    {"create", "destroy",
     [](double q) {
       const double w = (1.0 + 0.3 * q) * 0.3;
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 1.0, w), ball({0.3, 0.1, 0}, 0.8, 0.7 * w)};
     },
     0.46437, 0.14},
    {"connect", "cut",
     [](double q) {
       const double d = 0.7 - 0.06 * q;
       return std::vector<SkeletonElement>{ball({-d, 0, 0}, 1.0), ball({d, 0, 0}, 1.0)};
     },
     0.265302, 0.15},
    {"spackle", "pierce",
     [](double q) {
       const double w = 0.7 - 0.3 * q;
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 3.0), ball({0, 0, 0.7}, 1.0, -w),
                                           ball({0, 0, -0.7}, 1.0, -w)};
     },
     0.8142886, 0.14},
    {"burst_bubble", "open_bubble",
     [](double q) {
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 2.0), ball({0, 0, 0}, 1.0, -0.6 + 0.15 * q)};
     },
     0.4, 0.18},
};

}  // namespace isoskin::test
