// The middle of a list of figures.
#pragma once

#include <algorithm>
#include <vector>

namespace isoskin::perf {

/// 0 of nothing; the upper of two middles.
inline double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace isoskin::perf
