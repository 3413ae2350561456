#include "core/topology/droplets.h"

#include <algorithm>
#include <map>
#include <vector>

#include "core/mesh/small_pieces.h"
#include "core/topology/mesh_patch.h"
#include "core/topology/mesh_probe.h"

namespace isoskin {
namespace {

double mean_edge_of(const TriangleMesh& mesh, const std::vector<Index>& piece) {
  double sum = 0.0;
  for (const Index t : piece)
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      sum += glm::distance(mesh.position(mesh.from(h)), mesh.position(mesh.to(h)));
  return sum / double(3 * piece.size());
}

/// 1-to-4; the triangles cut and the new ones go into the patch, the middles of edges into `middles`.
struct Subdivision {
  explicit Subdivision(const TriangleMesh& m) : mesh(m), patch(m) {}

  const TriangleMesh& mesh;
  MeshPatch patch;
  std::map<std::pair<Index, Index>, Index> vertex_of_edge;

  Index middle(Index a, Index b) {
    const auto [it, fresh] = vertex_of_edge.try_emplace(std::minmax(a, b), kNone);
    if (fresh) it->second = patch.add_vertex(0.5 * (DVec3(mesh.position(a)) + DVec3(mesh.position(b))), {a, b});
    return it->second;
  }
  void cut(const std::vector<Index>& piece) {
    for (const Index t : piece) {
      const Index a = mesh.vertex[3 * t], b = mesh.vertex[3 * t + 1], c = mesh.vertex[3 * t + 2];
      const Index ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      patch.add_triangle(a, ab, ca);
      patch.add_triangle(b, bc, ab);
      patch.add_triangle(c, ca, bc);
      patch.add_triangle(ab, bc, ca);
    }
    patch.remove(piece);
  }
};

/// Some triangle of each small piece with a vertex that is not frozen.
std::vector<Index> small_piece_triangles(const TriangleMesh& mesh, const OpenSet& open) {
  const std::vector<Index> vertices =
      open.all() ? small_piece_vertices(mesh) : small_piece_vertices(mesh, open.triangle);
  std::vector<Index> triangles;
  if (vertices.empty()) return triangles;
  for (Index h = 0; h < mesh.vertex.size(); h += 3)
    if (std::binary_search(vertices.begin(), vertices.end(), mesh.vertex[h]) &&
        piece_of(mesh, TriangleMesh::triangle(h)).front() == TriangleMesh::triangle(h))
      triangles.push_back(TriangleMesh::triangle(h));
  return triangles;
}

}  // namespace

std::size_t grow_small_pieces(TriangleMesh& mesh, Backend& backend, const ProjectOptions& project, double edge_length,
                              const OpenSet& open) {
  constexpr int kLevels = 3;
  const double longest = kSmallPieceEdge * edge_length;
  std::vector<Index> grown = small_piece_triangles(mesh, open);
  std::size_t count = 0;
  for (int level = 0; level < kLevels; ++level) {
    std::erase_if(grown, [&](Index t) { return mean_edge_of(mesh, piece_of(mesh, t)) <= longest; });
    if (grown.empty()) break;
    if (level == 0) count = grown.size();
    Subdivision subdivision(mesh);
    std::vector<Index> ids;  // of a vertex of each piece, to find it again
    for (const Index t : grown) {
      ids.push_back(mesh.vertices.id[mesh.vertex[3 * t]]);
      subdivision.cut(piece_of(mesh, t));
    }
    const Index first_new = mesh.next_id;
    if (!subdivision.patch.apply(mesh)) break;
    std::vector<Index> fresh;
    std::vector<Vec3> position;
    for (Index v = 0; v < mesh.vertex_count(); ++v)
      if (mesh.vertices.id[v] >= first_new) {
        fresh.push_back(v);
        position.push_back(mesh.position(v));
      }
    backend.project(position, project, {});
    for (std::size_t i = 0; i < fresh.size(); ++i) mesh.vertices.position[fresh[i]] = position[i];
    for (std::size_t i = 0; i < grown.size(); ++i) {
      const Index v =
          Index(std::find(mesh.vertices.id.begin(), mesh.vertices.id.end(), ids[i]) - mesh.vertices.id.begin());
      grown[i] =
          TriangleMesh::triangle(Index(std::find(mesh.vertex.begin(), mesh.vertex.end(), v) - mesh.vertex.begin()));
    }
  }
  return count;
}

}  // namespace isoskin
