#include "core/topology/mesh_probe.h"

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "core/mechanics/element.h"

namespace isoskin {
namespace {

/// Coordinates across and along a line.
struct LineFrame {
  DVec3 origin, u, v, w;

  LineFrame(const DVec3& at, const DVec3& direction) : origin(at), u(any_normal(direction)), w(direction) {
    v = glm::cross(w, u);
  }
  DVec3 operator()(const Vec3& p) const {
    const DVec3 x = DVec3(p) - origin;
    return {glm::dot(x, u), glm::dot(x, v), glm::dot(x, w)};
  }
};

/// Twice the signed area of (0, p, q); the same edge seen from its two triangles gives opposite values, never both 0.
double edge_area(const DVec3& p, const DVec3& q, Index a, Index b) {
  const double area = p.x * q.y - p.y * q.x;
  if (area != 0.0) return area;
  return a < b ? std::numeric_limits<double>::denorm_min() : -std::numeric_limits<double>::denorm_min();
}

bool mixed(const TriangleMesh& mesh, const Plane& plane, Index triangle) {
  int above = 0;
  for (Index k = 0; k < 3; ++k) above += plane.height(mesh.position(mesh.vertex[3 * triangle + k])) >= 0.0;
  return above == 1 || above == 2;
}

}  // namespace

std::vector<LineHit> line_hits(const TriangleMesh& mesh, const DVec3& origin, const DVec3& direction, double reach) {
  constexpr double kShift = 1e-6;
  LineFrame frame(origin, direction);
  frame.origin += kShift * reach * (0.6180 * frame.u + 0.4142 * frame.v);
  tbb::enumerable_thread_specific<std::vector<LineHit>> found;
  constexpr std::size_t kGrain = 4096;
  tbb::parallel_for(tbb::blocked_range<Index>(0, Index(mesh.triangle_count()), kGrain), [&](const auto& range) {
    std::vector<LineHit>& own = found.local();
    for (Index t = range.begin(); t != range.end(); ++t) {
      Index corner[3];
      DVec3 p[3];
      for (Index k = 0; k < 3; ++k) {
        corner[k] = mesh.vertex[3 * t + k];
        p[k] = frame(mesh.position(corner[k]));
      }
      const double a = edge_area(p[1], p[2], corner[1], corner[2]), b = edge_area(p[2], p[0], corner[2], corner[0]),
                   c = edge_area(p[0], p[1], corner[0], corner[1]);
      if ((a > 0.0) != (b > 0.0) || (b > 0.0) != (c > 0.0)) continue;
      const double whole = a + b + c;
      if (std::abs(whole) < std::numeric_limits<double>::min()) continue;  // seen exactly from its edge
      const double distance = (a * p[0].z + b * p[1].z + c * p[2].z) / whole;
      if (std::abs(distance) <= reach) own.push_back({distance, t, a > 0.0});
    }
  });
  std::vector<LineHit> hits;
  for (const auto& own : found) hits.insert(hits.end(), own.begin(), own.end());
  std::sort(hits.begin(), hits.end(), [](const LineHit& a, const LineHit& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.triangle < b.triangle;
  });
  return hits;
}

Section cut_section(const TriangleMesh& mesh, const Plane& plane, Index triangle, std::size_t longest) {
  if (!mixed(mesh, plane, triangle)) return {};
  const auto above = [&](Index v) { return plane.height(mesh.position(v)) >= 0.0; };
  Index start = 3 * triangle;
  while (!above(mesh.from(start)) || above(mesh.to(start))) ++start;
  Section section;
  Index h = start;
  do {
    if (section.halfedge.size() == longest) return {};
    section.halfedge.push_back(h);
    const Vec3 &p = mesh.position(mesh.from(h)), &q = mesh.position(mesh.to(h));
    const double high = plane.height(p), low = plane.height(q);
    section.point.push_back(DVec3(p) + high / (high - low) * (DVec3(q) - DVec3(p)));
    const Index third = mesh.from(TriangleMesh::prev(h));
    h = mesh.twin[above(third) ? TriangleMesh::next(h) : TriangleMesh::prev(h)];
  } while (h != start);
  return section;
}

int winding(const Section& section, const Plane& plane) {
  const LineFrame frame(plane.origin, plane.normal);
  const auto flat = [&](const DVec3& p) {
    return glm::dvec2(glm::dot(p - plane.origin, frame.u), glm::dot(p - plane.origin, frame.v));
  };
  int turns = 0;
  for (std::size_t i = 0; i < section.point.size(); ++i) {
    const glm::dvec2 p = flat(section.point[i]), q = flat(section.point[(i + 1) % section.point.size()]);
    const double side = p.x * q.y - p.y * q.x;  // crossings of the positive u axis
    if (p.y < 0.0 && q.y >= 0.0 && side > 0.0) ++turns;
    if (p.y >= 0.0 && q.y < 0.0 && side < 0.0) --turns;
  }
  return turns;
}

std::vector<Index> piece_of(const TriangleMesh& mesh, Index triangle) {
  std::unordered_set<Index> seen{triangle};
  std::vector<Index> piece{triangle};
  for (std::size_t i = 0; i < piece.size(); ++i)
    for (Index k = 0; k < 3; ++k) {
      const Index other = TriangleMesh::triangle(mesh.twin[3 * piece[i] + k]);
      if (seen.insert(other).second) piece.push_back(other);
    }
  std::sort(piece.begin(), piece.end());
  return piece;
}

std::vector<Index> grow_disc(const TriangleMesh& mesh, std::vector<Index> seeds,
                             const std::function<bool(Index triangle)>& wanted) {
  std::vector<Index> disc = std::move(seeds);
  std::unordered_set<Index> in(disc.begin(), disc.end()), vertices;
  for (const Index t : disc)
    for (Index k = 0; k < 3; ++k) vertices.insert(mesh.vertex[3 * t + k]);
  // Across one edge the third corner must be new to the disc; with two edges it stays a disc; three would close it.
  const auto fits = [&](Index t) {
    int shared = 0;
    Index across = kNone;
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (in.count(TriangleMesh::triangle(mesh.twin[h]))) {
        ++shared;
        across = h;
      }
    if (shared == 2) return true;
    return shared == 1 && vertices.count(mesh.from(TriangleMesh::prev(across))) == 0;
  };
  bool grown = true;
  while (grown) {  // a triangle that does not fit yet may do so later
    grown = false;
    for (std::size_t i = 0; i < disc.size(); ++i)
      for (Index k = 0; k < 3; ++k) {
        const Index t = TriangleMesh::triangle(mesh.twin[3 * disc[i] + k]);
        if (in.count(t) || !fits(t) || !wanted(t)) continue;
        in.insert(t);
        disc.push_back(t);
        for (Index j = 0; j < 3; ++j) vertices.insert(mesh.vertex[3 * t + j]);
        grown = true;
      }
  }
  return disc;
}

std::vector<Index> disc_border(const TriangleMesh& mesh, const std::vector<Index>& disc) {
  const std::unordered_set<Index> in(disc.begin(), disc.end());
  const auto outside = [&](Index h) { return in.count(TriangleMesh::triangle(mesh.twin[h])) == 0; };
  Index start = kNone;
  for (const Index t : disc)
    for (Index h = 3 * t; h < 3 * t + 3 && start == kNone; ++h)
      if (outside(h)) start = h;
  std::vector<Index> border;
  Index h = start;
  while (h != kNone) {
    border.push_back(h);
    h = TriangleMesh::next(h);
    while (!outside(h)) h = TriangleMesh::next(mesh.twin[h]);
    if (h == start) break;
  }
  return border;
}

}  // namespace isoskin
