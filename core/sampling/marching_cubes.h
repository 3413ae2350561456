// Marching cubes on a BrickLattice: a closed, oriented 2-manifold whatever the signs (design 8).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/brick_signs.h"

namespace isoskin {

/// The crossings of the surface with the lattice edges that start in one brick's corners 0..7: numbered by axis, x, y,
/// z.
struct BrickCrossings {
  std::array<std::uint64_t, 24> mask{};    // word axis * 8 + x, bit y * 8 + z
  std::array<std::uint16_t, 24> before{};  // crossings of this brick in the words before
  Index first = 0;                         // of this brick

  Index size() const { return static_cast<Index>(before[23] + std::popcount(mask[23])); }
};

/// A cell of a brick that the surface crosses.
struct SurfaceCell {
  std::uint16_t cell = 0;         // (x * 8 + y) * 8 + z
  std::uint16_t shape = 0;        // see cell_shapes.h
  std::uint16_t first_patch = 0;  // of the brick's; the others follow it
  std::uint8_t patches = 0;
  bool tunnel = false;  // its two loops bound an annulus, not two discs

  bool operator==(const SurfaceCell& other) const = default;
};

/// What hangs together within one brick; the brick's *parts* of pieces are numbered by their first patch.
struct BrickParts {
  struct Part {
    int euler = 0;        // patches - own crossings
    double volume = 0.0;  // a third of the places of own crossings on their axes, in cells from the brick's low corner,
                          // negative where the axis enters the surface
    IVec3 faces{0};       // own crossings by axis, less those where it enters: what three volumes grow by when that
                          // corner is lower by one along the axis
    Box box;              // of own crossings, which start in the brick; world units
  };
  /// A crossing of a neighbour (see LatticeTopology::upper) that a part has, by its number in that brick.
  struct Link {
    std::uint16_t part = 0, crossing = 0;
    std::uint8_t neighbour = 0;
  };
  std::vector<Part> part;
  // Empty where there is one part:
  std::vector<std::uint16_t> of_patch, of_crossing;  // parts, of the brick's patches and own crossings
  std::vector<Link> link;

  Index part_of_patch(Index number) const { return of_patch.empty() ? 0 : of_patch[number]; }
  Index part_of_crossing(Index number) const { return of_crossing.empty() ? 0 : of_crossing[number]; }
};

/// The surface as the lattice sees it: its connected pieces, without any triangle. A *crossing* is where it meets a
/// lattice edge; a *patch* is one loop of crossings in one cell (a cell holds up to four); pieces join patches that
/// share a crossing.
struct LatticeTopology {
  std::vector<BrickSigns> signs;                // per brick
  std::vector<std::vector<SurfaceCell>> cells;  // per brick, ascending; empty where all cells are of one part and have
                                                // the one loop that their signs tell
  std::vector<BrickCrossings> crossings;        // per brick
  Index crossing_count = 0;
  std::vector<std::array<Index, 8>>
      upper;  // per brick: neighbour at offset (i >> 2, i >> 1 & 1, i & 1), kNone if absent

  std::vector<BrickParts> parts;  // per brick
  std::vector<Index> first_part;  // per brick, CSR; size bricks + 1
  std::vector<Index> part_piece;  // per part

  std::vector<int> euler;      // per piece: vertices - edges + patches
  std::vector<double> volume;  // per piece: enclosed volume, world units^3, negative for a cavity: the mean over the
                               // three axes of the length of lattice lines within, so rough for a few corners
  std::vector<Box> box;        // per piece: bounds of its crossings

  /// Bricks whose patches, or the numbers of their pieces, are not those they had before, ascending; nothing where
  /// there was nothing before.
  std::optional<std::vector<Index>> changed;

  std::size_t piece_count() const { return euler.size(); }
  /// Calls visit(piece) for every patch in cell (x * 8 + y) * 8 + z of a brick.
  template <class Visit>
  void for_pieces_in_cell(Index brick, int cell, const Visit& visit) const {
    const auto& told = cells[brick];
    if (told.empty()) {
      if (signs[brick].surface_cells(cell >> 6, cell >> 3 & 7) >> (cell & 7) & 1) visit(part_piece[first_part[brick]]);
      return;
    }
    const auto at = std::lower_bound(told.begin(), told.end(), cell,
                                     [](const SurfaceCell& c, int number) { return c.cell < number; });
    if (at == told.end() || at->cell != cell) return;
    for (Index patch = 0; patch < at->patches; ++patch) visit(piece_of_patch(brick, at->first_patch + patch));
  }
  /// The piece of a brick's patch, by its number in the brick.
  Index piece_of_patch(Index brick, Index number) const {
    return part_piece[first_part[brick] + parts[brick].part_of_patch(number)];
  }
  /// Crossing of the lattice edge that starts at corner (0..8 on each axis) of a brick, along `axis`; kNone if there is
  /// none.
  Index crossing(Index brick, IVec3 corner, int axis) const;
  /// The piece that it belongs to, kNone if there is none.
  Index crossing_piece(Index brick, IVec3 corner, int axis) const;
  /// The piece of a brick's own crossing, by its number in the brick.
  Index piece_of_crossing(Index brick, Index number) const {
    return part_piece[first_part[brick] + parts[brick].part_of_crossing(number)];
  }
};

/// Face ambiguities are resolved by lattice.face, else by the asymptotic decider, alike in both cells of a face, so
/// loops close; loops bound discs but for cells in lattice.tunnel; pieces are numbered in order of their first patch.
/// Crossing points by linear interpolation, kept at least 2% of an edge away from lattice corners. Parallel and
/// deterministic. Throws std::invalid_argument when a brick is missing where the surface goes on. `before`: of the
/// lattice that lattice.same_as refers to; what it says of bricks that are alike is taken over, with the same result.
LatticeTopology lattice_topology(const BrickLattice& lattice, LatticeTopology before = {});

/// Triangulates the pieces with wanted[piece] != 0 (all when `wanted` is empty). Loops are cut so that no diagonal lies
/// in a cell face (a centre point is added where it must), hence no edge is shared by more than two triangles.
/// Fresh ids from `next_id` on. `piece_of_vertex`, if given, receives the piece of every vertex.
TriangleMesh marching_cubes(const BrickLattice& lattice, const LatticeTopology& topology,
                            const std::vector<std::uint8_t>& wanted = {}, Index next_id = 0,
                            std::vector<Index>* piece_of_vertex = nullptr);

/// A part of the surface with borders: positions and triangles, counter-clockwise seen from outside.
struct OpenSurface {
  std::vector<Vec3> position;
  std::vector<Index> triangle;     // 3 a triangle
  std::vector<Index> piece;        // per position: the piece of the LatticeTopology
  std::vector<Index> of_crossing;  // per crossing of the LatticeTopology: its position, kNone where it has none
};

/// Adds the triangles of all patches in bricks b with wanted_brick[b] != 0, as marching_cubes makes them. None of these
/// may have been added before. What was there keeps its numbers.
void add_bricks(const BrickLattice& lattice, const LatticeTopology& topology,
                const std::vector<std::uint8_t>& wanted_brick, OpenSurface& surface);

}  // namespace isoskin
