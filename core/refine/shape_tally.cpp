#include "core/refine/shape_tally.h"

namespace isoskin {

ShapeStatistics ShapeTally::statistics(const std::vector<Part>& parts) const {
  ShapeStatistics out;
  std::size_t triangles = 0, below_10 = 0;
  double least = 180.0;
  for (const Part& part : parts) {
    triangles += part.triangles;
    below_10 += part.below_10;
    least = std::min(least, part.least);
    out.mean_angle += part.angles;
    out.mean_edge += part.edges;
    out.area += part.area;
  }
  if (triangles == 0) return out;
  out.min_angle = least;
  out.mean_angle /= double(triangles);
  out.mean_edge /= 3.0 * double(triangles);
  out.below_10_degrees = double(below_10) / double(triangles);
  std::size_t step = 0, passed = std::size_t(angles_[0]);
  while (passed <= std::size_t(0.01 * double(triangles))) passed += std::size_t(angles_[++step]);
  out.p1_angle = double(step) * kStep;
  return out;
}

double ShapeTally::least() const {
  const auto first = std::find_if(angles_.begin(), angles_.end(), [](int count) { return count > 0; });
  return first == angles_.end() ? 180.0 : double(first - angles_.begin()) * kStep;
}

}  // namespace isoskin
