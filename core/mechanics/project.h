// Newton projection onto F = 0 with a bisection safeguard (design 6; Nesme-Bouthors 2.2, errata).
#pragma once

#include <cstddef>
#include <cstdint>

namespace isoskin {

struct ProjectOptions {
  float tolerance = 1e-4f;   // converged when |F| <= tolerance * |grad F|; a length, world units (default of a run: 1e-4 e)
  float max_step = 0.5f;     // longest Newton step, world units (default of a run: e / 2)
  int max_newton = 16;       // Newton steps before giving up
  int max_bisection = 24;    // halvings once two steps straddle the surface
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

}  // namespace isoskin
