// Shape statistics of a mesh of which parts change: sums are kept by part, angles are counted.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Tells the shape_statistics() of all triangles whose steps have been counted, but for the order in which sums are
/// taken and p1_angle, which is the multiple of kStep at or below it.
class ShapeTally {
public:
  static constexpr double kStep = 1.0 / 256.0;  // degrees
  /// Of some triangles.
  struct Part {
    double angles = 0.0, edges = 0.0, area = 0.0, least = 180.0;
    Index below_10 = 0, triangles = 0;
  };

  static constexpr std::size_t kSteps = 60 * 256 + 1;
  static std::uint16_t step(double angle) { return std::uint16_t(std::min(kSteps - 1, std::size_t(angle / kStep))); }

  /// Counts a triangle's step `times` (1 or -1) times. May run in parallel.
  void count(std::uint16_t step, int times) {
    std::atomic_ref(angles_[step]).fetch_add(times, std::memory_order_relaxed);
  }

  /// `parts`: of all that is counted, each once.
  ShapeStatistics statistics(const std::vector<Part>& parts) const;

  /// The multiple of kStep at or below the least angle; 180 where nothing is counted.
  double least() const;

private:
  std::vector<int> angles_ = std::vector<int>(kSteps);  // by steps
};

}  // namespace isoskin
