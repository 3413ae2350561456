// Says how far two images of the same surface are apart: silhouettes, depth, normals.
#pragma once

#include "render/image.h"

namespace isoskin {

struct CompareOptions {
  double unit = 1.0;                // the length depth errors are told in: the voxel of a grid, e for a skeleton
  int rim = 1;                      // pixels by which silhouettes, outer and inner, may be off
  double jump = 2.0;                // units of depth between neighbouring pixels that make an inner silhouette
  std::size_t most_beyond_rim = 0;  // tolerances of the verdict:
  double depth_p99 = 0.25;          // units
  double normal_mean = 3.0;         // degrees
};

/// Over some pixels.
struct ErrorStatistics {
  std::size_t pixels = 0;
  double mean = 0.0, p99 = 0.0, max = 0.0;
};

struct CompareReport {
  std::size_t covered_a = 0, covered_b = 0;  // pixels
  std::size_t coverage_mismatch = 0;         // pixels that one image covers and the other does not
  std::size_t beyond_rim = 0;                // of those, farther than the rim from what the other covers
  ErrorStatistics depth;                     // |Z - Z| in units, where both cover
  ErrorStatistics depth_inside;              // the same away from inner silhouettes
  ErrorStatistics normal;                    // angle in degrees, where both cover
  bool passed = false;
  std::string verdict;  // one line: "passed", or each figure that exceeds its tolerance
};

struct Comparison {
  CompareReport report;
  Image difference;  // coverage (a - b), depth (a - b, units), angle (degrees), and R G B to look at
};

/// Compares A, Z and N. A pixel that only one image covers lies in the rim when the other covers a pixel at most `rim`
/// away (in x and y). Pixels closer than that to a jump of depth in either image are at an inner silhouette. The
/// verdict looks at beyond_rim, depth_inside.p99 and normal.mean. Throws InputError when sizes differ or a channel is
/// missing, std::invalid_argument when the unit is not positive.
Comparison compare(const Image& a, const Image& b, const CompareOptions& options = {});

}  // namespace isoskin
