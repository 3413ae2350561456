// What corner signs hide: a lattice edge between two corners of one side that the surface crosses twice (design 8: the
// lattice is refined where sheets are thin; here only what refining would say is taken over).
#pragma once

#include "core/field/field.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/brick_signs.h"

namespace isoskin {

/// Where a neck or a hole thinner than the spacing runs between two corners, one of them changes sides if that gives
/// the cells about the edge the Euler characteristic that F has there on a lattice four times as fine; its value
/// becomes the smallest of the other sign. Only corners whose cells are all in the lattice. Before
/// resolve_ambiguous_faces(). `signs`, of the lattice, one a brick, change with it. Returns how many corners changed.
/// Fills lattice.hidden and lattice.revealed. `stale` (one byte a brick, may be empty for all): what lattice.hidden
/// says of edges that no such brick holds is taken as it is. Parallel, and deterministic.
std::size_t reveal_hidden_crossings(BrickLattice& lattice, std::vector<BrickSigns>& signs, const Field& field,
                                    const std::vector<std::uint8_t>& stale = {});
/// The same where nobody else needs the signs.
inline std::size_t reveal_hidden_crossings(BrickLattice& lattice, const Field& field) {
  std::vector<BrickSigns> signs = brick_signs(lattice);
  return reveal_hidden_crossings(lattice, signs, field);
}

/// Undoes it: values are those that were sampled. lattice.hidden stays.
void hide_crossings(BrickLattice& lattice);

}  // namespace isoskin
