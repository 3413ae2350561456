#include "core/topology/filling.h"

#include <algorithm>
#include <functional>
#include <utility>

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
  for (Vec3& n : normals) {
    const float length = glm::length(n);
    n = length > 0.0f ? -n / length : Vec3(0.0f);
  }
  return normals;
}

Filling make_filling(OpenSurface surface, Backend& backend) {
  Filling filling;
  filling.surface = std::move(surface);
  const auto& s = filling.surface;
  filling.normal = field_normals(s.position, backend);
  filling.first.assign(s.position.size() + 1, 0);
  for (const Index v : s.triangle) filling.first[v] += 2;  // each halfedge is seen from both of its ends
  Index sum = 0;
  for (Index& f : filling.first) sum += std::exchange(f, sum);
  filling.edge.resize(sum);
  filling.count.assign(s.position.size(), 0);
  const auto add = [&](Index from, Index to, Index triangle) {
    filling.edge[filling.first[from] + filling.count[from]++] = {to, triangle};
  };
  for (Index h = 0; h < s.triangle.size(); ++h) {
    const Index a = s.triangle[h], b = s.triangle[TriangleMesh::next(h)];
    add(a, b, h / 3);
    add(b, a, kNone);
  }
  for_each_index(s.position.size(), [&](std::size_t v) {
    const auto begin = filling.edge.begin() + filling.first[v], end = begin + filling.count[v];
    std::sort(begin, end);  // a triangle comes before kNone
    filling.count[v] =
        Index(std::unique(begin, end, [](const auto& p, const auto& q) { return p.to == q.to; }) - begin);
  });
  filling.twin.resize(s.triangle.size());
  for_each_index(s.triangle.size(), [&](std::size_t h) {
    const Index end = s.triangle[TriangleMesh::next(Index(h))];
    const Index t = filling.triangle(end, s.triangle[h]);
    filling.twin[h] = kNone;
    for (Index k = 3 * t; t != kNone && k < 3 * t + 3; ++k)
      if (s.triangle[k] == end) filling.twin[h] = k;
  });
  return filling;
}

std::vector<Index> PathFinder::path(Index a, Index b, const std::vector<std::uint8_t>& used, float slack) {
  const auto& position = filling_.surface.position;
  const Vec3 from = position[a], to = position[b];
  const float straight = glm::length(to - from);
  const Vec3 line = straight > 0.0f ? (to - from) / straight : Vec3(0.0f);
  const auto off_line = [&](Index v) {
    const Vec3 d = position[v] - from;
    return glm::length(d - glm::dot(d, line) * line);
  };
  ++search_;
  open_.assign(1, {0.0f, a, kNone});
  while (!open_.empty()) {
    std::pop_heap(open_.begin(), open_.end(), std::greater<>());
    const auto [cost, v, before] = open_.back();
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
      if (glm::length(position[next] - from) + glm::length(position[next] - to) > straight + slack) continue;
      open_.emplace_back(cost + glm::length(position[next] - position[v]) + off_line(next), next, v);
      std::push_heap(open_.begin(), open_.end(), std::greater<>());
    }
  }
  return {};
}

}  // namespace isoskin
