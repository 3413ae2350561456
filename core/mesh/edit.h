// The topological edits of a closed triangle mesh: edge split, edge collapse, edge flip; each sequential primitive
// keeps a closed, oriented 2-manifold. alter() (core/mechanics/alter.h) runs them in parallel on independent sets.
#pragma once

#include <algorithm>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// True when collapsing the edge of halfedge h keeps the surface a 2-manifold of the same topology (link condition:
/// the ends share exactly the two opposite vertices; and the piece is not a tetrahedron).
bool link_condition(const TriangleMesh& mesh, Index h);

/// True when flipping the edge of h makes no edge that exists already.
bool can_flip(const TriangleMesh& mesh, Index h);

/// Replaces the edge of h by the other diagonal of its two triangles. Precondition: can_flip.
void flip_edge(TriangleMesh& mesh, Index h);

/// Inserts a vertex at from + t (to - from) on the edge of h; columns are blended, the id is fresh. Returns the vertex.
/// Adds two triangles at the end.
Index split_edge(TriangleMesh& mesh, Index h, float t = 0.5f);

/// split_edge into rows that the caller made room for: the new vertex goes to row `vertex` (whose id the caller sets),
/// the two new triangles to `triangle` and `triangle` + 1. Edges whose triangles share no edge may be split at once.
void split_edge_into(TriangleMesh& mesh, Index h, float t, Index vertex, Index triangle);

/// Merges to(h) into from(h) placed at from + t (to - from); columns blended, from's id survives. The two triangles and
/// the vertex become unused: halfedges of dead triangles are set to kNone; compact() removes them.
/// Precondition: link_condition.
void collapse_edge(TriangleMesh& mesh, Index h, float t = 0.5f);

/// Removes dead triangles and unused vertices, keeping order.
void compact(TriangleMesh& mesh);

/// Rows of a mesh, ascending.
struct RemovedRows {
  std::vector<Index> vertex, triangle;
};

/// compact() where it is known what is dead and what is unused.
void remove_rows(TriangleMesh& mesh, const RemovedRows& rows);

/// Removes rows of so many items; what stays keeps its order and its memory.
template <class Item>
void remove_rows(std::vector<Item>& column, const std::vector<Index>& rows, std::size_t items = 1) {
  if (rows.empty()) return;
  auto to = column.begin() + std::ptrdiff_t(items * rows.front());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const auto from = column.begin() + std::ptrdiff_t(items * (rows[k] + 1));
    const auto end = k + 1 < rows.size() ? column.begin() + std::ptrdiff_t(items * rows[k + 1]) : column.end();
    to = std::move(from, end, to);
  }
  column.erase(to, column.end());
}

}  // namespace isoskin
