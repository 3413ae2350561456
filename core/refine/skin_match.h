// What of a skin was there before: whoever keeps something by triangle or vertex goes on from there.
#pragma once

#include <array>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Triangles and vertices of a skin as it was and as it is. Both lie in about the same order, since edits append and
/// drop; what does not is taken for new.
class SkinMatch {
public:
  /// As it was: the ids of its vertices, and three vertices a triangle.
  SkinMatch(const std::vector<Index>& old_id, const std::vector<Index>& old_corners, const TriangleMesh& skin);

  /// Vertices and triangles are what they were, by number.
  bool is_identity() const { return identity_; }
  /// Per vertex and triangle of the skin the one as it was, and the other way round; kNone without counterpart.
  Index old_vertex(Index v) const { return identity_ ? v : old_vertex_[v]; }
  Index old_triangle(Index t) const { return identity_ ? t : old_triangle_[t]; }
  Index new_vertex(Index v) const { return identity_ ? v : new_vertex_[v]; }
  Index new_triangle(Index t) const { return identity_ ? t : new_triangle_[t]; }
  std::size_t old_vertices() const { return old_id_.size(); }
  std::size_t old_triangles() const { return old_corners_.size() / 3; }
  std::size_t vertices() const { return skin_.vertex_count(); }
  std::size_t triangles() const { return skin_.triangle_count(); }

private:
  void match_vertices();
  void match_triangles();
  std::array<Index, 3> old_corners(std::size_t t) const;
  bool gone(std::size_t old) const;
  bool is(std::size_t old, const std::array<Index, 3>& corners) const;
  std::size_t where_block_begins(std::size_t t, std::size_t last) const;

  const std::vector<Index>&old_id_, &old_corners_;
  const TriangleMesh& skin_;
  bool identity_ = false;
  std::vector<Index> old_vertex_, new_vertex_, old_triangle_, new_triangle_;
};

}  // namespace isoskin
