// The spring lattice: nodes of the intersecting complex, springs along its edges, drawn to the surface from afar and
// pushed off it from near (Figueiredo, Gomes, Terzopoulos and Velho 1992, 4.2 and 4.3).
#pragma once

#include "core/lattice_springs/freudenthal.h"

namespace isoskin {

/// Lengths are in spacings of the lattice, which is also the unit of time's stiffness: mass and spring constant are 1.
struct SpringLatticeOptions {
  double rest = 0.9;   // rest length of every spring; the paper: smaller than the grid's spacing, so it is in tension
  double band = 0.45;  // nodes nearer to the surface than this are repelled, farther ones attracted
  double pull = 12.0;  // of both fields, force a spacing
  double friction = 2.0;      // proportional to velocity
  double step = 0.2;          // of symplectic Euler
  int steps = 100;            // the paper: usually less than 100 are needed
  double least_volume = 0.1;  // of a tetrahedron, of what it had before: no move that takes more
};

struct SpringLatticeReport {
  int steps = 0;
  double last_move = 0.0;   // longest of a node in the last step, spacings
  std::size_t refused = 0;  // moves, in all steps, that would have turned a tetrahedron or crossed the surface
};

/// Moves the nodes. Every node stays on its side of F = 0 and every tetrahedron keeps its orientation, so the surface
/// is cut in the same tetrahedra before and after. The backend's field must be set. Deterministic.
SpringLatticeReport deform(FreudenthalComplex& complex, Backend& backend, const SpringLatticeOptions& options = {});

/// Volume of each tetrahedron, in those of its cube's sixth; positive as built.
std::vector<double> relative_volumes(const FreudenthalComplex& complex);

struct SpringMeshOptions {
  double edge_length = 1.0;  // e, world units
  double spacing = 1.85;     // of the lattice, in e: triangles are cut halfway up
  SpringLatticeOptions springs;
};

/// The closed mesh of a field's surface: sample, deform, march simplices. Makes no field the backend's: it must be
/// `field`. Throws InputError as sample_lattice does.
TriangleMesh spring_lattice_mesh(const Field& field, Backend& backend, const SpringMeshOptions& options,
                                 SpringLatticeReport* report = nullptr);

}  // namespace isoskin
