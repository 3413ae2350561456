// Lattice corners that the refined mesh has on the wrong side: what it does not show, or shows too much of.
#pragma once

#include <vector>

#include "core/field/field.h"
#include "core/field/field_changes.h"
#include "core/refine/refined_skin.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/columns.h"

namespace isoskin {

/// Corners on whose side mesh and field differ, farther than a least distance from the surface, kept from frame to
/// frame: only stretches of lattice columns in which mesh, field or lattice have changed are looked at again.
class WrongCorners {
public:
  /// All of a mesh. `least`: the same in all calls.
  void look(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice, const LatticeTopology& topology,
            double least);
  /// Of a mesh that may differ from the last call's where skin.changed() tells. `changes`: of the field since then;
  /// null: anything. Then `lattice` is the last call's or resample_lattice() made it from that. What comes of it
  /// depends on neither earlier calls nor what has changed.
  void update(const RefinedSkin& skin, const Field& field, const FieldChanges* changes, const BrickLattice& lattice,
              const LatticeTopology& topology, double least) {
    if (!update_part(skin, field, changes, lattice, topology, least))
      look(skin.mesh().mesh, field, lattice, topology, least);
  }
  /// The same, without putting the skin's mesh in order; false, and nothing is done, where looking at all of it costs
  /// no more.
  bool update_part(const RefinedSkin& skin, const Field& field, const FieldChanges* changes,
                   const BrickLattice& lattice, const LatticeTopology& topology, double least);

  /// Those farther from the surface, in order of the lattice's bricks.
  std::vector<Vec3> farther_than(double distance) const;

private:
  struct Corner {
    IVec3 brick{0};
    int corner = 0;  // BrickLattice::corner_index()
    Vec3 point{0.0f};
    double distance = 0.0;
  };

  static std::vector<Corner> find(const std::vector<DifferingRow>& rows, const Field& field,
                                  const BrickLattice& lattice, double least);

  std::vector<Corner> corner_;  // by brick and corner
  std::vector<IVec3> unsure_;   // bricks at whose lowest corners mesh and field differ, in order, perhaps repeating
  bool known_ = false;
};

}  // namespace isoskin
