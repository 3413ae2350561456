// Replaces a few triangles of a closed mesh by others: all or nothing.
#pragma once

#include <array>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// What an operation wants to do, collected before the mesh is touched. Corners of new triangles are vertices of the
/// mesh or numbers that add_vertex() returned.
class MeshPatch {
public:
  explicit MeshPatch(const TriangleMesh& mesh) : first_new_(Index(mesh.vertex_count())) {}

  /// A vertex at `position`; rest and velocity are the mean of the mesh's rows `like` (rest = position and no velocity
  /// when there are none). It gets a fresh id and age 1.
  Index add_vertex(const DVec3& position, std::vector<Index> like);
  /// Counter-clockwise seen from outside; passed over when two corners are the same.
  void add_triangle(Index a, Index b, Index c);
  void remove(const std::vector<Index>& triangles);

  /// Of a vertex of the mesh or a new one.
  DVec3 position(const TriangleMesh& mesh, Index v) const {
    return v < first_new_ ? DVec3(mesh.position(v)) : vertices_[v - first_new_].position;
  }

  std::size_t vertices_added() const { return vertices_.size(); }
  std::size_t triangles_added() const { return triangles_.size(); }
  std::size_t triangles_removed() const { return removed_.size(); }

  /// Replaces the triangles, links the new ones and drops vertices no longer used; order is kept, new ones come last.
  /// False, and the mesh is as it was, when the new triangles do not fit the hole edge by edge, or would make an edge
  /// between two old vertices that stays as well.
  bool apply(TriangleMesh& mesh) const;

private:
  struct NewVertex {
    DVec3 position;
    std::vector<Index> like;
  };
  Index first_new_;
  std::vector<NewVertex> vertices_;
  std::vector<std::array<Index, 3>> triangles_;
  std::vector<Index> removed_;
};

}  // namespace isoskin
