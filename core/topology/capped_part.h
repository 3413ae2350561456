// A part of a closed mesh that is closed itself, so that what operates on whole meshes can be done to it alone.
#pragma once

#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Some triangles of a mesh, in order, then a fan over each of their borders. The fans' centres lie on vertices of the
/// borders: whoever asks for the nearest vertex finds those, which come first.
struct CappedPart {
  TriangleMesh mesh;
  std::vector<Index> triangle, vertex;  // of the whole mesh, ascending; of the fans' there are none
  std::vector<std::uint8_t> edge;       // per triangle: 1 within some rings of a border, or of a fan

  bool is_centre(Index v) const { return v >= vertex.size(); }
};

/// `triangles`, ascending; and more where a border would meet itself at a vertex. `rings`: of `edge`.
CappedPart cut_out(const TriangleMesh& whole, std::vector<Index> triangles, int rings);

/// What has become of a part.
struct PartChanges {
  std::vector<Index> gone, fresh;  // triangles of the part, and of what it has become
  std::vector<Index> was;          // per triangle of that: the one it was, kNone where it is fresh
  std::vector<Index> vertex;       // per vertex of that: the one of the part, kNone of new ones
  bool at_edge = false;            // triangles of the edge are gone
};

/// `now` has the vertices of the part that stay, in order, with their ids, then from `first_new` on new ones; and first
/// its triangles that stay, in order, with others in between that have new vertices.
PartChanges changes_of(const CappedPart& part, const TriangleMesh& now, Index first_new);

/// Puts in what is fresh for what is gone. What shares a vertex goes together; not at the edge. New vertices get fresh
/// ids, and come last.
void put_back(const CappedPart& part, const TriangleMesh& now, const PartChanges& changes, TriangleMesh& whole);

}  // namespace isoskin
