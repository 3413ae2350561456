// Random rotations for tests that must not depend on the axes.
#pragma once

#include <random>

#include "core/types.h"

namespace isoskin::test {

/// The next one of `random`: the same on every machine.
inline DMat3 random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const auto vector = [&] {  // one at a time: the order of a call's arguments is the compiler's
    const double x = normal(random), y = normal(random), z = normal(random);
    return DVec3(x, y, z);
  };
  const DVec3 x = glm::normalize(vector());
  DVec3 y = vector();
  y = glm::normalize(y - glm::dot(x, y) * x);
  return DMat3(x, y, glm::cross(x, y));
}

}  // namespace isoskin::test
