#include "core/topology/filling.h"

#include <algorithm>
#include <atomic>
#include <functional>

#include "core/mesh/triangle_mesh.h"
#include "core/parallel.h"

namespace isoskin {

Index Filling::triangle(Index from, Index to) const {
  for (const Edge& e : edges(from))
    if (e.to == to) return e.triangle;
  return kNone;
}

std::vector<Vec3> field_normals(const std::vector<Vec3>& points, Backend& backend) {
  std::vector<float> values(points.size());
  std::vector<Vec3> normals(points.size());
  backend.evaluate(points, values, normals);
  for_each_index(normals.size(), [&](std::size_t i) {
    const float length = glm::length(normals[i]);
    normals[i] = length > 0.0f ? -normals[i] / length : Vec3(0.0f);
  });
  return normals;
}

void Filling::catch_up(Backend& backend) {
  const Index first_halfedge = Index(twin.size());
  const std::vector<Vec3> fresh(surface.position.begin() + std::ptrdiff_t(normal.size()), surface.position.end());
  const std::vector<Vec3> of_fresh = field_normals(fresh, backend);
  normal.insert(normal.end(), of_fresh.begin(), of_fresh.end());
  const Index old_edges = Index(edge.size());
  make_room_for_edges(first_halfedge);
  const auto add = [&](Index from, Index to, Index triangle) {
    const Index slot = std::atomic_ref(count[from]).fetch_add(1, std::memory_order_relaxed);
    edge[first[from] + slot] = {to, triangle};
  };
  for_each_index(surface.triangle.size() - first_halfedge, [&](std::size_t i) {
    const Index h = first_halfedge + Index(i), a = surface.triangle[h], b = surface.triangle[TriangleMesh::next(h)];
    add(a, b, h / 3);
    add(b, a, kNone);
  });
  for_each_index(surface.position.size(), [&](std::size_t v) {
    if (first[v] < old_edges) return;  // has got no new ones
    const auto begin = edge.begin() + first[v], end = begin + count[v];
    std::sort(begin, end);  // a triangle comes before kNone
    count[v] = Index(std::unique(begin, end, [](const auto& p, const auto& q) { return p.to == q.to; }) - begin);
  });
  link_twins(first_halfedge);
}

/// Vertices of triangles from there on get twice as much, for each of their corners; their edges are moved to the end.
void Filling::make_room_for_edges(Index first_halfedge) {
  const std::size_t vertices = surface.position.size();
  std::vector<Index> more(vertices, 0), place(vertices);
  for_each_index(surface.triangle.size() - first_halfedge, [&](std::size_t i) {
    std::atomic_ref(more[surface.triangle[first_halfedge + i]]).fetch_add(2, std::memory_order_relaxed);
  });
  first.resize(vertices, 0);
  count.resize(vertices, 0);
  Index end = Index(edge.size());
  for (std::size_t v = 0; v < vertices; ++v) {
    place[v] = more[v] > 0 ? end : first[v];
    if (more[v] > 0) end += count[v] + more[v];
  }
  edge.resize(end);
  for_each_index(vertices, [&](std::size_t v) {
    if (more[v] > 0) std::copy_n(edge.begin() + first[v], count[v], edge.begin() + place[v]);
  });
  first = std::move(place);
}

void Filling::link_twins(Index first_halfedge) {
  twin.resize(surface.triangle.size(), kNone);
  for_each_index(surface.triangle.size() - first_halfedge, [&](std::size_t i) {
    const Index h = first_halfedge + Index(i), end = surface.triangle[TriangleMesh::next(h)];
    const Index t = triangle(end, surface.triangle[h]);
    for (Index k = 3 * t; t != kNone && k < 3 * t + 3; ++k)
      if (surface.triangle[k] == end) {
        twin[h] = k;
        if (k < first_halfedge) twin[k] = h;
      }
  });
}

std::vector<Index> PathFinder::path(Index a, Index b, const std::vector<std::uint8_t>& used, float slack) {
  // Of the distance that is left: that paths cost no less (A*, Hart, Nilsson and Raphael 1968) holds for rounded sums.
  constexpr float kSurely = 0.999f;
  const auto& position = filling_.surface.position;
  came_from_.resize(position.size());
  seen_in_.resize(position.size(), 0);
  const Vec3 from = position[a], to = position[b];
  const float straight = glm::length(to - from);
  const Vec3 line = straight > 0.0f ? (to - from) / straight : Vec3(0.0f);
  const auto off_line = [&](Index v) {
    const Vec3 d = position[v] - from;
    return glm::length(d - glm::dot(d, line) * line);
  };
  ++search_;
  open_.assign(1, {0.0f, 0.0f, a, kNone});
  while (!open_.empty()) {
    std::pop_heap(open_.begin(), open_.end(), std::greater<>());
    const auto [whole, cost, v, before] = open_.back();
    open_.pop_back();
    if (seen_in_[v] == search_) continue;
    seen_in_[v] = search_;
    came_from_[v] = before;
    if (v == b) {
      std::vector<Index> path;
      for (Index at = b; at != kNone; at = came_from_[at]) path.push_back(at);
      std::reverse(path.begin(), path.end());
      return path;
    }
    for (const auto& [next, triangle] : filling_.edges(v)) {
      if (seen_in_[next] == search_ || (used[next] && next != b)) continue;
      const float left = glm::length(position[next] - to);
      if (glm::length(position[next] - from) + left > straight + slack) continue;
      const float so_far = cost + glm::length(position[next] - position[v]) + off_line(next);
      open_.emplace_back(so_far + kSurely * left, so_far, next, v);
      std::push_heap(open_.begin(), open_.end(), std::greater<>());
    }
  }
  return {};
}

}  // namespace isoskin
