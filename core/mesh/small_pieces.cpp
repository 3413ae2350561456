#include "core/mesh/small_pieces.h"

#include <algorithm>
#include <array>

#include "core/parallel.h"

namespace isoskin {

bool is_small_piece(const TriangleMesh& mesh, Index h) {
  std::array<Index, kSmallPiece> piece{TriangleMesh::triangle(h)};
  auto end = piece.begin() + 1;
  for (auto at = piece.begin(); at != end; ++at)
    for (Index k = 3 * *at; k < 3 * *at + 3; ++k) {
      const Index next = TriangleMesh::triangle(mesh.twin[k]);
      if (std::find(piece.begin(), end, next) != end) continue;
      if (end == piece.end()) return false;
      *end++ = next;
    }
  return true;
}

std::vector<Index> small_piece_vertices(const TriangleMesh& mesh) {
  std::vector<std::uint8_t> small(mesh.triangle_count());
  for_each_index(small.size(), [&](std::size_t t) { small[t] = is_small_piece(mesh, Index(3 * t)); });
  std::vector<Index> vertices;
  for (std::size_t t = 0; t < small.size(); ++t)
    if (small[t]) vertices.insert(vertices.end(), {mesh.vertex[3 * t], mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]});
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  return vertices;
}

}  // namespace isoskin
