// The few types every room shares: vectors, boxes, indices and the one exception for bad input.
#pragma once

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

#include <glm/glm.hpp>

namespace isoskin {

using Vec3 = glm::vec3;    // what meshes and devices hold: float32, world units
using DVec3 = glm::dvec3;  // what oracles and fields compute with: float64
using IVec3 = glm::ivec3;
using DMat3 = glm::dmat3;  // column-major; Hessians are symmetric
using Index = std::uint32_t;

inline constexpr Index kNone = std::numeric_limits<Index>::max();

/// Bad input from outside: a file, a scene key, an option. what() is one line that says what, where and what was
/// expected. The program prints it and ends with status 2.
class InputError : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

/// Axis-aligned box, closed; empty while low > high on some axis.
struct Box {
  DVec3 low{std::numeric_limits<double>::infinity()};
  DVec3 high{-std::numeric_limits<double>::infinity()};

  bool empty() const { return low.x > high.x || low.y > high.y || low.z > high.z; }
  DVec3 center() const { return 0.5 * (low + high); }
  DVec3 size() const { return high - low; }
  double diagonal() const { return empty() ? 0.0 : glm::length(size()); }
  void add(const DVec3& p) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  void add(const Box& b) {
    low = glm::min(low, b.low);
    high = glm::max(high, b.high);
  }
  Box grown(double by) const { return {low - DVec3(by), high + DVec3(by)}; }
};

/// Closed interval of reals; the value of a bound that is guaranteed to contain.
struct Interval {
  double low = 0.0;
  double high = 0.0;

  bool contains(double x) const { return low <= x && x <= high; }
};

}  // namespace isoskin
