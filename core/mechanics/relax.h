// Quasi-static relaxation of the elastic skin: (I - dt df/dx) dx = dt f by filtered conjugate gradients (design 5;
// Bouthors-Nesme 2.2-2.5, Nesme-Bouthors 2.1-2.5).
#pragma once

#include <cstddef>

namespace isoskin {

enum class Mechanics { fem, springs };

struct RelaxOptions {
  Mechanics mechanics = Mechanics::fem;
  float edge_length = 1.0f;      // e, rest edge of every element, world units
  float young = 1000.0f;         // E; in 2D independent of e
  float poisson = 0.3f;          // nu
  float spring = 100.0f;         // k, mass-spring mode only
  float dt = 0.04f;              // quasi-static time step, seconds
  int steps = 2;                 // quasi-static steps, each followed by a projection
  int cg_iterations = 10;        // at most, per step
  float cg_tolerance = 1e-2f;    // stop when |r| <= cg_tolerance * |r0|; 0 runs all iterations
  float max_move = 0.5f;         // longest move of a vertex in one step, in units of e
  bool sharp = false;            // pull vertices onto sharp features after each step (design 5, errata)
};

struct RelaxReport {
  int steps = 0;
  int cg_iterations = 0;           // summed over steps
  double residual = 0.0;           // |r| / |r0| of the last step
  std::size_t inverted = 0;        // inverted triangles seen at the start of the last step
  std::size_t quasi_critical = 0;  // vertices left unprojected by the last projection
};

}  // namespace isoskin
