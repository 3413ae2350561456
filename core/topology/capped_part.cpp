#include "core/topology/capped_part.h"

#include <algorithm>
#include <utility>

#include "core/mesh/edit.h"
#include "core/mesh/one_ring.h"

namespace isoskin {
namespace {

/// Adds what lies about vertices where the border would meet itself; returns one byte a triangle of the whole.
std::vector<std::uint8_t> widen(const TriangleMesh& whole, std::vector<Index>& triangles) {
  std::vector<std::uint8_t> in(whole.triangle_count(), 0);
  for (const Index t : triangles) in[t] = 1;
  std::vector<Index> ask;
  for (const Index t : triangles)
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (!in[whole.twin[h] / 3]) ask.insert(ask.end(), {h, TriangleMesh::next(h)});
  while (!ask.empty()) {
    const Index start = ask.back();
    ask.pop_back();
    int changes = 0;
    for_each_leaving(whole, start, [&](Index h) { changes += in[h / 3] != in[whole.twin[h] / 3]; });
    if (changes <= 2) continue;
    for_each_leaving(whole, start, [&](Index h) {
      if (std::exchange(in[h / 3], 1)) return;
      triangles.push_back(h / 3);
      ask.insert(ask.end(), {h, TriangleMesh::next(h), TriangleMesh::prev(h)});
    });
  }
  std::sort(triangles.begin(), triangles.end());
  return in;
}

/// A fan over the border that `start`, which has no twin, lies on.
void cap(TriangleMesh& mesh, Index start) {
  const Index centre = Index(mesh.vertex_count());
  mesh.vertices.resize(centre + 1);
  mesh.vertices.position[centre] = mesh.position(mesh.from(start));
  mesh.vertices.id[centre] = mesh.next_id++;
  std::vector<Index> border;
  Index h = start;
  do {
    border.push_back(h);
    h = TriangleMesh::next(h);
    while (mesh.twin[h] != kNone) h = TriangleMesh::next(mesh.twin[h]);
  } while (h != start);
  const Index first = Index(mesh.vertex.size()), count = Index(border.size());
  for (Index i = 0; i < count; ++i) {
    const Index side = first + 3 * i;
    mesh.vertex.insert(mesh.vertex.end(), {mesh.to(border[i]), mesh.from(border[i]), centre});
    mesh.twin.insert(mesh.twin.end(),
                     {border[i], first + 3 * ((i + count - 1) % count) + 2, first + 3 * ((i + 1) % count) + 1});
    mesh.twin[border[i]] = side;
  }
}

/// The fans, and the rings about them.
std::vector<std::uint8_t> mark_edge(const CappedPart& part, int rings) {
  const TriangleMesh& mesh = part.mesh;
  std::vector<std::uint8_t> edge(mesh.triangle_count(), 0);
  std::fill(edge.begin() + std::ptrdiff_t(part.triangle.size()), edge.end(), 1);
  std::vector<Index> ring;
  for (Index t = Index(part.triangle.size()); t < edge.size(); ++t) ring.push_back(t);
  for (int i = 0; i < rings; ++i) {
    std::vector<Index> next;
    for (const Index t : ring)
      for (Index start = 3 * t; start < 3 * t + 3; ++start) {
        if (part.is_centre(mesh.from(start))) continue;
        for_each_leaving(mesh, start, [&](Index h) {
          if (!std::exchange(edge[h / 3], 1)) next.push_back(h / 3);
        });
      }
    ring = std::move(next);
  }
  return edge;
}

/// What is gone from the whole, and the vertices that nothing has any more: all about them is of the part.
RemovedRows rows_removed(const CappedPart& part, const TriangleMesh& now, const PartChanges& changes) {
  RemovedRows rows;
  for (const Index t : changes.gone) rows.triangle.push_back(part.triangle[t]);
  std::vector<std::uint8_t> used(part.mesh.vertex_count(), 0);
  auto gone = changes.gone.begin();
  for (Index t = 0; t < part.mesh.triangle_count(); ++t) {
    if (gone != changes.gone.end() && *gone == t) {
      ++gone;
      continue;
    }
    for (Index h = 3 * t; h < 3 * t + 3; ++h) used[part.mesh.vertex[h]] = 1;
  }
  for (const Index t : changes.fresh)
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (const Index v = changes.vertex[now.vertex[h]]; v != kNone) used[v] = 1;
  for (Index v = 0; v < part.vertex.size(); ++v)
    if (!used[v]) rows.vertex.push_back(part.vertex[v]);
  return rows;
}

}  // namespace

CappedPart cut_out(const TriangleMesh& whole, std::vector<Index> triangles, int rings) {
  const std::vector<std::uint8_t> in = widen(whole, triangles);
  CappedPart part;
  part.triangle = std::move(triangles);
  std::vector<Index> triangle_of(whole.triangle_count(), kNone), vertex_of(whole.vertex_count(), kNone);
  for (Index i = 0; i < part.triangle.size(); ++i) {
    triangle_of[part.triangle[i]] = i;
    for (Index h = 3 * part.triangle[i]; h < 3 * part.triangle[i] + 3; ++h)
      if (std::exchange(vertex_of[whole.vertex[h]], 0) == kNone) part.vertex.push_back(whole.vertex[h]);
  }
  std::sort(part.vertex.begin(), part.vertex.end());
  for (Index i = 0; i < part.vertex.size(); ++i) vertex_of[part.vertex[i]] = i;
  TriangleMesh& mesh = part.mesh;
  mesh.vertices = whole.vertices.select(part.vertex);
  mesh.next_id = whole.next_id;
  mesh.vertex.reserve(3 * part.triangle.size());
  mesh.twin.reserve(3 * part.triangle.size());
  for (const Index t : part.triangle)
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      const Index twin = whole.twin[h];
      mesh.vertex.push_back(vertex_of[whole.vertex[h]]);
      mesh.twin.push_back(in[twin / 3] ? 3 * triangle_of[twin / 3] + twin % 3 : kNone);
    }
  for (Index h = 0; h < 3 * part.triangle.size(); ++h)
    if (mesh.twin[h] == kNone) cap(mesh, h);
  part.edge = mark_edge(part, rings);
  return part;
}

PartChanges changes_of(const CappedPart& part, const TriangleMesh& now, Index first_new) {
  PartChanges changes;
  changes.vertex.assign(now.vertex_count(), kNone);
  Index old = 0;
  for (Index v = 0; v < first_new; ++v) {
    while (part.mesh.vertices.id[old] != now.vertices.id[v]) ++old;
    changes.vertex[v] = old++;
  }
  changes.was.assign(now.triangle_count(), kNone);
  const auto is_new = [&](Index t) {
    const Index* v = &now.vertex[3 * t];
    return v[0] >= first_new || v[1] >= first_new || v[2] >= first_new;
  };
  Index at = 0;
  for (Index t = 0; t < part.mesh.triangle_count(); ++t) {
    while (at < now.triangle_count() && is_new(at)) ++at;
    bool same = at < now.triangle_count();
    for (Index k = 0; k < 3 && same; ++k) same = changes.vertex[now.vertex[3 * at + k]] == part.mesh.vertex[3 * t + k];
    if (same) {
      changes.was[at++] = t;
    } else {
      changes.gone.push_back(t);
      changes.at_edge |= part.edge[t] != 0;
    }
  }
  for (Index t = 0; t < changes.was.size(); ++t)
    if (changes.was[t] == kNone) changes.fresh.push_back(t);
  return changes;
}

void put_back(const CappedPart& part, const TriangleMesh& now, const PartChanges& changes, TriangleMesh& whole) {
  const RemovedRows removed = rows_removed(part, now, changes);
  for (const Index t : changes.gone)
    for (Index h = 3 * part.triangle[t]; h < 3 * part.triangle[t] + 3; ++h) whole.vertex[h] = whole.twin[h] = kNone;
  std::vector<Index> number(now.vertex_count(), kNone), fresh_vertices, triangle(now.triangle_count(), kNone);
  Index next = Index(whole.triangle_count());
  for (const Index t : changes.fresh) {
    triangle[t] = next++;
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      Index& v = number[now.vertex[h]];
      if (v != kNone) continue;
      if (changes.vertex[now.vertex[h]] == kNone)
        fresh_vertices.push_back(now.vertex[h]), v = 0;
      else
        v = part.vertex[changes.vertex[now.vertex[h]]];
    }
  }
  std::sort(fresh_vertices.begin(), fresh_vertices.end());
  const Index first = Index(whole.vertex_count());
  VertexTable& table = whole.vertices;
  table.resize(first + fresh_vertices.size());
  for (Index i = 0; i < fresh_vertices.size(); ++i) {
    const Index v = fresh_vertices[i];
    number[v] = first + i;
    table.position[first + i] = now.position(v);
    table.rest[first + i] = now.vertices.rest[v];
    table.velocity[first + i] = now.vertices.velocity[v];
    table.age[first + i] = now.vertices.age[v];
    table.id[first + i] = whole.next_id++;
  }
  whole.vertex.resize(3 * std::size_t{next});
  whole.twin.resize(3 * std::size_t{next});
  for (const Index t : changes.fresh)
    for (Index k = 0; k < 3; ++k) {
      const Index h = 3 * triangle[t] + k, twin = now.twin[3 * t + k], was = changes.was[twin / 3];
      const Index other = (was == kNone ? 3 * triangle[twin / 3] : 3 * part.triangle[was]) + twin % 3;
      whole.vertex[h] = number[now.vertex[3 * t + k]];
      whole.twin[h] = other;
      whole.twin[other] = h;
    }
  remove_rows(whole, removed);
}

}  // namespace isoskin
