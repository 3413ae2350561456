#include "core/topology/mesh_patch.h"

#include <algorithm>
#include <map>
#include <optional>
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

Index MeshPatch::add_vertex(const DVec3& position, std::vector<Index> like) {
  vertices_.push_back({position, std::move(like)});
  return first_new_ + Index(vertices_.size()) - 1;
}

void MeshPatch::add_triangle(Index a, Index b, Index c) {
  if (a != b && b != c && c != a) triangles_.push_back({a, b, c});
}

void MeshPatch::remove(const std::vector<Index>& triangles) {
  removed_.insert(removed_.end(), triangles.begin(), triangles.end());
}

bool MeshPatch::apply(TriangleMesh& mesh) const {
  // The halfedges that look into the hole, and those of the new triangles: each must meet its opposite, once.
  std::map<Edge, Index> open;
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
      if (!open.emplace(Edge(corner[k], corner[(k + 1) % 3]), h++).second) return false;
  for (const auto& [edge, g] : open) {
    if (!open.count(Edge(edge.second, edge.first))) return false;
    const bool old_edge = edge.first < first_new_ && edge.second < first_new_;
    const bool on_border = g < first_halfedge || open.at(Edge(edge.second, edge.first)) < first_halfedge;
    if (!old_edge || on_border) continue;
    const auto at = leaving.find(edge.first);
    if (at == leaving.end() || keeps_edge(mesh, dead, at->second, edge.second)) return false;
  }

  mesh.vertices.resize(first_new_ + vertices_.size());
  for (std::size_t i = 0; i < vertices_.size(); ++i) {
    const auto& [position, like] = vertices_[i];
    const Index v = first_new_ + Index(i);
    DVec3 rest(0.0), velocity(0.0);
    for (const Index l : like) {
      rest += DVec3(mesh.vertices.rest[l]) / double(like.size());
      velocity += DVec3(mesh.vertices.velocity[l]) / double(like.size());
    }
    mesh.vertices.position[v] = Vec3(position);
    mesh.vertices.rest[v] = like.empty() ? Vec3(position) : Vec3(rest);
    mesh.vertices.velocity[v] = Vec3(velocity);
    mesh.vertices.id[v] = mesh.next_id++;
    mesh.vertices.age[v] = 1;
  }
  for (const Index t : removed_)
    for (Index k = 3 * t; k < 3 * t + 3; ++k) mesh.vertex[k] = mesh.twin[k] = kNone;
  for (const auto& corner : triangles_) mesh.vertex.insert(mesh.vertex.end(), corner.begin(), corner.end());
  mesh.twin.resize(mesh.vertex.size());
  for (const auto& [edge, g] : open) mesh.twin[g] = open.at(Edge(edge.second, edge.first));
  compact(mesh);
  return true;
}

}  // namespace isoskin
