// A field of the same topology for lattices that are too coarse for its thinnest necks and gaps (design 8).
#pragma once

#include <memory>
#include <span>

#include "core/field/field.h"
#include "core/topology/critical_points.h"

namespace isoskin {

struct ClearOptions {
  double length = 1.0;     // half the width that necks, tunnels, gaps, films, droplets and cavities get; world units
  double farthest = 6.0;   // the field is changed no farther than this from a critical point; in lengths
  double curvature = 0.5;  // by at most this share of its least second derivative there
};

/// A skeleton with small balls added, positive or negative, about those of its critical `points` whose value is so near
/// to zero that what they join or keep apart is thinner than twice the length: their values are pushed away from zero
/// until it is not, as far as the second derivatives there let no other critical point appear. No point's value changes
/// its sign, so by Morse theory the topology stays. Null when no point is near to zero, or the field is no skeleton.
/// Deterministic.
std::shared_ptr<const Field> clear_of_zero(const Field& field, std::span<const CriticalPoint> points,
                                           const ClearOptions& options);

}  // namespace isoskin
