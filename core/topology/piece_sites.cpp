#include "core/topology/piece_sites.h"

#include "core/mechanics/motion.h"
#include "core/mesh/folds.h"
#include "core/topology/crumples.h"
#include "core/topology/match.h"
#include "core/topology/necks.h"

namespace isoskin {

std::vector<std::size_t> sizes_of(const MeshPieces& pieces) {
  std::vector<std::size_t> sizes(pieces.count(), 0);
  for (const Index piece : pieces.of_vertex)
    if (piece != kNone) ++sizes[piece];
  return sizes;
}

void add_small_pieces(const TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                      std::size_t most_vertices, BadSites& sites) {
  const std::vector<std::size_t> sizes = sizes_of(pieces);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Index piece = pieces.of_vertex[v];
    if (piece != kNone && certificate.mesh_piece[piece] != Fault::none && sizes[piece] <= most_vertices)
      sites.add(mesh.position(v), true);
  }
}

void add_bridges(const TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                 const BrickLattice& lattice, const LatticeTopology& topology, BadSites& sites) {
  std::vector<std::uint8_t> merged(mesh.vertex_count());
  for (Index v = 0; v < merged.size(); ++v)
    merged[v] = pieces.of_vertex[v] != kNone && certificate.mesh_piece[pieces.of_vertex[v]] == Fault::merged;
  for (const Index v : vertices_between_pieces(mesh, merged, lattice, topology)) sites.add(mesh.position(v), false);
}

void add_necks(const TriangleMesh& mesh, const std::vector<std::uint8_t>& failed, BadSites& sites) {
  const std::vector<std::uint8_t> neck = neck_vertices(mesh, failed);
  for (Index v = 0; v < neck.size(); ++v)
    if (neck[v]) sites.add(mesh.position(v), false, true);
}

void add_crumples(const TriangleMesh& mesh, double edge_length, Backend& backend, BadSites& sites) {
  const std::vector<std::uint8_t> folded = folded_triangles(mesh, outward_normals(mesh.vertices.position, backend));
  for (const Index t : crumpled_triangles(mesh, folded, float(edge_length))) {
    Vec3 sum(0.0f);
    for (Index h = 3 * t; h < 3 * t + 3; ++h) sum += mesh.position(mesh.vertex[h]);
    sites.add(sum / 3.0f, true);
  }
}

}  // namespace isoskin
