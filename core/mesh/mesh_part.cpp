#include "core/mesh/mesh_part.h"

#include <algorithm>

#include <tbb/parallel_sort.h>

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

std::vector<Index> open_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen) {
  if (frozen.empty()) return indices_where(mesh.triangle_count(), [](Index) { return true; });
  if (frozen.size() == mesh.vertex_count() && std::find(frozen.begin(), frozen.end(), 0) == frozen.end()) return {};
  const auto is_open = [&](Index v) { return v >= frozen.size() || !frozen[v]; };
  return indices_where(mesh.triangle_count(), [&](Index t) {
    return is_open(mesh.vertex[3 * t]) || is_open(mesh.vertex[3 * t + 1]) || is_open(mesh.vertex[3 * t + 2]);
  });
}

OpenPart open_part(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen) {
  OpenPart part;
  part.triangle = open_triangles(mesh, frozen);
  for (const Index t : part.triangle)
    part.vertex.insert(part.vertex.end(), {mesh.vertex[3 * t], mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]});
  part.mesh.vertex = part.vertex;
  part.mesh.twin.resize(part.vertex.size());
  tbb::parallel_sort(part.vertex.begin(), part.vertex.end());
  part.vertex.erase(std::unique(part.vertex.begin(), part.vertex.end()), part.vertex.end());
  const auto number = [](const std::vector<Index>& of, Index whole) {
    const auto at = std::lower_bound(of.begin(), of.end(), whole);
    return at != of.end() && *at == whole ? Index(at - of.begin()) : kNone;
  };
  for_each_index(part.mesh.vertex.size(), [&](std::size_t h) {
    part.mesh.vertex[h] = number(part.vertex, part.mesh.vertex[h]);
    const Index twin = mesh.twin[3 * part.triangle[h / 3] + h % 3], t = number(part.triangle, twin / 3);
    part.mesh.twin[h] = t == kNone ? kNone : 3 * t + twin % 3;
  });
  VertexTable& table = part.mesh.vertices;
  table.position.resize(part.vertex.size());
  table.velocity.resize(part.vertex.size());
  for_each_index(part.vertex.size(), [&](std::size_t i) {
    table.position[i] = mesh.position(part.vertex[i]);
    table.velocity[i] = mesh.vertices.velocity[part.vertex[i]];
  });
  return part;
}

}  // namespace isoskin
