#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/tracker.h"

namespace isoskin {
namespace {

/// Seen along the surface what lies beside it looks several times as far off: so much keeps 99 % of depths within 0.25
/// voxels or 0.02 e at 18 degrees. A chord's sagitta grows with the square of its angle.
double default_sagitta(double angle, double voxel, double edge_length) {
  constexpr double kVoxels = 0.04, kEdges = 0.0027, kAngle = 18.0;
  return (voxel > 0.0 ? kVoxels * voxel : kEdges * edge_length) * std::pow(angle / kAngle, 2.0);
}

}  // namespace

TrackOptions resolved(TrackOptions options, const Field& first) {
  constexpr double kVoxelsPerEdge = 1.5, kEdgesPerDiagonal = 60.0;
  // Edges that fit across the diagonal: with more the mesh has hundreds of millions of triangles. A grid whose own
  // voxels are as many is still meshed at its default edge.
  constexpr double kMostEdgesAcross = 4096.0;
  const double diagonal = first.bounds().diagonal();
  const double voxel = first.resolution();
  double& e = options.edge_length;
  const double usual = voxel > 0.0 ? kVoxelsPerEdge * voxel : diagonal / kEdgesPerDiagonal;
  if (e == 0.0) e = usual;
  if (e == 0.0) e = 1.0;  // an empty scene: nothing to mesh yet, any length serves until there is
  const double least = std::min(diagonal / kMostEdgesAcross, usual);
  if (!std::isfinite(e) || e <= 0.0 || e < least || (diagonal > 0.0 && e > diagonal))
    throw InputError(fmt::format("edge length {}: expected a length from {:.4g} to {:.4g}, the surface's diagonal", e,
                                 least, diagonal));
  if (options.lattice_spacing == 0.0) options.lattice_spacing = voxel > 0.0 ? 0.5 * voxel : 0.5 * e;
  if (options.tolerance == 0.0) options.tolerance = voxel > 0.0 ? voxel : 0.5 * e;
  options.alter.edge_length = options.relax.edge_length = float(e);
  options.project.tolerance = float(1e-4 * e);
  options.project.max_step = float(0.5 * e);
  // A grid has no detail below its voxels; a crease would be split for nothing until the passes run out.
  constexpr double kFinestEdge = 0.6;
  if (options.refine.shortest == 0.0f) options.refine.shortest = float(kFinestEdge * voxel);
  options.refine.sagitta = float(options.sagitta.value_or(default_sagitta(options.refine.angle, voxel, e)));
  return options;
}

}  // namespace isoskin
