// The complete search for critical points of a skeleton field in a box: interval divide and conquer on the gradient,
// then interval Newton (Stander and Hart 1997; Rumiano 2007, section 3.1). Slow; at start, on request, and as an
// oracle.
#pragma once

#include <vector>

#include "core/field/skeleton_field.h"
#include "core/topology/critical_points.h"

namespace isoskin {

struct IntervalSearchOptions {
  Interval values{-1e300, 1e300};  // only critical points with F within these; compact potentials need it to leave out
                                   // the empty space beyond their radius, where F is constant
  double least_box = 1e-4;         // boxes smaller than this (longest side, world units) are given up as unresolved
  std::size_t max_boxes = 20'000'000;  // bound on the boxes looked at
};

struct IntervalSearch {
  std::vector<CriticalPoint> points;  // sorted and merged as CriticalSearch
  std::vector<Box> unresolved;        // boxes that neither excluded a zero nor proved a single one: degenerate sets
  std::size_t boxes = 0;              // looked at
  bool complete = true;               // false when max_boxes ended the search
};

/// Bounds, never too narrow, of the gradient over a box and of the second derivatives xx yy zz xy xz yz.
struct DerivativeBounds {
  Interval gradient[3];
  Interval hessian[6];
};

/// Throws std::invalid_argument when an element is not a point or its norm is not 2.
DerivativeBounds derivative_bounds(const SkeletonField& field, const Box& box);

/// Every critical point in the box with a value in options.values, each proved to exist and to be alone by the Krawczyk
/// test, or else covered by `unresolved`. Throws std::invalid_argument as derivative_bounds().
IntervalSearch find_all_critical_points(const SkeletonField& field, const Box& box, const CriticalOptions& options,
                                        const IntervalSearchOptions& search);

}  // namespace isoskin
