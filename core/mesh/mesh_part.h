// A part of a mesh that may be edited and relaxed while the rest stays as it is.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh/edit.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// The new vertices of a mesh and the old ones within some rings of them. They are known by their ids, so that the part
/// goes on through edits, and what edits add to it belongs to it.
class MeshPart {
public:
  /// New are the vertices with ids from `first_new` on.
  MeshPart(const TriangleMesh& mesh, Index first_new, int rings);

  /// One byte a vertex: 1 where it is not of the part.
  std::vector<std::uint8_t> frozen(const TriangleMesh& mesh) const;

private:
  Index first_new_;
  std::vector<std::uint64_t> ring_;  // a bit an old id
};

/// Some of a mesh's triangles, with borders (twin kNone), and where they come from.
struct OpenPart {
  TriangleMesh mesh;            // positions and velocities only, in the whole mesh's order
  std::vector<Index> vertex;    // per vertex: its number in the whole mesh
  std::vector<Index> triangle;  // per triangle: the same
};

/// The triangles with a vertex that is not frozen, ascending; `frozen`: one byte a vertex, vertices beyond its end are
/// not. Parallel.
std::vector<Index> open_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen);
/// Those of them that are among some, which ascend.
std::vector<Index> open_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen,
                                  const std::vector<Index>& among);

/// What of a mesh may change: found once, it goes on through edits.
struct OpenSet {
  std::vector<std::uint8_t> frozen;  // one byte a vertex; empty: none is, and all triangles are open
  std::vector<Index> triangle;       // open_triangles() where some are frozen

  OpenSet() = default;
  OpenSet(const TriangleMesh& mesh, std::vector<std::uint8_t> frozen_vertices);
  /// `among`: one in which no less is open.
  OpenSet(const TriangleMesh& mesh, std::vector<std::uint8_t> frozen_vertices, const OpenSet& among);

  bool all() const { return frozen.empty(); }
  /// Of a mesh with triangles.
  bool none() const { return !all() && triangle.empty(); }
  /// After edits of what is open: new rows of the mesh before they are removed, and those that are then.
  void add_rows(const TriangleMesh& mesh, std::size_t triangles_before);
  void remove(const RemovedRows& rows);
};

/// open_triangles() as a mesh. Parallel.
OpenPart open_part(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen);
/// The same of a set in which not all is open.
OpenPart open_part(const TriangleMesh& mesh, const OpenSet& open);

}  // namespace isoskin
