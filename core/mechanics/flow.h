// How a skin flows where only its surface is known: a field that moves sideways past a vertex tells it nothing, its
// neighbours do.
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct FlowOptions {
  int aims = 4;  // times the surface arrived at is asked for its normals
  // Rims are looked for within sheets whose F is nowhere above this (half their thickness, for distances); 0: not at
  // all.
  float half_sheet = 0.0f;
  // Only what faces as a vertex does is its to land on: for fields of sheets that tear faster than the skin follows.
  bool facing = false;
  int rim_steps = 40;  // of a quarter of half_sheet, at most, that a vertex follows a rim
  // So many at once are walked with on the host: for them a batch a step would do nothing but wait.
  std::size_t few_walkers = 4096;
  int sweeps = 10;  // over the mesh before each and after the last; what is known travels an edge a sweep
};

/// The smoothest displacements over `dt` seconds with which vertices leave along their normals as fast as their
/// velocities say and arrive on the surface of `field`, the backend's current one (after Horn and Schunck 1981, whose
/// images are meshes here; sweeps are weighted as Chebyshev's semi-iteration). The tangential part of the velocity
/// column is the first guess. With `facing`, where what a vertex would arrive on faces elsewhere than it does, it
/// looks along its normal for what does not, and else its neighbours alone tell where it goes. So the rim of a thin
/// sheet takes the vertices behind it along instead of outrunning them. Where it did outrun them, as far as nothing
/// beside them tells, they follow it within the sheet to where it ends. One displacement a vertex; it does not end on
/// the surface exactly. No step towards the surface is longer than `max_step`. Deterministic.
std::vector<Vec3> surface_flow(const TriangleMesh& mesh, double dt, const Field& field, Backend& backend,
                               float max_step, const FlowOptions& options = {});

}  // namespace isoskin
