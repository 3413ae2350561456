// The sides half of the certificate: is every lattice corner on the side of the mesh that the field says?
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/field/field.h"
#include "core/mesh/mesh_changes.h"
#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/match.h"

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
  /// Of a value of F where its gradient is `slope` long, and `share` of the tolerance.
  bool is_far(double value, double slope, double share = 1.0) const;
  /// No |F| up to this is far.
  double threshold() const { return tolerance_ * median_slope_; }

private:
  double tolerance_, median_slope_, spacing_;
  bool distances_ = false;
};

struct SideReport {
  std::size_t checked = 0;  // lattice corners on whose sides mesh and field were compared
  std::size_t wrong = 0;    // of those, farther from the surface than the tolerance with a winding number that is not
                            // 1 inside and 0 outside
  std::vector<std::uint8_t> mesh_piece;     // 1: a wrong stretch of a lattice column begins or ends at this piece
  std::vector<std::uint8_t> lattice_piece;  // 1: such a stretch begins or ends where this piece has no mesh
};

/// What a check of sides leaves to the next frame's.
struct SideMemory {
  std::shared_ptr<const MeshCopy> mesh;
  std::optional<MeshChanges> changes;  // from that of the check before, where that is less than half of it
  std::vector<Index> first_brick;      // per brick column that has bricks, CSR
  std::vector<glm::ivec2> column;      // per column: its bricks' x and y
  std::vector<std::uint64_t> print;    // per column: see column_prints(); empty where nothing is remembered
  std::vector<double> worst;  // per column: the greatest |F| at a corner where mesh and field differ; infinite where
                              // that is not told by the column's bricks
  std::vector<Index> vote;    // piece_votes() of the mesh: what certify() adds
};

/// Walks up every lattice column with the winding number of the mesh on one hand and the sign of F on the other. A
/// stretch of corners where they disagree by the same amount is wrong when one of its corners is farther from the
/// surface than `tolerance`; whatever changes at its two ends, mesh or sign, is to blame. Columns are walked from end
/// to end of space: where there are no bricks F keeps its sign, and corners in wrong stretches are evaluated through
/// `field` (up to 64 a stretch). See FarCorners for what is far. `memory`, if given, is of the lattice that
/// lattice.same_as refers to, and becomes of this one: columns in which neither mesh nor lattice has changed, and
/// nothing was far, are not walked again, with the same report. `changes`, if given, are those from memory->mesh to the
/// mesh. Parallel and deterministic.
SideReport check_sides(const TriangleMesh& mesh, const MeshPieces& pieces, const Field& field,
                       const BrickLattice& lattice, const LatticeTopology& topology, double tolerance,
                       SideMemory* memory = nullptr, std::optional<MeshChanges> changes = std::nullopt);

}  // namespace isoskin
