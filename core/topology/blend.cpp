#include "core/topology/blend.h"

#include <algorithm>
#include <limits>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "core/mesh/one_ring.h"

namespace isoskin {
namespace {

/// Neighbouring border vertices that become one, and where they are.
struct Group {
  std::vector<Index> members;
  DVec3 mean{0.0};
};

Group merged(const Group& first, const Group& second) {
  Group both = first;
  both.members.insert(both.members.end(), second.members.begin(), second.members.end());
  const double n = double(first.members.size()), m = double(second.members.size());
  both.mean = (n * first.mean + m * second.mean) / (n + m);
  return both;
}

/// The members of both, repeated so that each group counts for half.
std::vector<Index> with_equal_weight(const Group& first, const Group& second) {
  std::vector<Index> members;
  for (std::size_t i = 0; i < second.members.size(); ++i)
    members.insert(members.end(), first.members.begin(), first.members.end());
  for (std::size_t i = 0; i < first.members.size(); ++i)
    members.insert(members.end(), second.members.begin(), second.members.end());
  return members;
}

std::vector<Group> groups_of(const TriangleMesh& mesh, const std::vector<Index>& border) {
  std::vector<Group> groups;
  for (const Index h : border) groups.push_back({{mesh.from(h)}, DVec3(mesh.position(mesh.from(h)))});
  return groups;
}

/// Collapses the shortest edge of the closed line until `count` points are left.
void equalise(std::vector<Group>& line, std::size_t count) {
  while (line.size() > count) {
    std::size_t shortest = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < line.size(); ++i) {
      const double length = glm::distance(line[i].mean, line[(i + 1) % line.size()].mean);
      if (length < least) least = length, shortest = i;
    }
    const std::size_t second = (shortest + 1) % line.size();
    line[shortest] = merged(line[shortest], line[second]);
    line.erase(line.begin() + std::ptrdiff_t(second));
  }
}

/// Every r, from the one for which joining a[i] to b[r - i] costs least on: the borders run opposite ways round.
std::vector<std::size_t> rotations(const std::vector<Group>& a, const std::vector<Group>& b) {
  const std::size_t n = a.size();
  std::vector<std::pair<double, std::size_t>> sums;
  for (std::size_t r = 0; r < n; ++r) {
    double sum = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const DVec3 d = a[i].mean - b[(r + n - i) % n].mean;
      sum += glm::dot(d, d);
    }
    sums.emplace_back(sum, r);
  }
  std::sort(sums.begin(), sums.end());
  std::vector<std::size_t> order;
  for (const auto& [sum, r] : sums) order.push_back(r);
  return order;
}

/// The triangles about the vertices of a border that are not in `erased`.
void add_outer_fans(const TriangleMesh& mesh, const std::vector<Index>& border, const std::unordered_set<Index>& erased,
                    std::set<Index>& fans) {
  for (const Index start : border)
    for_each_leaving(mesh, start, [&](Index h) {
      if (!erased.count(TriangleMesh::triangle(h))) fans.insert(TriangleMesh::triangle(h));
    });
}

/// Vertex i of one border becomes one with vertex r - i of the other, and the `fans` outside follow.
void weld(const TriangleMesh& mesh, const std::vector<Group>& a, const std::vector<Group>& b, std::size_t r,
          const std::set<Index>& fans, MeshPatch& patch) {
  std::unordered_map<Index, Index> welded;  // border vertices and what they become
  const std::size_t n = a.size();
  for (std::size_t i = 0; i < n; ++i) {
    const Group &here = a[i], &there = b[(r + n - i) % n];
    const Index kept = here.members.front();
    for (const Index v : here.members) welded[v] = kept;
    for (const Index v : there.members) welded[v] = kept;
    patch.move_vertex(kept, 0.5 * (here.mean + there.mean), with_equal_weight(here, there));
  }
  const auto after = [&](Index v) {
    const auto it = welded.find(v);
    return it == welded.end() ? v : it->second;
  };
  patch.remove({fans.begin(), fans.end()});
  for (const Index t : fans)
    patch.add_triangle(after(mesh.vertex[3 * t]), after(mesh.vertex[3 * t + 1]), after(mesh.vertex[3 * t + 2]));
}

/// The one border of a disc; empty for anything else.
std::vector<Index> border_of_disc(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  const auto borders = find_borders(mesh, triangles);
  return borders.size() == 1 && euler_of(mesh, triangles) == 1 ? borders.front() : std::vector<Index>{};
}

bool share_a_vertex(const TriangleMesh& mesh, const std::vector<Index>& a, const std::vector<Index>& b) {
  std::unordered_set<Index> vertices;
  for (const Index t : a)
    for (Index k = 0; k < 3; ++k) vertices.insert(mesh.vertex[3 * t + k]);
  return std::any_of(b.begin(), b.end(), [&](Index t) {
    return vertices.count(mesh.vertex[3 * t]) || vertices.count(mesh.vertex[3 * t + 1]) ||
           vertices.count(mesh.vertex[3 * t + 2]);
  });
}

}  // namespace

std::vector<std::vector<Index>> find_borders(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  const std::unordered_set<Index> in(triangles.begin(), triangles.end());
  const auto outside = [&](Index h) { return in.count(TriangleMesh::triangle(mesh.twin[h])) == 0; };
  std::set<Index> open;
  for (const Index t : triangles)
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (outside(h)) open.insert(h);
  std::vector<std::vector<Index>> borders;
  std::unordered_set<Index> visited;
  while (!open.empty()) {
    std::vector<Index>& border = borders.emplace_back();
    const Index start = *open.begin();
    Index h = start;
    do {
      if (!visited.insert(mesh.from(h)).second) return {};
      border.push_back(h);
      open.erase(h);
      h = TriangleMesh::next(h);
      while (!outside(h)) h = TriangleMesh::next(mesh.twin[h]);
    } while (h != start);
  }
  return borders;
}

int euler_of(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  const std::unordered_set<Index> in(triangles.begin(), triangles.end());
  std::unordered_set<Index> vertices;
  std::size_t halves = 0;  // twice the edges
  for (const Index t : triangles)
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      vertices.insert(mesh.from(h));
      halves += in.count(TriangleMesh::triangle(mesh.twin[h])) ? 1 : 2;
    }
  return int(vertices.size()) - int(halves / 2) + int(triangles.size());
}

std::vector<Index> with_neighbours(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  std::set<Index> grown(triangles.begin(), triangles.end());
  for (const Index t : triangles)
    for (Index start = 3 * t; start < 3 * t + 3; ++start)
      for (Index h = mesh.turn(start); h != start; h = mesh.turn(h)) grown.insert(TriangleMesh::triangle(h));
  return {grown.begin(), grown.end()};
}

PlannedPatch plan_blend(const TriangleMesh& mesh, const std::vector<Index>& a, const std::vector<Index>& b) {
  constexpr std::size_t kRotations = 3;  // tried: more would twist the fans
  if (share_a_vertex(mesh, a, b)) return {std::nullopt, "the two sheets touch"};
  const std::vector<Index> border_a = border_of_disc(mesh, a), border_b = border_of_disc(mesh, b);
  if (border_a.size() < 3 || border_b.size() < 3) return {std::nullopt, "what is to be erased is not a disc"};
  std::vector<Group> line_a = groups_of(mesh, border_a), line_b = groups_of(mesh, border_b);
  equalise(line_a, line_b.size());
  equalise(line_b, line_a.size());

  std::unordered_set<Index> erased(a.begin(), a.end());
  erased.insert(b.begin(), b.end());
  std::set<Index> fans;
  add_outer_fans(mesh, border_a, erased, fans);
  add_outer_fans(mesh, border_b, erased, fans);
  std::vector<std::size_t> order = rotations(line_a, line_b);
  order.resize(std::min(order.size(), kRotations));
  for (const std::size_t r : order) {
    MeshPatch patch(mesh);
    patch.remove(a);
    patch.remove(b);
    weld(mesh, line_a, line_b, r, fans, patch);
    if (!patch.fits(mesh)) continue;
    if (patch.euler_change(mesh) != -2) return {std::nullopt, "welding would close more than the two discs"};
    return {std::move(patch), {}};
  }
  return {std::nullopt, "the borders cannot be welded without a doubled edge"};
}

}  // namespace isoskin
