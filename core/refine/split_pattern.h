// How a triangle is replaced by two, three or four when some of its edges carry a new vertex (Bouthors-Nesme figure
// 7a).
#pragma once

#include <array>
#include <cstdint>

namespace isoskin {

/// Local vertices 0, 1, 2 are the triangle's corners; 3 + k is the new vertex of edge k, which runs from corner k to k
/// + 1.
struct SplitPattern {
  int count = 0;                         // children
  std::array<std::int8_t, 12> corner{};  // 3 a child, counter-clockwise
  std::array<std::int8_t, 12> twin{};    // local halfedge of a sibling, -1 on the border of the parent
  std::array<std::int8_t, 6> part{};  // local halfedges of the two halves of edge k at 2k, 2k + 1; one twice if whole
};

/// The pattern for the edges in `marked` (bit k: edge k). With two marked edges the quadrilateral they leave has two
/// diagonals: `second_diagonal` false takes the one that starts at the corner from which both marked edges are reached
/// first (corner k when edges k and k + 1 are marked, to new vertex 3 + k + 1), true the other (corner k + 2 to new
/// vertex 3 + k).
const SplitPattern& split_pattern(unsigned marked, bool second_diagonal);

/// With exactly two marked edges k and k + 1: k. Else 0.
int first_marked_edge(unsigned marked);

}  // namespace isoskin
