// Simple points of digital topology: lattice corners that may change sides without changing the topology of either.
#pragma once

#include <cstdint>

namespace isoskin {

/// The 27 corners about a corner, bit (dx + 1) * 9 + (dy + 1) * 3 + dz + 1 set where inside; bit 13 is the corner
/// itself and is not looked at.
using Neighbourhood = std::uint32_t;

/// True when flipping the middle corner keeps pieces, cavities and tunnels, corners inside being joined when they touch
/// at all and those outside only along edges (26, 6), and the other way round with `inside_apart` (6, 26). Bertrand and
/// Malandain 1994: one piece on either side of the neighbourhood touches the middle.
bool is_simple(Neighbourhood inside, bool inside_apart);

}  // namespace isoskin
