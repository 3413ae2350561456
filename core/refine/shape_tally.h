// Shape statistics of a mesh of which parts change: sums are kept by part, angles are counted.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Tells the shape_statistics() of all triangles that have been counted, but for the order in which sums are taken and
/// p1_angle, which is the multiple of kStep at or below it.
class ShapeTally {
public:
  static constexpr double kStep = 1.0 / 256.0;  // degrees
  /// Of some triangles.
  struct Part {
    double angles = 0.0, edges = 0.0, area = 0.0, least = 180.0;
    Index below_10 = 0, triangles = 0;
  };

  /// Counts triangles `times` (1 or -1) times; corners(i) are those of triangle `first` + i. May run in parallel.
  template <class Corners>
  Part count(Index first, Index end, const Corners& corners, int times) {
    Part part;
    for (Index t = first; t < end; ++t) {
      const std::array<Vec3, 3> corner = corners(t);
      const DVec3 a(corner[0]), b(corner[1]), c(corner[2]);
      const double angle = smallest_angle(a, b, c);
      std::atomic_ref(angles_[step(angle)]).fetch_add(times, std::memory_order_relaxed);
      part.angles += angle;
      part.edges += glm::length(b - a) + glm::length(c - b) + glm::length(a - c);
      part.area += 0.5 * glm::length(glm::cross(b - a, c - a));
      part.least = std::min(part.least, angle);
      part.below_10 += angle < 10.0;
      ++part.triangles;
    }
    return part;
  }

  /// `parts`: of all that is counted, each once.
  ShapeStatistics statistics(const std::vector<Part>& parts) const;

  /// The multiple of kStep at or below the least angle; 180 where nothing is counted.
  double least() const;

private:
  static constexpr std::size_t kSteps = 60 * 256 + 1;
  static std::size_t step(double angle) { return std::min(kSteps - 1, std::size_t(angle / kStep)); }

  std::vector<int> angles_ = std::vector<int>(kSteps);  // by steps
};

}  // namespace isoskin
