// Signs of determinants of float32 points, never wrong: in float64 where the error bound allows it, else in integers.
#pragma once

#include <glm/glm.hpp>

#include "core/types.h"

namespace isoskin {

/// Sign (-1, 0, 1) of det(a - d, b - d, c - d): positive when d sees the triangle a b c clockwise. Finite coordinates.
/// Filter: Shewchuk 1997, 4.3; what it leaves open is computed with Boost.Multiprecision.
int orientation(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d);

/// Sign of the area of a b c in the plane, positive when they run counter-clockwise. Finite coordinates.
int orientation(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c);

}  // namespace isoskin
