#include "core/refine/geometric_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "core/topology/columns.h"

namespace isoskin {
namespace {

/// Lattice corners farther than the tolerance from the surface on whose side mesh and field differ.
std::vector<Vec3> wrong_corners(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice,
                                double tolerance) {
  constexpr int kSide = BrickLattice::kCorners;
  const std::vector<std::int8_t> winding = winding_numbers(mesh, lattice);
  std::vector<std::vector<Vec3>> of_brick(lattice.brick_count());
  for_each_index(of_brick.size(), [&](std::size_t b) {
    for (std::size_t i = b * BrickLattice::kValues; i < (b + 1) * BrickLattice::kValues; ++i) {
      const float value = lattice.value[i];
      if (winding[i] == (value > 0.0f ? 1 : 0)) continue;
      const int local = int(i % BrickLattice::kValues);
      const IVec3 corner(local / (kSide * kSide), local / kSide % kSide, local % kSide);
      // Level sets hold distances, and their gradients vanish inside thin sheets; other values are no lengths.
      if (field.resolution() > 0.0 && std::abs(double(value)) <= tolerance) continue;
      const DVec3 p = lattice.point(BrickLattice::kCells * lattice.coordinate[b] + corner);
      if (field.distance_estimate(p) > tolerance) of_brick[b].emplace_back(p);
    }
  });
  std::vector<Vec3> wrong;
  for (const auto& list : of_brick) wrong.insert(wrong.end(), list.begin(), list.end());
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
