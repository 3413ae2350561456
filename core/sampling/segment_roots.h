// Where segments cross the surface: bracketed root finding, many at a time.
#pragma once

#include <span>
#include <vector>

#include "core/backend.h"

namespace isoskin {

/// A segment and where it was crossed: at from + t (to - from).
struct SegmentRoot {
  Vec3 from{0.0f}, to{0.0f};
  float t = 0.5f;
  bool found = false;  // F has another sign at `to` than at `from`; else t is left as it was

  Vec3 point() const { return from + t * (to - from); }
};

/// Regula falsi with the Illinois rule on all segments at once: two batches for the ends, then one a round, `rounds` of
/// them. t given between 0 and 1 is the first guess (last frame's answer, say). The backend's field must be set.
void find_roots(std::span<SegmentRoot> segments, Backend& backend, int rounds = 12);

}  // namespace isoskin
