#include "core/topology/mesh_patch.h"

#include <algorithm>
#include <set>
#include <unordered_set>

#include "core/mesh/edit.h"

namespace isoskin {
namespace {

using Edge = std::pair<Index, Index>;

/// True when the mesh has an edge from the start of `leaving` to `end` that is not removed with both its triangles.
bool keeps_edge(const TriangleMesh& mesh, const std::unordered_set<Index>& dead, Index leaving, Index end) {
  Index k = leaving;
  do {
    const bool gone = dead.count(TriangleMesh::triangle(k)) && dead.count(TriangleMesh::triangle(mesh.twin[k]));
    if (mesh.to(k) == end && !gone) return true;
    k = mesh.turn(k);
  } while (k != leaving);
  return false;
}

}  // namespace

Index MeshPatch::add_vertex(const DVec3& position, std::vector<Index> like, bool stands) {
  vertices_.push_back({position, std::move(like), stands});
  return first_new_ + Index(vertices_.size()) - 1;
}

void MeshPatch::move_vertex(Index v, const DVec3& position, std::vector<Index> like) {
  moved_.push_back({v, position, std::move(like)});
}

void MeshPatch::add_triangle(Index a, Index b, Index c) {
  if (a != b && b != c && c != a) triangles_.push_back({a, b, c});
}

void MeshPatch::remove(const std::vector<Index>& triangles) {
  removed_.insert(removed_.end(), triangles.begin(), triangles.end());
}

double MeshPatch::area(const TriangleMesh& mesh) const {
  const auto place = [&](Index v) {
    const auto moved = std::find_if(moved_.begin(), moved_.end(), [&](const MovedVertex& m) { return m.vertex == v; });
    return moved == moved_.end() ? position(mesh, v) : moved->position;
  };
  double sum = 0.0;
  for (const auto& [a, b, c] : triangles_)
    sum += 0.5 * glm::length(glm::cross(place(b) - place(a), place(c) - place(a)));
  return sum;
}

bool MeshPatch::apply(TriangleMesh& mesh) const {
  if (!splice(mesh)) return false;
  compact(mesh);
  return true;
}

/// Means are taken of the rows as they were: the moved ones are written last.
void MeshPatch::write_vertices(TriangleMesh& mesh) const {
  VertexTable& table = mesh.vertices;
  struct Mean {
    DVec3 rest{0.0}, velocity{0.0};
  };
  const auto mean_of = [&](const std::vector<Index>& like) {
    Mean mean;
    for (const Index l : like) {
      mean.rest += DVec3(table.rest[l]) / double(like.size());
      mean.velocity += DVec3(table.velocity[l]) / double(like.size());
    }
    return mean;
  };
  const auto write = [&](Index v, const DVec3& at, const Mean& mean) {
    table.position[v] = Vec3(at);
    table.rest[v] = Vec3(mean.rest);
    table.velocity[v] = Vec3(mean.velocity);
    table.age[v] = 1;
  };
  std::vector<Mean> of_moved;
  for (const MovedVertex& moved : moved_) of_moved.push_back(mean_of(moved.like));
  Index v = Index(mesh.vertex_count());
  table.resize(v + vertices_.size());
  for (const auto& [at, like, stands] : vertices_) {
    Mean mean = like.empty() ? Mean{at, DVec3(0.0)} : mean_of(like);
    if (stands) mean.velocity = DVec3(0.0);
    write(v, at, mean);
    table.id[v++] = mesh.next_id++;
  }
  for (std::size_t i = 0; i < moved_.size(); ++i) write(moved_[i].vertex, moved_[i].position, of_moved[i]);
}

/// The halfedges that look into the hole, and those of the new triangles: each must meet its opposite, once.
std::optional<MeshPatch::OpenEdges> MeshPatch::open_edges(const TriangleMesh& mesh) const {
  OpenEdges open;
  std::map<Index, Index> leaving;  // of hole vertices: some halfedge, to go round them
  const std::unordered_set<Index> dead(removed_.begin(), removed_.end());
  for (const Index t : removed_)
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      leaving.emplace(mesh.from(h), h);
      const Index g = mesh.twin[h];
      if (!dead.count(TriangleMesh::triangle(g))) open.emplace(Edge(mesh.from(g), mesh.to(g)), g);
    }
  const Index first_halfedge = Index(mesh.vertex.size());
  Index h = first_halfedge;
  for (const auto& corner : triangles_)
    for (int k = 0; k < 3; ++k)
      if (!open.emplace(Edge(corner[k], corner[(k + 1) % 3]), h++).second) return std::nullopt;
  for (const auto& [edge, g] : open) {
    if (!open.count(Edge(edge.second, edge.first))) return std::nullopt;
    const bool old_edge = edge.first < first_new_ && edge.second < first_new_;
    const bool on_border = g < first_halfedge || open.at(Edge(edge.second, edge.first)) < first_halfedge;
    if (!old_edge || on_border) continue;
    const auto at = leaving.find(edge.first);
    if (at == leaving.end() || keeps_edge(mesh, dead, at->second, edge.second)) return std::nullopt;
  }
  const auto partner = [&](const std::array<Index, 3>& corner, int k) {
    return open.at(Edge(corner[(k + 1) % 3], corner[k])) / 3;
  };
  for (const auto& corner : triangles_) {
    const Index a = partner(corner, 0), b = partner(corner, 1), c = partner(corner, 2);
    if (a == b || b == c || c == a) return std::nullopt;  // two triangles back to back
  }
  if (!closes_fans(mesh, open)) return std::nullopt;
  return open;
}

/// One fan about every corner of a new triangle: walking round it meets all its triangles, those that stay and new
/// ones.
bool MeshPatch::closes_fans(const TriangleMesh& mesh, const OpenEdges& open) const {
  const Index first_halfedge = Index(mesh.vertex.size());
  const std::unordered_set<Index> dead(removed_.begin(), removed_.end());
  std::map<Index, std::size_t> triangles_at;  // corners of new triangles
  std::map<Index, Index> leaving;
  for (std::size_t i = 0; i < 3 * triangles_.size(); ++i) {
    const Index v = triangles_[i / 3][i % 3];
    ++triangles_at[v];
    leaving.emplace(v, first_halfedge + Index(i));
  }
  std::unordered_set<Index> counted;
  for (const Index t : removed_)
    for (Index start = 3 * t; start < 3 * t + 3; ++start) {
      const auto at = triangles_at.find(mesh.from(start));
      if (at == triangles_at.end() || !counted.insert(mesh.from(start)).second) continue;
      for (Index h = mesh.turn(start); h != start; h = mesh.turn(h))
        at->second += !dead.count(TriangleMesh::triangle(h));
    }
  const auto from = [&](Index h) {
    return h < first_halfedge ? mesh.from(h) : triangles_[(h - first_halfedge) / 3][(h - first_halfedge) % 3];
  };
  const auto turn = [&](Index h) {
    const Index to = from(TriangleMesh::next(h));
    const bool opened = h >= first_halfedge || dead.count(TriangleMesh::triangle(mesh.twin[h]));
    return TriangleMesh::next(opened ? open.at(Edge(to, from(h))) : mesh.twin[h]);
  };
  return std::all_of(leaving.begin(), leaving.end(), [&](const auto& corner) {
    std::size_t met = 1;
    for (Index h = turn(corner.second); h != corner.second; h = turn(h)) ++met;
    return met == triangles_at[corner.first];
  });
}

int MeshPatch::euler_change(const TriangleMesh& mesh) const {
  std::set<Index> used, dropped;
  for (const auto& triangle : triangles_) used.insert(triangle.begin(), triangle.end());
  const std::set<Index> gone(removed_.begin(), removed_.end());
  for (const Index t : gone)
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      bool stays = used.count(mesh.from(h)) > 0;
      Index around = h;
      do {
        stays |= !gone.count(TriangleMesh::triangle(around));
        around = mesh.turn(around);
      } while (around != h && !stays);
      if (!stays) dropped.insert(mesh.from(h));
    }
  const auto fresh = std::distance(used.lower_bound(first_new_), used.end());
  return int(fresh) - int(dropped.size()) - (int(triangles_.size()) - int(gone.size())) / 2;
}

bool MeshPatch::fits(const TriangleMesh& mesh) const {
  return open_edges(mesh).has_value();
}

bool MeshPatch::splice(TriangleMesh& mesh) const {
  const std::optional<OpenEdges> open = open_edges(mesh);
  if (!open) return false;
  const Index shift = Index(mesh.vertex_count()) - first_new_;  // other patches have added vertices meanwhile
  write_vertices(mesh);
  for (const Index t : removed_)
    for (Index k = 3 * t; k < 3 * t + 3; ++k) mesh.vertex[k] = mesh.twin[k] = kNone;
  for (const auto& corner : triangles_)
    for (const Index v : corner) mesh.vertex.push_back(v < first_new_ ? v : v + shift);
  mesh.twin.resize(mesh.vertex.size());
  for (const auto& [edge, g] : *open) mesh.twin[g] = open->at(Edge(edge.second, edge.first));
  return true;
}

}  // namespace isoskin
