// Key-framed parameters: values at frames, linear or smooth between them (design 9).
#pragma once

#include <algorithm>
#include <vector>

#include "core/types.h"

namespace isoskin {

enum class Motion : std::uint8_t {
  linear,  // straight from key to key
  smooth,  // cubic Hermite through the keys, C1: Catmull-Rom slopes for vectors, monotone slopes for numbers
};

/// Values at increasing frames; before the first and after the last they stay. A smooth number never leaves the range
/// of the two keys around it (Fritsch and Butland 1984), so a radius stays positive; a smooth vector may swing out.
template <typename T>
struct KeyTrack {
  Motion motion = Motion::linear;
  std::vector<double> frame;  // increasing, at least one
  std::vector<T> value;

  void add(double f, const T& v) {
    frame.push_back(f);
    value.push_back(v);
  }

  T at(double f) const {
    const std::size_t after = std::upper_bound(frame.begin(), frame.end(), f) - frame.begin();
    if (after == 0) return value.front();
    if (after == frame.size()) return value.back();
    const std::size_t k = after - 1;
    const double width = frame[k + 1] - frame[k], t = (f - frame[k]) / width;
    const T step = value[k + 1] - value[k];
    if (motion == Motion::linear) return value[k] + t * step;
    const double s = t * t * (3.0 - 2.0 * t);
    return value[k] + s * step + (t * (1.0 - t) * width) * ((1.0 - t) * slope(k) - t * slope(k + 1));
  }

private:
  // The derivative at key k, by frame; zero at both ends, where the motion rests.
  T slope(std::size_t k) const {
    if (k == 0 || k + 1 == frame.size()) return T(0.0);
    const double before = frame[k] - frame[k - 1], after = frame[k + 1] - frame[k];
    return through(T((value[k] - value[k - 1]) / before), T((value[k + 1] - value[k]) / after), before, after);
  }
  static DVec3 through(const DVec3& left, const DVec3& right, double before, double after) {
    return (before * left + after * right) / (before + after);
  }
  static double through(double left, double right, double before, double after) {
    if (left * right <= 0.0) return 0.0;
    const double share = (before + 2.0 * after) / (3.0 * (before + after));
    return left * right / (share * right + (1.0 - share) * left);
  }
};

}  // namespace isoskin
