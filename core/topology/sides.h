// The sides half of the certificate: is every lattice corner on the side of the mesh that the field says?
#pragma once

#include <cstdint>
#include <vector>

#include "core/field/field.h"
#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin {

/// Tells what is farther from the surface than a tolerance: |F| > tolerance * slope. For grids that hold distances (the
/// median slope at the surface lies between 1/2 and 2) the slope is that median, at most 1, whatever the gradient,
/// which vanishes inside thin sheets; for other fields it is |grad F|, at least that median.
class FarCorners {
public:
  /// `field` is the one the lattice was sampled from; `tolerance` in world units.
  FarCorners(const Field& field, const BrickLattice& lattice, double tolerance);

  /// Of a corner of the brick whose first value is at `value`; |grad F| by differences.
  bool operator()(const float* value, int x, int y, int z) const;
  /// How many of the brick's corners 0..7 are far.
  std::size_t count(const float* value) const;
  /// Of a value of F where its gradient is `slope` long, and `share` of the tolerance.
  bool is_far(double value, double slope, double share = 1.0) const;
  /// No |F| up to this is far.
  double threshold() const { return tolerance_ * median_slope_; }

private:
  double tolerance_, median_slope_, spacing_;
  bool distances_ = false;
};

struct SideReport {
  std::size_t checked = 0;                  // lattice corners farther from the surface than the tolerance
  std::size_t wrong = 0;                    // of those, with a winding number that is not 1 inside and 0 outside
  std::vector<std::uint8_t> mesh_piece;     // 1: a wrong stretch of a lattice column begins or ends at this piece
  std::vector<std::uint8_t> lattice_piece;  // 1: such a stretch begins or ends where this piece has no mesh
};

/// Walks up every lattice column with the winding number of the mesh on one hand and the sign of F on the other. A
/// stretch of corners where they disagree by the same amount is wrong when one of its corners is farther from the
/// surface than `tolerance`; whatever changes at its two ends, mesh or sign, is to blame. Columns are walked from end
/// to end of space: where there are no bricks F keeps its sign, and corners in wrong stretches are evaluated through
/// `field` (up to 64 a stretch). See FarCorners for what is far. Parallel and deterministic.
SideReport check_sides(const TriangleMesh& mesh, const MeshPieces& pieces, const Field& field,
                       const BrickLattice& lattice, const LatticeTopology& topology, double tolerance);

}  // namespace isoskin
