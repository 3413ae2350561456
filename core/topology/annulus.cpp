#include "core/topology/annulus.h"

#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "core/parallel.h"

namespace isoskin {
namespace {

/// Of some points all over a triangle the one nearest to `p`.
double distance_to(const TriangleMesh& mesh, Index t, const DVec3& p) {
  constexpr int kSteps = 4;
  const DVec3 a(mesh.position(mesh.vertex[3 * t])), b(mesh.position(mesh.vertex[3 * t + 1])),
      c(mesh.position(mesh.vertex[3 * t + 2]));
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; i + j <= kSteps; ++j)
      least = std::min(least, glm::distance(p, a + double(i) / kSteps * (b - a) + double(j) / kSteps * (c - a)));
  return least;
}

/// Takes the triangles that hang together with the first of `left` out of it.
std::set<Index> take_part(const TriangleMesh& mesh, std::set<Index>& left) {
  std::set<Index> part;
  std::vector<Index> front{*left.begin()};
  left.erase(left.begin());
  while (!front.empty()) {
    const Index t = front.back();
    front.pop_back();
    part.insert(t);
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (const Index beside = TriangleMesh::triangle(mesh.twin[h]); left.erase(beside)) front.push_back(beside);
  }
  return part;
}

/// Nothing when they meet themselves at a vertex.
std::optional<std::vector<std::vector<Index>>> borders_of(const TriangleMesh& mesh, const std::set<Index>& part) {
  std::map<Index, Index> leaving;  // per vertex
  for (const Index t : part)
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (!part.contains(TriangleMesh::triangle(mesh.twin[h])) && !leaving.emplace(mesh.from(h), h).second)
        return std::nullopt;
  std::vector<std::vector<Index>> borders;
  while (!leaving.empty()) {
    std::vector<Index>& border = borders.emplace_back();
    for (auto it = leaving.begin(); it != leaving.end(); it = leaving.find(mesh.to(border.back()))) {
      border.push_back(it->second);
      leaving.erase(it);
    }
  }
  return borders;
}

int euler_of(const TriangleMesh& mesh, const std::set<Index>& part) {
  std::set<Index> vertices;
  std::size_t inner = 0, border = 0;  // halfedges
  for (const Index t : part)
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      vertices.insert(mesh.vertex[h]);
      ++(part.contains(TriangleMesh::triangle(mesh.twin[h])) ? inner : border);
    }
  return int(vertices.size()) - int(inner / 2 + border) + int(part.size());
}

struct Course {
  int turns;
  double height;  // mean
};

Course course_of(const TriangleMesh& mesh, const std::vector<Index>& border, const Plane& plane) {
  Section section;
  double sum = 0.0;
  for (const Index h : border) {
    section.point.emplace_back(mesh.position(mesh.from(h)));
    sum += plane.height(mesh.position(mesh.from(h)));
  }
  return {winding(section, plane), sum / double(border.size())};
}

std::optional<Annulus> as_annulus(const TriangleMesh& mesh, const std::set<Index>& part, const Plane& plane, int turn) {
  const auto borders = borders_of(mesh, part);
  if (!borders || borders->size() != 2 || euler_of(mesh, part) != 0) return std::nullopt;
  const Course first = course_of(mesh, (*borders)[0], plane), second = course_of(mesh, (*borders)[1], plane);
  const bool swapped = first.height < second.height;
  const Course &high = swapped ? second : first, &low = swapped ? first : second;
  if (high.turns != -turn || low.turns != turn) return std::nullopt;
  return Annulus{{part.begin(), part.end()}, {(*borders)[swapped], (*borders)[!swapped]}};
}

}  // namespace

std::optional<Annulus> annulus_about(const TriangleMesh& mesh, const Plane& plane, int turn,
                                     const std::vector<double>& radii) {
  std::vector<double> distance(mesh.triangle_count());
  for_each_index(distance.size(), [&](std::size_t t) { distance[t] = distance_to(mesh, Index(t), plane.origin); });
  for (const double radius : radii) {
    std::set<Index> left;
    for (Index t = 0; t < distance.size(); ++t)
      if (distance[t] < radius) left.insert(left.end(), t);
    while (!left.empty())
      if (auto annulus = as_annulus(mesh, take_part(mesh, left), plane, turn)) return annulus;
  }
  return std::nullopt;
}

}  // namespace isoskin
