#include "core/mesh/mesh_part.h"

#include <algorithm>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"

namespace isoskin {

MeshPart::MeshPart(const TriangleMesh& mesh, Index first_new, int rings)
    : first_new_(first_new), ring_(first_new / 64 + 1, 0) {
  std::vector<std::uint8_t> inside(mesh.vertex_count());
  for_each_index(inside.size(), [&](std::size_t v) { inside[v] = mesh.vertices.id[v] >= first_new; });
  for (int ring = 0; ring < rings; ++ring) {
    const std::vector<Index> leaving =
        indices_where(mesh.vertex.size(), [&](Index h) { return inside[mesh.from(h)] && !inside[mesh.to(h)]; });
    for (const Index h : leaving) {
      if (inside[mesh.to(h)]) continue;
      inside[mesh.to(h)] = 1;
      const Index id = mesh.vertices.id[mesh.to(h)];
      ring_[id / 64] |= std::uint64_t(1) << id % 64;
    }
  }
}

std::vector<std::uint8_t> MeshPart::frozen(const TriangleMesh& mesh) const {
  std::vector<std::uint8_t> frozen(mesh.vertex_count());
  for_each_index(frozen.size(), [&](std::size_t v) {
    const Index id = mesh.vertices.id[v];
    frozen[v] = id < first_new_ && !(ring_[id / 64] >> id % 64 & 1);
  });
  return frozen;
}

OpenPart open_part(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen) {
  OpenPart part;
  part.triangle = indices_where(mesh.triangle_count(), [&](Index t) {
    return !frozen[mesh.vertex[3 * t]] || !frozen[mesh.vertex[3 * t + 1]] || !frozen[mesh.vertex[3 * t + 2]];
  });
  for (const Index t : part.triangle)
    part.vertex.insert(part.vertex.end(), {mesh.vertex[3 * t], mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]});
  part.mesh.vertex = part.vertex;
  std::sort(part.vertex.begin(), part.vertex.end());
  part.vertex.erase(std::unique(part.vertex.begin(), part.vertex.end()), part.vertex.end());
  for_each_index(part.mesh.vertex.size(), [&](std::size_t h) {
    Index& v = part.mesh.vertex[h];
    v = Index(std::lower_bound(part.vertex.begin(), part.vertex.end(), v) - part.vertex.begin());
  });
  for (const Index v : part.vertex) part.mesh.vertices.position.push_back(mesh.position(v));
  return part;
}

}  // namespace isoskin
