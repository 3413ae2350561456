// What has become of a mesh since it was copied, told from the two alone: whoever keeps something by triangle or vertex
// goes on from there.
#pragma once

#include <vector>

#include <tbb/parallel_invoke.h>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// As much of a mesh as its changes are told by.
struct MeshCopy {
  std::vector<Index> vertex, id;  // three a triangle; one a vertex
  std::vector<Vec3> position;     // one a vertex

  MeshCopy() = default;
  explicit MeshCopy(const TriangleMesh& mesh) {
    // New columns, which copy_column() would fill twice.
    tbb::parallel_invoke([&] { vertex = mesh.vertex; },
                         [&] {
                           id = mesh.vertices.id;
                           position = mesh.vertices.position;
                         });
  }
};

struct MeshChanges {
  std::vector<Index> vertex_before;  // per vertex: the one with its id, kNone where there was none, or not in order
  std::vector<std::uint8_t> moved;   // per vertex: not where that was, or new
  std::vector<Index> lost, added;    // vertices of the copy and of the mesh without one in the other, ascending
  std::vector<Index> gone, fresh;    // triangles of the copy and of the mesh that are not triangles of the other with
                                     // their vertices in the same places, ascending

  bool none() const { return lost.empty() && added.empty() && gone.empty() && fresh.empty(); }
};

/// Edits keep what they leave in order, and so the two are walked through once, side by side; where the order is
/// another, more counts as changed than has.
MeshChanges mesh_changes(const MeshCopy& before, const TriangleMesh& mesh);

/// mesh_pieces(mesh), from those of the mesh before: where what is gone and what is fresh join the same vertices, what
/// hangs together is still the same.
MeshPieces mesh_pieces(const TriangleMesh& mesh, const MeshCopy& before, const MeshPieces& pieces_before,
                       const MeshChanges& changes);

}  // namespace isoskin
