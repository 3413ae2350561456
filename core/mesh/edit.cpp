#include "core/mesh/edit.h"

#include <algorithm>
#include <cstdint>

#include <tbb/parallel_invoke.h>

#include "core/mesh/independent_edits.h"
#include "core/mesh/ranks.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

void link(TriangleMesh& mesh, Index h, Index g) {
  mesh.twin[h] = g;
  mesh.twin[g] = h;
}

bool has_edge(const TriangleMesh& mesh, Index leaving, Index end) {
  Index k = leaving;
  do {
    if (mesh.to(k) == end) return true;
    k = mesh.turn(k);
  } while (k != leaving);
  return false;
}

Index valence(const TriangleMesh& mesh, Index leaving) {
  Index count = 0, k = leaving;
  do {
    ++count;
    k = mesh.turn(k);
  } while (k != leaving);
  return count;
}

void set_triangle(TriangleMesh& mesh, Index h, Index a, Index b, Index c) {
  mesh.vertex[h] = a;
  mesh.vertex[mesh.next(h)] = b;
  mesh.vertex[mesh.prev(h)] = c;
}

}  // namespace

bool link_condition(const TriangleMesh& mesh, Index h) {
  const Index g = mesh.twin[h];
  if (valence(mesh, h) == 3 && valence(mesh, g) == 3) return false;  // a tetrahedron
  int common = 0;
  for (Index k = mesh.turn(h); k != h; k = mesh.turn(k)) common += has_edge(mesh, g, mesh.to(k));
  return common == 2;
}

bool can_flip(const TriangleMesh& mesh, Index h) {
  const Index c = mesh.prev(h), d = mesh.prev(mesh.twin[h]);
  return !has_edge(mesh, c, mesh.from(d));
}

void flip_edge(TriangleMesh& mesh, Index h) {
  const Index g = mesh.twin[h];
  const Index a = mesh.from(h), b = mesh.from(g), c = mesh.from(mesh.prev(h)), d = mesh.from(mesh.prev(g));
  const Index bc = mesh.twin[mesh.next(h)], ca = mesh.twin[mesh.prev(h)];
  const Index ad = mesh.twin[mesh.next(g)], db = mesh.twin[mesh.prev(g)];
  set_triangle(mesh, h, d, c, a);
  set_triangle(mesh, g, c, d, b);
  link(mesh, mesh.next(h), ca);
  link(mesh, mesh.prev(h), ad);
  link(mesh, mesh.next(g), db);
  link(mesh, mesh.prev(g), bc);
  for (const Index v : {a, b, c, d}) mesh.vertices.age[v] = 0;
}

void split_edge_into(TriangleMesh& mesh, Index h, float t, Index m, Index triangle) {
  const Index g = mesh.twin[h];
  const Index a = mesh.from(h), b = mesh.from(g), c = mesh.from(mesh.prev(h)), d = mesh.from(mesh.prev(g));
  const Index bc = mesh.twin[mesh.next(h)], db = mesh.twin[mesh.prev(g)];
  const Index p = 3 * triangle, q = 3 * triangle + 3;
  mesh.vertices.blend(m, a, b, t);
  set_triangle(mesh, h, a, m, c);
  set_triangle(mesh, g, m, a, d);
  set_triangle(mesh, p, m, b, c);
  set_triangle(mesh, q, b, m, d);
  link(mesh, p, q);
  link(mesh, p + 1, bc);
  link(mesh, p + 2, mesh.next(h));
  link(mesh, q + 1, mesh.prev(g));
  link(mesh, q + 2, db);
}

Index split_edge(TriangleMesh& mesh, Index h, float t) {
  const Index m = Index(mesh.vertex_count()), triangle = Index(mesh.triangle_count());
  mesh.vertices.resize(m + 1);
  mesh.vertices.id[m] = mesh.next_id++;
  mesh.vertex.resize(mesh.vertex.size() + 6);
  mesh.twin.resize(mesh.vertex.size());
  split_edge_into(mesh, h, t, m, triangle);
  return m;
}

void collapse_edge(TriangleMesh& mesh, Index h, float t) {
  const Index g = mesh.twin[h];
  const Index a = mesh.from(h), b = mesh.from(g);
  mesh.vertices.blend(a, a, b, t);
  Index k = g;
  do {
    mesh.vertex[k] = a;
    k = mesh.turn(k);
  } while (k != g);
  link(mesh, mesh.twin[mesh.next(h)], mesh.twin[mesh.prev(h)]);
  link(mesh, mesh.twin[mesh.next(g)], mesh.twin[mesh.prev(g)]);
  for (const Index dead : {h, g})
    for (const Index k3 : {dead, mesh.next(dead), mesh.prev(dead)}) mesh.vertex[k3] = mesh.twin[k3] = kNone;
}

void remove_rows(TriangleMesh& mesh, const RemovedRows& rows) {
  if (rows.triangle.empty() && rows.vertex.empty()) return;
  const Ranks dead_triangles(mesh.triangle_count(), rows.triangle), unused_vertices(mesh.vertex_count(), rows.vertex);
  const Index first_vertex = rows.vertex.empty() ? kNone : rows.vertex.front(),
              first_halfedge = rows.triangle.empty() ? kNone : 3 * rows.triangle.front();
  for_each_index(mesh.vertex.size(), [&](std::size_t h) {
    if (mesh.vertex[h] == kNone) return;
    if (mesh.vertex[h] > first_vertex) mesh.vertex[h] -= unused_vertices.below(mesh.vertex[h]);
    if (mesh.twin[h] > first_halfedge) mesh.twin[h] -= 3 * dead_triangles.below(mesh.twin[h] / 3);
  });
  VertexTable& table = mesh.vertices;
  tbb::parallel_invoke([&] { remove_rows(mesh.vertex, rows.triangle, 3); },
                       [&] { remove_rows(mesh.twin, rows.triangle, 3); },
                       [&] { remove_rows(table.position, rows.vertex); }, [&] { remove_rows(table.rest, rows.vertex); },
                       [&] { remove_rows(table.velocity, rows.vertex); },
                       [&] {
                         remove_rows(table.id, rows.vertex);
                         remove_rows(table.age, rows.vertex);
                       });
}

void compact(TriangleMesh& mesh) {
  RemovedRows rows;
  rows.triangle = indices_where(mesh.triangle_count(), [&](Index t) { return mesh.vertex[3 * t] == kNone; });
  std::vector<std::uint8_t> used(mesh.vertex_count(), 0);
  for_each_index(mesh.vertex.size(), [&](std::size_t h) {
    if (mesh.vertex[h] != kNone)
      std::atomic_ref<std::uint8_t>(used[mesh.vertex[h]]).store(1, std::memory_order_relaxed);
  });
  rows.vertex = indices_where(mesh.vertex_count(), [&](Index v) { return !used[v]; });
  remove_rows(mesh, rows);
}

}  // namespace isoskin
