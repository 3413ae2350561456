// The fast path of sample_lattice: bricks of a lattice that divides a BrickGrid's voxels, by separable interpolation.
#pragma once

#include <vector>

#include "core/field/field_changes.h"
#include "core/field/grid_field.h"
#include "core/sampling/brick_lattice.h"

namespace isoskin {

/// n when `spacing` is the grid's h / n with n = 1, 2, 4 or 8 (then lattice bricks nest in grid bricks); else 0.
int grid_parts(const BrickGrid& grid, double spacing);

/// Lattice bricks (sorted) in which F may vanish: their taps differ in sign, and F lies in the taps' convex hull.
/// With `only`, those of them that it overlaps.
std::vector<IVec3> grid_candidates(const BrickGrid& grid, int parts, const ChangeMask* only = nullptr);

/// Fills the values of the given bricks of the lattice. Summed in float64, rounded once; a corner's value does not
/// depend on which brick asks, as long as the grid's bricks agree on the taps they share.
void evaluate_grid(const BrickGrid& grid, int parts, BrickLattice& lattice, const std::vector<Index>& bricks);

}  // namespace isoskin
