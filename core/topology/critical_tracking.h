// Follows critical points from one moment of a field to the next, and tells where their values change sign (design 8;
// Rumiano 2007, section 3.3.2).
#pragma once

#include <optional>
#include <vector>

#include "core/field/field.h"
#include "core/field/field_changes.h"
#include "core/topology/critical_points.h"

namespace isoskin {

/// (1 - s) before + s after: the straight way from one field to the other. Refers to both.
class BlendField final : public Field {
public:
  BlendField(const Field& before, const Field& after, double s) : before_(before), after_(after), s_(s) {}
  FieldSample sample(const DVec3& p) const override;
  double value(const DVec3& p) const override { return (1.0 - s_) * before_.value(p) + s_ * after_.value(p); }
  DMat3 hessian(const DVec3& p) const override { return (1.0 - s_) * before_.hessian(p) + s_ * after_.hessian(p); }
  Box bounds() const override;
  Interval range(const Box& box) const override;
  bool is_c2() const override { return before_.is_c2() && after_.is_c2(); }

private:
  const Field& before_;
  const Field& after_;
  double s_;
};

/// The life of one critical point while s goes from 0 (the field before) to 1 (after). Its kind never changes; where
/// two of neighbouring kinds meet and vanish, or appear together, the paths of both end or begin.
struct CriticalPath {
  CriticalPoint first, last;  // on the blends at s = begin and s = end
  double begin = 0.0, end = 1.0;
  std::optional<CriticalPoint> crossing;  // where its value changes sign, on the blend there
  double crossing_time = 0.0;             // s of the crossing, by linear interpolation of the value
  bool rising = false;                    // from outside (F < 0) to inside

  bool existed_before() const { return begin == 0.0; }
  bool exists_after() const { return end == 1.0; }
};

struct TrackingOptions {
  double longest_move = 0.25;   // of a critical point in one step of s; units of e
  double shortest_step = 1e-4;  // of s: where even this is too long, two critical points have met
};

struct CriticalTracking {
  std::vector<CriticalPath> paths;  // in order of the position at their first moment
  std::vector<Index> still;         // of `previous`: the field does not change about them, so they stay as they are
  std::size_t matched = 0, born = 0, died = 0;
};

/// Follows `previous` (critical points of `before`) forward, and those of `found` (of `after`) that no path arrived at
/// backward. Degenerate points are passed over. Predictor-corrector continuation in float64; a step is halved when
/// Newton does not confirm a point of the same kind near where it was predicted. Points of `previous` out of `changed`,
/// which says where the fields differ, are still. Parallel over points; the result does not depend on the number of
/// threads.
CriticalTracking track(const std::vector<CriticalPoint>& previous, const std::vector<CriticalPoint>& found,
                       const Field& before, const Field& after, const CriticalOptions& options,
                       const TrackingOptions& tracking = {}, const ChangeMask& changed = {{true, {}}, 0.0});

}  // namespace isoskin
