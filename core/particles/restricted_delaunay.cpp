#include "core/particles/restricted_delaunay.h"

#include <algorithm>
#include <map>
#include <optional>

#include <tbb/parallel_sort.h>

#include "core/counter_random.h"
#include "core/parallel.h"
#include "core/particles/delaunay.h"
#include "core/topology/point_grid.h"

namespace isoskin {
namespace {

/// Random points in the cells of a lattice that lie near samples but not too near.
std::vector<DVec3> helpers_of(std::span<const Vec3> samples, std::span<const Vec3> normals,
                              const RestrictedOptions& options) {
  const double cell = options.shell * options.spacing;
  std::vector<std::array<int, 3>> cells;
  const auto add = [&](const DVec3& p) {
    const IVec3 c(glm::floor(p / cell));
    cells.push_back({c.x, c.y, c.z});
  };
  for (std::size_t i = 0; i < samples.size(); ++i)
    for (int layer = 1; layer <= options.layers; ++layer)
      for (const double side : {-1.0, 1.0})
        add(DVec3(samples[i]) + side * layer * options.clear * options.spacing * DVec3(normals[i]));
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());

  const std::vector<Vec3> points(samples.begin(), samples.end());
  const PointGrid grid(points, float(options.clear * options.spacing));
  std::vector<DVec3> helpers;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const DVec3 corner(cells[i][0], cells[i][1], cells[i][2]);
    // A cell half taken by the surface may still have room elsewhere.
    constexpr std::uint64_t kTries = 4;
    for (std::uint64_t k = 0; k < kTries; ++k) {
      const DVec3 p = cell * (corner + counter_point(options.seed, kTries * i + k));
      if (grid.any_near(Vec3(p))) continue;
      helpers.push_back(p);
      break;
    }
  }
  // The corners of a wide box, so that no sample is on the hull.
  Box box;
  for (const Vec3& p : samples) box.add(DVec3(p));
  const Box wide = box.grown(box.diagonal() + 4.0 * cell);
  for (int c = 0; c < 8; ++c) {
    const DVec3 t(c & 1, c >> 1 & 1, c >> 2 & 1);
    const DVec3 shift = cell * counter_point(options.seed + 1, std::uint64_t(c));
    helpers.push_back(wide.low + t * wide.size() + shift);
  }
  return helpers;
}

struct Face {
  std::array<Index, 3> corner;
  Index tetrahedron;
  friend bool operator<(const Face& a, const Face& b) {
    return a.corner != b.corner ? a.corner < b.corner : a.tetrahedron < b.tetrahedron;
  }
};

std::vector<Face> faces_of(const Delaunay& delaunay) {
  std::vector<Face> faces(4 * delaunay.tetrahedron.size());
  for_each_index(delaunay.tetrahedron.size(), [&](std::size_t t) {
    const auto& [a, b, c, d] = delaunay.tetrahedron[t];
    faces[4 * t] = {{a, b, c}, Index(t)};
    faces[4 * t + 1] = {{a, b, d}, Index(t)};
    faces[4 * t + 2] = {{a, c, d}, Index(t)};
    faces[4 * t + 3] = {{b, c, d}, Index(t)};
  });
  tbb::parallel_sort(faces);
  return faces;
}

/// Corners in the order that sees them counter-clockwise from outside: the dual edge is perpendicular to the triangle.
DualTriangle oriented(std::array<Index, 3> corner, const DVec3& inside, const DVec3& outside,
                      std::span<const DVec3> points) {
  const DVec3 normal = glm::cross(points[corner[1]] - points[corner[0]], points[corner[2]] - points[corner[0]]);
  if (glm::dot(normal, outside - inside) < 0.0) std::swap(corner[1], corner[2]);
  return {corner, inside, outside};
}

/// Samples whose triangles are not one closed fan, each edge to the next having been met once in each direction.
std::vector<Index> without_disc(const std::vector<DualTriangle>& triangles, std::size_t samples) {
  std::vector<std::vector<std::pair<Index, Index>>> opposite(samples);  // of each sample: the edges it sees
  for (const DualTriangle& t : triangles)
    for (int k = 0; k < 3; ++k) opposite[t.corner[k]].emplace_back(t.corner[(k + 1) % 3], t.corner[(k + 2) % 3]);
  std::vector<std::uint8_t> fault(samples, 0);
  for_each_index(samples, [&](std::size_t v) {
    auto& edges = opposite[v];
    if (edges.empty()) return;  // a sample too many: it is left out
    std::sort(edges.begin(), edges.end());
    Index at = edges.front().first;
    for (std::size_t n = 0; n < edges.size(); ++n) {
      const auto next = std::lower_bound(edges.begin(), edges.end(), std::pair{at, Index{0}});
      const bool found = next != edges.end() && next->first == at;
      const bool alone = found && (next + 1 == edges.end() || (next + 1)->first != at);
      if (!alone || (n > 0 && at == edges.front().first)) {
        fault[v] = 1;
        return;
      }
      at = next->second;
    }
    fault[v] = at != edges.front().first;
  });
  std::vector<Index> out;
  for (Index v = 0; v < samples; ++v)
    if (fault[v]) out.push_back(v);
  return out;
}

}  // namespace

RestrictedDelaunay restricted_delaunay(std::span<const Vec3> samples, std::span<const Vec3> normals, const Field& field,
                                       const RestrictedOptions& options) {
  std::vector<DVec3> points(samples.begin(), samples.end());
  const std::vector<DVec3> helpers = helpers_of(samples, normals, options);
  points.insert(points.end(), helpers.begin(), helpers.end());
  const Delaunay cells = delaunay(points);
  std::vector<std::uint8_t> inside(cells.tetrahedron.size());
  for_each_index(inside.size(), [&](std::size_t t) { inside[t] = field.value(cells.circumcenter[t]) > 0.0; });

  RestrictedDelaunay result;
  const std::vector<Face> faces = faces_of(cells);
  for (std::size_t i = 0; i + 1 < faces.size(); ++i) {
    if (faces[i].corner != faces[i + 1].corner) continue;
    const Index a = faces[i].tetrahedron, b = faces[i + 1].tetrahedron;
    if (inside[a] == inside[b]) continue;
    const auto [in, out] = inside[a] ? std::pair{a, b} : std::pair{b, a};
    const DualTriangle dual = oriented(faces[i].corner, cells.circumcenter[in], cells.circumcenter[out], points);
    (faces[i].corner[2] < samples.size() ? result.triangle : result.starved).push_back(dual);
  }
  result.no_disc = without_disc(result.triangle, samples.size());
  return result;
}

DVec3 dual_crossing(const DualTriangle& triangle, const Field& field) {
  constexpr int kHalvings = 40;
  DVec3 in = triangle.inside, out = triangle.outside;
  for (int k = 0; k < kHalvings; ++k) {
    const DVec3 middle = 0.5 * (in + out);
    (field.value(middle) > 0.0 ? in : out) = middle;
  }
  return 0.5 * (in + out);
}

}  // namespace isoskin
