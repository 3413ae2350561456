// Particles that fall onto F = 0: x'' + gamma x' + sign(F) grad F = 0 (Figueiredo, Gomes, Terzopoulos and Velho 1992,
// 2.1 and 3.1).
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "core/backend.h"

namespace isoskin {

/// Units: F is scaled by a constant, so that lengths are multiples of L, the median distance estimate |F| / |grad F| of
/// the starts, and a particle at distance L with the median gradient begins with the acceleration L / T^2.
struct ParticleOptions {
  double friction = 1.0;       // gamma, 1 / T
  double step = 0.25;          // of symplectic Euler, T
  int most_steps = 100;        // the paper: usually less than 100 are needed
  double longest_move = 0.25;  // of a particle in one step, L
  double at_rest = 0.02;       // a particle with |F| / |grad F| below this times L has arrived, and stops; so has one
                               // that crosses the surface so slowly that two steps of the force would turn it
};

struct ParticleReport {
  int steps = 0;             // taken, by the last particle
  std::size_t arrived = 0;   // particles at rest
  std::size_t stranded = 0;  // that were still moving at the end, or where there is no gradient to follow
};

/// Called before the first step and after each one with all positions.
using ParticleObserver = std::function<void(std::span<const Vec3>)>;

/// Moves `points` until all are at rest, or most_steps. The backend's field must be set. `arrived`: one byte a point.
/// Deterministic: no particle acts on another.
ParticleReport fall_to_surface(std::span<Vec3> points, std::span<std::uint8_t> arrived, Backend& backend,
                               const ParticleOptions& options = {}, const ParticleObserver& observe = {});

}  // namespace isoskin
