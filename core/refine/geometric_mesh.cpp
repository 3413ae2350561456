#include "core/refine/geometric_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/topology/columns.h"

namespace isoskin {
namespace {

/// Lattice corners farther than the tolerance from the surface on whose side mesh and field differ.
std::vector<Vec3> wrong_corners(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice,
                                double tolerance) {
  constexpr int kSide = BrickLattice::kCorners;
  const std::vector<std::int8_t> winding = winding_numbers(mesh, lattice);
  std::vector<Vec3> wrong;
  for (std::size_t i = 0; i < winding.size(); ++i) {
    const float value = lattice.value[i];
    if (winding[i] == (value > 0.0f ? 1 : 0)) continue;
    const int local = int(i % BrickLattice::kValues);
    const IVec3 corner(local / (kSide * kSide), local / kSide % kSide, local % kSide);
    const DVec3 p = lattice.point(BrickLattice::kCells * lattice.coordinate[i / BrickLattice::kValues] + corner);
    // Level sets hold distances, and their gradients vanish inside thin sheets; other values are no lengths.
    const double estimate = field.distance_estimate(p);
    const double distance = field.resolution() > 0.0 ? std::min(estimate, std::abs(double(value))) : estimate;
    if (distance > tolerance) wrong.emplace_back(p);
  }
  return wrong;
}

}  // namespace

GeometricMesh geometric_mesh(const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
                             Backend& backend, const GeometricOptions& options) {
  GeometricMesh geometric = refine(mechanical, backend, options.refine, options.project);
  constexpr float kEverywhere = std::numeric_limits<float>::infinity();
  const float e = float(options.edge_length);
  for (const float radius : {2.0f * e, 4.0f * e, 8.0f * e, kEverywhere}) {
    const std::vector<Vec3> wrong = wrong_corners(geometric.mesh, field, lattice, options.tolerance);
    if (wrong.empty()) break;
    flatten(geometric, wrong, radius);
  }
  return geometric;
}

}  // namespace isoskin
