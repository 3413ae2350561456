// What the surface can look like in one cubic cell: loops of crossings for each pattern of corner signs and ambiguous
// faces, and how to cut each loop into triangles.
#pragma once

#include <array>
#include <cstdint>

namespace isoskin {

/// Corner c of a cell lies at (c & 1, c >> 1 & 1, c >> 2 & 1). Edge 4 * axis + b + 2 * c runs along `axis`; b and c are
/// its coordinates on the next two axes in cyclic order.
struct CellEdge {
  std::uint8_t axis;
  std::array<std::uint8_t, 3> low;  // its end with the smaller coordinate
};
namespace detail {
constexpr std::array<CellEdge, 12> make_cell_edges() {
  std::array<CellEdge, 12> edges{};
  for (int edge = 0; edge < 12; ++edge) {
    CellEdge& e = edges[edge];
    e.axis = static_cast<std::uint8_t>(edge / 4);
    e.low[(e.axis + 1) % 3] = edge & 1;
    e.low[(e.axis + 2) % 3] = edge >> 1 & 1;
  }
  return edges;
}
inline constexpr std::array<CellEdge, 12> kCellEdges = make_cell_edges();
}  // namespace detail
inline const CellEdge& cell_edge(int edge) {
  return detail::kCellEdges[edge];
}

/// Up to four loops; loop l is edge[first[l] .. first[l+1]), counter-clockwise seen from outside (values <= 0).
struct CellShape {
  static constexpr std::uint8_t kCentre = 255;  // a corner of a triangle: the loop's centre, not an edge

  std::uint8_t loops = 0;
  std::uint8_t centres = 0;  // loops that need a centre vertex, in all
  std::array<std::uint8_t, 5> first{};
  std::array<std::uint8_t, 12> edge{};
  std::array<std::uint8_t, 5> first_triangle{};  // of loop l, as `first`
  std::array<std::array<std::uint8_t, 3>, 12> triangle{};

  int size(int loop) const { return first[loop + 1] - first[loop]; }
  bool has_centre(int loop) const { return triangle[first_triangle[loop]][2] == kCentre; }
};

/// The shape for corner values v[8]: signs (inside iff > 0) and, on faces with two crossing diagonals, the asymptotic
/// decider (the positive corners are joined iff their product exceeds that of the others). Returns an index for
/// shape().
/// `decided`: bit 2 * axis + side of faces known otherwise; `joined`: of those, the ones whose positive corners are
/// joined.
std::uint16_t find_shape(const std::array<float, 8>& v, unsigned decided = 0, unsigned joined = 0);
/// Bits 2 * axis + side of the faces with two crossing diagonals.
unsigned ambiguous_faces(const std::array<float, 8>& v);
/// The same by signs: bit c set where corner c is inside.
unsigned ambiguous_faces(unsigned signs);
/// The shape of a cell without such faces, which its signs tell.
std::uint16_t plain_shape(unsigned signs);
/// Of all shapes, which follow each other in memory.
const CellShape& shape(std::uint16_t index);

}  // namespace isoskin
