// What vertices and triangles add up to by pieces of a mesh.
#pragma once

#include <algorithm>
#include <vector>

#include <tbb/parallel_for.h>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// add(i, sum) for each i < count, with a sum of piece_of(i) (kNone: of none), which starts as Sum{}; give(piece, sum)
/// then adds up what it is given, in one order. Parallel but for give.
template <class Sum, class PieceOf, class Add, class Give>
void sum_by_piece(std::size_t count, const PieceOf& piece_of, const Add& add, const Give& give) {
  constexpr std::size_t kBlock = 1024;
  struct Run {  // most that follow each other are of one piece
    Index piece;
    Sum sum;
  };
  std::vector<std::vector<Run>> runs((count + kBlock - 1) / kBlock);
  tbb::parallel_for(std::size_t(0), runs.size(), [&](std::size_t b) {
    for (std::size_t i = b * kBlock; i < std::min(count, (b + 1) * kBlock); ++i) {
      const Index piece = piece_of(i);
      if (piece == kNone) continue;
      if (runs[b].empty() || runs[b].back().piece != piece) runs[b].push_back({piece, Sum{}});
      add(i, runs[b].back().sum);
    }
  });
  for (const auto& block : runs)
    for (const Run& run : block) give(run.piece, run.sum);
}

/// Adds the triangles triangle_of(i), i < count, to the counts and solids of `pieces`, `times` (1 or -1) over.
/// `vertex`: three a triangle; `of_vertex`: the pieces of those vertices.
template <class TriangleOf>
void add_triangles(std::size_t count, const TriangleOf& triangle_of, const std::vector<Index>& vertex,
                   const std::vector<Vec3>& position, const std::vector<Index>& of_vertex, int times,
                   MeshPieces& pieces) {
  struct Sum {
    int count = 0;
    SolidSum solid;
  };
  const auto corner = [&](std::size_t i) { return &vertex[3 * std::size_t{triangle_of(i)}]; };
  sum_by_piece<Sum>(
      count, [&](std::size_t i) { return of_vertex[*corner(i)]; },
      [&](std::size_t i, Sum& sum) {
        const Index* const v = corner(i);
        ++sum.count;
        sum.solid.add(position[v[0]], position[v[1]], position[v[2]], times);
      },
      [&](Index piece, const Sum& sum) {
        pieces.triangles[piece] += times * sum.count;
        pieces.solid[piece].add(sum.solid);
      });
}

}  // namespace isoskin
