// How the skin of necks and tunnels thinner than its edges follows them from one field to the next.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/field/field.h"
#include "core/topology/critical_tracking.h"
#include "core/topology/thin_features.h"

namespace isoskin {

/// Projected along the gradient, vertices leave a waist that narrows, and where it moves sideways by more than its
/// radius they all end on one side of it: the tube turns inside out. So each keeps its place along the axis and its
/// direction from it instead, both carried along with the critical point, and is put on the surface in that direction.
class ThinMotion {
public:
  /// Notes the vertices on necks and tunnels that are thin before or after and stay, while `mesh` lies on the surface
  /// of `before`, and on those that are new and lie on `after` already. `tracking`: of the critical points `previous`
  /// of the one field to the other. Parallel.
  ThinMotion(const TriangleMesh& mesh, const CriticalTracking& tracking, std::span<const CriticalPoint> previous,
             const Field& before, const Field& after, const ThinOptions& options);

  /// Puts the vertices noted on the surface of `after` in a mesh of the same vertices. With `dt` (seconds, > 0) their
  /// velocities tell of this motion.
  void apply(TriangleMesh& mesh, const Field& after, double dt) const;

private:
  /// A neck (solid) or tunnel at one moment.
  struct Passage {
    DVec3 center, axis;
    bool solid;
  };
  struct Part {
    Passage before, after;
    double half_length, radius;
  };
  struct Noted {
    Index vertex, part;
    DVec3 offset;  // from the critical point after
    Vec3 old;
  };
  class Ray;
  bool on_wall(const Passage& passage, const DVec3& offset, const Field& field, double slack) const;
  std::optional<DVec3> settled(const Passage& passage, const DVec3& offset, const Field& field) const;

  ThinOptions options_;
  std::vector<Part> parts_;
  std::vector<Noted> noted_;
};

}  // namespace isoskin
