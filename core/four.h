// Four floats at once: what compilers do not make of plain loops, since least and greatest depend on order where there
// is no number.
#pragma once

#include <algorithm>
#include <cstring>

namespace isoskin {

using Four [[gnu::vector_size(16)]] = float;

inline Four load(const float* from) {
  Four four;
  std::memcpy(&four, from, sizeof four);
  return four;
}
inline Four lesser_of(Four a, Four b) {
  return a < b ? a : b;
}
inline Four greater_of(Four a, Four b) {
  return a > b ? a : b;
}
inline float least_of(Four v) {
  return std::min({v[0], v[1], v[2], v[3]});
}
inline float greatest_of(Four v) {
  return std::max({v[0], v[1], v[2], v[3]});
}

/// Finds the least and the greatest of many.
class Extremes {
public:
  explicit Extremes(Four four) : low_(four), high_(four) {}
  void add(Four four) {
    low_ = lesser_of(low_, four);
    high_ = greater_of(high_, four);
  }
  /// `count` >= 4.
  void add(const float* from, int count) {
    for (int i = 0; i + 4 < count; i += 4) add(load(from + i));
    add(load(from + count - 4));
  }
  float low() const { return least_of(low_); }
  float high() const { return greatest_of(high_); }

private:
  Four low_, high_;
};

}  // namespace isoskin
