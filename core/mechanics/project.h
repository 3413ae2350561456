// Newton projection onto F = 0 with a bisection safeguard (design 6; Nesme-Bouthors 2.2, errata).
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/field/field.h"

namespace isoskin {

struct ProjectOptions {
  float tolerance =
      1e-4f;  // converged when |F| <= tolerance * |grad F|; a length, world units (default of a run: 1e-4 e)
  float max_step = 0.5f;   // longest Newton step, world units (default of a run: e / 2)
  int max_newton = 16;     // Newton steps before giving up
  int max_bisection = 24;  // evaluations once two steps straddle the surface
  // A point that a step takes farther than this from where it began fails, world units: what the field is farther off
  // has no say in where the point goes.
  float reach = std::numeric_limits<float>::infinity();
};

/// How a point ended.
enum class ProjectStatus : std::uint8_t {
  converged = 0,
  quasi_critical = 1,  // did not converge: the point stays where it was
};

struct ProjectReport {
  std::size_t points = 0;
  std::size_t quasi_critical = 0;
};

/// A projected point; `point` is the input where the status is quasi_critical.
struct Projection {
  DVec3 point{0.0};
  ProjectStatus status = ProjectStatus::quasi_critical;
};

/// Float64 definition of one projection. Newton steps p <- p - F grad F / |grad F|^2, each clamped to max_step, until
/// |F| <= tolerance |grad F|. When two consecutive iterates have F of opposite sign, the segment between them is
/// searched instead by regula falsi, with a bisection after every try that did not halve it; it ends as above, or once
/// the segment is no longer than the tolerance. A point, value or gradient that is not finite, a zero gradient, or an
/// exhausted count ends quasi_critical, and so does a step out of reach.
Projection project_point(const Field& field, const DVec3& point, const ProjectOptions& options);

}  // namespace isoskin
