#include "core/mesh/small_pieces.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <numeric>

#include "core/parallel.h"

namespace isoskin {

namespace {

using SomeTriangles = std::array<Index, kSmallPiece>;

/// Fills `piece` with connected triangles, the given one first; false when there are more than it holds, or a border.
bool gather_piece(const TriangleMesh& mesh, Index triangle, SomeTriangles& piece) {
  piece.fill(triangle);
  auto end = piece.begin() + 1;
  for (auto at = piece.begin(); at != end; ++at)
    for (Index k = 3 * *at; k < 3 * *at + 3; ++k) {
      if (mesh.twin[k] == kNone) return false;
      const Index next = TriangleMesh::triangle(mesh.twin[k]);
      if (std::find(piece.begin(), end, next) != end) continue;
      if (end == piece.end()) return false;
      *end++ = next;
    }
  return true;
}

}  // namespace

bool is_small_piece(const TriangleMesh& mesh, Index h) {
  SomeTriangles piece;
  return gather_piece(mesh, TriangleMesh::triangle(h), piece);
}

std::vector<Index> small_piece_vertices(const TriangleMesh& mesh) {
  std::vector<Index> all(mesh.triangle_count());
  std::iota(all.begin(), all.end(), Index{0});
  return small_piece_vertices(mesh, all);
}

std::vector<Index> small_piece_vertices(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  if (triangles.empty()) return {};
  std::vector<std::uint8_t> small(triangles.size()), large(mesh.triangle_count(), 0);
  for_each_index(triangles.size(), [&](std::size_t i) {
    const std::size_t t = triangles[i];
    // What one search finds to be large need not be searched from; whoever comes too early only searches in vain.
    const auto known_large = [&](std::size_t other) {
      return std::atomic_ref(large[other]).load(std::memory_order_relaxed) != 0;
    };
    if (known_large(t)) return;
    for (std::size_t h = 3 * t; h < 3 * t + 3; ++h)
      if (mesh.twin[h] != kNone && known_large(TriangleMesh::triangle(mesh.twin[h])))
        return std::atomic_ref(large[t]).store(1, std::memory_order_relaxed);
    SomeTriangles piece;
    small[i] = gather_piece(mesh, Index(t), piece);
    if (small[i]) return;
    for (const Index other : piece) std::atomic_ref(large[other]).store(1, std::memory_order_relaxed);
  });
  std::vector<Index> vertices;
  for (std::size_t i = 0; i < small.size(); ++i) {
    if (!small[i]) continue;
    SomeTriangles piece;
    gather_piece(mesh, triangles[i], piece);
    for (const Index t : piece)
      vertices.insert(vertices.end(), {mesh.vertex[3 * t], mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]});
  }
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  return vertices;
}

}  // namespace isoskin
