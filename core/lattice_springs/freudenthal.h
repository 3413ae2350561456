// The Freudenthal triangulation of space where the surface runs through it (Figueiredo, Gomes, Terzopoulos and Velho
// 1992, 1.1 and 4.2; Allgower and Schmidt 1985).
#pragma once

#include <array>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// The intersecting complex: the tetrahedra with corners on both sides. Cubes are cut in six about the diagonal from
/// their low to their high corner, alike everywhere, so faces agree.
struct FreudenthalComplex {
  double spacing = 0.0;                           // of the cubes
  std::vector<Vec3> node;                         // sorted by lattice corner, x first
  std::vector<std::uint8_t> inside;               // side of each node: F > 0, as the lattice has it
  std::vector<std::uint8_t> fixed;                // bit a: the node may not move along axis a
  std::vector<std::array<Index, 4>> tetrahedron;  // of positive orientation
  std::vector<std::array<Index, 2>> edge;         // of tetrahedra, each once, ascending
};
FreudenthalComplex intersecting_complex(const BrickLattice& lattice);

/// The whole lattice of a box, whose field the backend has, for surfaces that run out of it: the complex then ends at
/// the box, which is made as wide as whole bricks. `hold_border`: nodes there slide in it.
BrickLattice lattice_of_box(const Box& box, double spacing, Backend& backend);
void hold_border(FreudenthalComplex& complex, const BrickLattice& lattice);

/// Positions and triangles, counter-clockwise seen from outside; closed where the complex is.
struct SimplexSurface {
  std::vector<Vec3> position;
  std::vector<Index> triangle;  // 3 a triangle
};

/// Marching simplices: one vertex on each edge between the sides, where F vanishes on it (backend's field), one or two
/// triangles a tetrahedron, of two the pair with the larger smallest angle. Vertices keep 0.1 % of an edge away from
/// nodes.
SimplexSurface march_simplices(const FreudenthalComplex& complex, Backend& backend);

}  // namespace isoskin
