// The surface in one cell as triangles: a disc for each loop, or a tunnel between two of them.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

#include "core/sampling/cell_shapes.h"
#include "core/types.h"

namespace isoskin {

/// Where the surface meets the cell's edges, by edge number; entries of edges it does not meet are unused.
using CellCrossings = std::array<DVec3, 12>;

/// Fraction of an edge from its end with value p to its end with value q (signs differ) at which the surface crosses:
/// linear, kept 2% away from both ends so that triangles do not degenerate.
inline double crossing_fraction(double p, double q) {
  constexpr double kNearestToCorner = 0.02;
  return std::clamp(p / (p - q), kNearestToCorner, 1.0 - kNearestToCorner);
}

/// The space between a cell's two loops.
struct Neck {
  DVec3 from, to;        // centres of loop 0 and loop 1
  bool outside = false;  // is the space between them outside?
};
/// Where a tunnel could lead, for a cell of two loops that face each other or face away; else nothing.
std::optional<Neck> find_neck(const CellShape& shape, const CellCrossings& crossing);

/// Triangles of a cell. Corners below 12 are crossings by edge number, others extra[corner - 12].
struct CellSurface {
  static constexpr int kRing = 3;  // vertices about the middle of a tunnel
  int extras = 0, triangles = 0;
  std::array<DVec3, 4> extra{};
  std::array<std::uint8_t, 4> loop_of_extra{};
  std::array<std::array<std::uint8_t, 3>, 12 + 2 * kRing> triangle{};
  std::array<std::uint8_t, 12 + 2 * kRing> loop_of_triangle{};
};

/// Discs as the shape says, with loop centres where it asks for them. With `tunnel` (two loops, with a neck) a ring of
/// three vertices in the middle of the neck is woven to both loops instead: an annulus, all its own edges inside the
/// cell.
CellSurface cell_surface(const CellShape& shape, bool tunnel, const CellCrossings& crossing);

/// The same counts without coordinates.
int triangle_count(const CellShape& shape, bool tunnel, int loop);
int extra_count(const CellShape& shape, bool tunnel, int loop);

}  // namespace isoskin
