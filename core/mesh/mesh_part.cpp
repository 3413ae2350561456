#include "core/mesh/mesh_part.h"

#include <algorithm>
#include <utility>

#include "core/mesh/independent_edits.h"
#include "core/mesh/ranks.h"
#include "core/parallel.h"

namespace isoskin {

MeshPart::MeshPart(const TriangleMesh& mesh, Index first_new, int rings)
    : first_new_(first_new), ring_(first_new / 64 + 1, 0) {
  std::vector<std::uint8_t> inside(mesh.vertex_count());
  for_each_index(inside.size(), [&](std::size_t v) { inside[v] = mesh.vertices.id[v] >= first_new; });
  for (int ring = 0; ring < rings; ++ring) {
    const std::vector<Index> about = indices_where(mesh.triangle_count(), [&](Index t) {
      const int corners = inside[mesh.vertex[3 * t]] + inside[mesh.vertex[3 * t + 1]] + inside[mesh.vertex[3 * t + 2]];
      return corners == 1 || corners == 2;
    });
    for (const Index t : about)
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        if (std::exchange(inside[mesh.vertex[h]], 1)) continue;
        const Index id = mesh.vertices.id[mesh.vertex[h]];
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

std::vector<Index> open_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen,
                                  const std::vector<Index>& among) {
  const auto is_open = [&](Index v) { return v >= frozen.size() || !frozen[v]; };
  constexpr std::size_t kBlock = 1024;
  return collect(among.size(), kBlock, [&](Index i, std::vector<Index>& list) {
    const Index* const corner = &mesh.vertex[3 * std::size_t{among[i]}];
    if (is_open(corner[0]) || is_open(corner[1]) || is_open(corner[2])) list.push_back(among[i]);
  });
}

OpenSet::OpenSet(const TriangleMesh& mesh, std::vector<std::uint8_t> frozen_vertices)
    : frozen(std::move(frozen_vertices)) {
  if (!all()) triangle = open_triangles(mesh, frozen);
}

OpenSet::OpenSet(const TriangleMesh& mesh, std::vector<std::uint8_t> frozen_vertices, const OpenSet& among)
    : frozen(std::move(frozen_vertices)) {
  if (all()) return;
  if (among.all())
    triangle = open_triangles(mesh, frozen);
  else
    triangle = open_triangles(mesh, frozen, among.triangle);
}

void OpenSet::add_rows(const TriangleMesh& mesh, std::size_t triangles_before) {
  if (all()) return;
  frozen.resize(mesh.vertex_count(), 0);
  for (std::size_t t = triangles_before; t < mesh.triangle_count(); ++t) triangle.push_back(Index(t));
}

void OpenSet::remove(const RemovedRows& rows) {
  if (all()) return;
  remove_rows(frozen, rows.vertex);
  auto gone = rows.triangle.begin();
  std::size_t kept = 0;
  for (const Index t : triangle) {
    while (gone != rows.triangle.end() && *gone < t) ++gone;
    if (gone == rows.triangle.end() || *gone != t) triangle[kept++] = t - Index(gone - rows.triangle.begin());
  }
  triangle.resize(kept);
}

OpenPart open_part(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen) {
  OpenSet open;
  open.frozen = frozen;
  open.triangle = open_triangles(mesh, frozen);
  return open_part(mesh, open);
}

OpenPart open_part(const TriangleMesh& mesh, const OpenSet& open) {
  OpenPart part;
  part.triangle = open.triangle;
  std::vector<Index> corner(3 * part.triangle.size());
  for_each_index(corner.size(), [&](std::size_t h) { corner[h] = mesh.vertex[3 * part.triangle[h / 3] + h % 3]; });
  const Ranks vertices(mesh.vertex_count(), corner), triangles(mesh.triangle_count(), part.triangle);
  part.vertex = vertices.numbers();
  part.mesh.vertex.resize(corner.size());
  part.mesh.twin.resize(corner.size());
  for_each_index(corner.size(), [&](std::size_t h) {
    part.mesh.vertex[h] = vertices.below(corner[h]);
    const Index twin = mesh.twin[3 * part.triangle[h / 3] + h % 3];
    part.mesh.twin[h] =
        twin != kNone && triangles.contains(twin / 3) ? 3 * triangles.below(twin / 3) + twin % 3 : kNone;
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
