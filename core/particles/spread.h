// Evenly spread samples of a surface: thinned, then pushed apart in their tangent planes (Figueiredo et al. 1992, 3.2;
// Turk 1991; Szeliski and Tonnesen 1991).
#pragma once

#include <vector>

#include "core/backend.h"

namespace isoskin {

struct SpreadOptions {
  double spacing = 1.0;        // wanted distance of neighbours, world units
  double thinned = 0.62;       // of two samples nearer than this times the spacing one goes; what stays, spread evenly,
                               // then lies a spacing apart
  double reach = 1.5;          // particles farther apart than this times the spacing do not repel each other
  double strength = 0.4;       // of the push, in spacings
  double longest_move = 0.15;  // in one round, spacings
  int rounds = 60;
};

/// Keeps the samples, first come, first served, that are no nearer to a kept one on the same side of the surface than
/// thinned * spacing. Samples are on the same side when their normals agree (dot product positive).
void thin(std::vector<Vec3>& points, Backend& backend, const SpreadOptions& options);

/// Rounds of repulsion, (1 - distance / reach)^2 along the line between two particles of one side, projected on the
/// tangent plane; then Newton's projection back to the surface. A particle that is not projected stays where it was.
/// Sums run in the order of particles, so the result does not depend on threads.
void repel(std::vector<Vec3>& points, Backend& backend, const ProjectOptions& project, const SpreadOptions& options);

/// Outward unit normals of the backend's field, zero where the gradient vanishes.
std::vector<Vec3> surface_normals(std::span<const Vec3> points, Backend& backend);

}  // namespace isoskin
