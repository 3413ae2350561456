// The steps of sample_lattice() and resample_lattice(), which take them for all bricks or for some.
#pragma once

#include <cstdint>
#include <vector>

#include "core/field/field_changes.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/brick_signs.h"

namespace isoskin::sampling {

/// Lattice order: x, then y, then z.
bool before(const IVec3& a, const IVec3& b);

/// Throws InputError when there are too many.
void check_count(std::size_t bricks, std::size_t most, double spacing);

/// Bricks first .. last that the field's bounds touch. Throws InputError when they are too far from the origin.
struct BrickRange {
  IVec3 first{0}, last{-1};
};
BrickRange bricks_in_bounds(const Field& field, const DVec3& origin, double spacing);

/// The brick's box, wider by what rounding corners to float32 before they are evaluated may add.
Box box_of_samples(const BrickLattice& lattice, const BrickRange& range, const IVec3& brick, int bricks = 1);

/// Bricks of the range which the surface may cross, in lattice order; with `only`, of those it overlaps.
std::vector<IVec3> subdivide(const Field& field, const BrickLattice& lattice, const BrickRange& range,
                             std::size_t max_bricks, const ChangeMask* only = nullptr);

/// Fills the values of the given bricks: on the host where `field` is a grid whose voxels the lattice divides, else
/// through the backend. unify_shared_corners() is to follow.
void evaluate(BrickLattice& lattice, const std::vector<Index>& bricks, const Field& field, Backend& backend);

/// A corner shared by several bricks takes the value of the last of them, in case two of them differ in rounding. No
/// brick's value is read where it is not the last. Of the given bricks, whose entries of `signs` (one a brick) are
/// filled too.
void unify_shared_corners(BrickLattice& lattice, const std::vector<Index>& bricks, std::vector<BrickSigns>& signs);

/// What sample_lattice() returns, in the memory of `used`, which may be any lattice.
BrickLattice sample_anew(BrickLattice used, const Field& field, Backend& backend, double spacing,
                         std::size_t max_bricks = 8u << 20);

/// Bricks that must be there because a lattice edge on the boundary of one of `bricks` changes sign, but are not.
/// Sorted. `signs`: one a brick, right at least for `bricks`.
std::vector<IVec3> missing_neighbours(const BrickLattice& lattice, const std::vector<BrickSigns>& signs,
                                      const std::vector<Index>& bricks);

}  // namespace isoskin::sampling
