// Where a mesh crosses the vertical columns of a lattice: winding numbers of lattice corners are sums along them.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/mesh_changes.h"
#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/brick_signs.h"

namespace isoskin {

/// One triangle crosses one lattice column between corners first - 1 and first.
struct ColumnCrossing {
  std::int32_t first = 0;  // z of the lowest corner at or above the crossing
  std::uint8_t row = 0;    // column within its brick column: 9 * x + y
  std::int8_t step = 0;    // winding number above minus winding number below
  Index triangle = kNone;
};

/// Crossings gathered by brick columns: all bricks with the same x and y. Each brick column has 9 x 9 lattice columns,
/// so those on its sides belong to its neighbours too.
struct MeshColumns {
  std::vector<IVec3> column;       // (x, y, 0); those with bricks first, in order, then those only the mesh reaches
  std::vector<Index> first_brick;  // per column, CSR over the lattice's bricks; columns + 1
  std::vector<Index> first;        // per column, CSR over `crossing`; columns + 1
  std::vector<ColumnCrossing> crossing;  // in each column by row, then first, then triangle
};

/// Vertices are rounded to 2^-20 of the lattice spacing and columns moved aside by an infinitesimal amount
/// (Edelsbrunner and Muecke 1990), and then all decisions are exact: a closed mesh is crossed as often upwards as
/// downwards, and no column meets a vertex or an edge. Parallel and deterministic. Throws std::invalid_argument when
/// the mesh reaches farther than 2^23 lattice corners from the origin.
/// `wanted`: one byte for each brick column that has bricks, in order, or empty for all; what is said of others means
/// nothing.
MeshColumns cross_columns(const TriangleMesh& mesh, const BrickLattice& lattice,
                          const std::vector<std::uint8_t>& wanted = {});

/// For each brick column that has bricks, in order: the sum of 64-bit fingerprints of the triangles that may cross it.
/// As long as that is the same, the mesh crosses it in the same places. Parallel and deterministic; throws as
/// cross_columns() does.
std::vector<std::uint64_t> column_prints(const TriangleMesh& mesh, const BrickLattice& lattice);

/// `print`, of the mesh `before` was copied from and of a lattice with the same brick columns, becomes column_prints()
/// of this mesh; `changes`: between the two. Costs what changes.
void update_column_prints(const MeshCopy& before, const TriangleMesh& mesh, const MeshChanges& changes,
                          const BrickLattice& lattice, std::vector<std::uint64_t>& print);

/// Winding number of the mesh at each corner of each brick, same layout as BrickLattice::value.
std::vector<std::int8_t> winding_numbers(const TriangleMesh& mesh, const BrickLattice& lattice);

/// A row of a brick with corners whose winding number is not 1 inside and 0 outside: bit z of `corners`.
struct DifferingRow {
  Index brick = kNone;
  std::uint16_t corners = 0;
  std::uint8_t row = 0;  // 9 * x + y
};

/// All of them, by brick, then by row. Costs a fraction of winding_numbers(). `signs`: of the lattice, one a brick.
/// `anchored`, one byte a brick or empty: 1 for the lowest of a column where its lowest corners do not differ, whatever
/// the mesh has below them; it may lack that.
std::vector<DifferingRow> differing_rows(const TriangleMesh& mesh, const BrickLattice& lattice,
                                         const std::vector<BrickSigns>& signs,
                                         const std::vector<std::uint8_t>& anchored = {});

/// Winding numbers where they are not what the signs say.
struct DifferingBricks {
  std::vector<Index> brick;   // those with a corner whose winding number is not 1 inside and 0 outside, ascending
  std::vector<Index> number;  // per brick of the lattice: its place in `brick`, kNone where it is not there
  std::vector<std::int8_t> winding;  // of each of them, laid out as BrickLattice::value
};

/// Costs a fraction of winding_numbers(). `signs`: of the lattice, one a brick.
DifferingBricks differing_bricks(const TriangleMesh& mesh, const BrickLattice& lattice,
                                 const std::vector<BrickSigns>& signs);

}  // namespace isoskin
