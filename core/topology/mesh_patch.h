// Replaces a few triangles of a closed mesh by others: all or nothing.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// What an operation wants to do, collected before the mesh is touched. Corners of new triangles are vertices of the
/// mesh or numbers that add_vertex() returned.
class MeshPatch {
public:
  explicit MeshPatch(const TriangleMesh& mesh) : first_new_(Index(mesh.vertex_count())) {}

  /// A vertex at `position`; rest and velocity are the mean of the mesh's rows `like` (rest = position and no velocity
  /// when there are none; no velocity either when it `stands`, because it lies where the surface is going). It gets a
  /// fresh id and age 1.
  Index add_vertex(const DVec3& position, std::vector<Index> like, bool stands = false);
  /// Moves vertex v of the mesh to `position`, with the mean rest and velocity of the rows `like`; it keeps its id and
  /// gets age 1.
  void move_vertex(Index v, const DVec3& position, std::vector<Index> like);
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
  const std::vector<Index>& removed() const { return removed_; }
  /// Of the new triangles, world units^2.
  double area(const TriangleMesh& mesh) const;

  /// By how much apply() changes the Euler characteristic of the mesh.
  int euler_change(const TriangleMesh& mesh) const;

  /// False when apply() would be refused.
  bool fits(const TriangleMesh& mesh) const;
  /// Replaces the triangles, links the new ones and drops vertices no longer used; order is kept, new ones come last.
  /// False, and the mesh is as it was, when the new triangles do not fit the hole edge by edge, would make an edge
  /// between two old vertices that stays as well, lie back to back, or leave a vertex with two fans of triangles.
  bool apply(TriangleMesh& mesh) const;
  /// The same, but leaves dead triangles and unused vertices to a later compact(). So several patches made for one mesh
  /// can be applied one after the other, as long as no two remove triangles with a common vertex.
  bool splice(TriangleMesh& mesh) const;

private:
  struct NewVertex {
    DVec3 position;
    std::vector<Index> like;
    bool stands;
  };
  struct MovedVertex {
    Index vertex;
    DVec3 position;
    std::vector<Index> like;
  };
  using OpenEdges = std::map<std::pair<Index, Index>, Index>;  // ends, and the halfedge between them
  std::optional<OpenEdges> open_edges(const TriangleMesh& mesh) const;
  bool closes_fans(const TriangleMesh& mesh, const OpenEdges& open) const;
  void write_vertices(TriangleMesh& mesh) const;

  Index first_new_;
  std::vector<NewVertex> vertices_;
  std::vector<MovedVertex> moved_;
  std::vector<std::array<Index, 3>> triangles_;
  std::vector<Index> removed_;
};

}  // namespace isoskin
