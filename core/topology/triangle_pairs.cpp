#include "core/topology/triangle_pairs.h"

#include <algorithm>
#include <cmath>

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/exact_sign.h"

namespace isoskin {
namespace {

using Corners = std::array<Vec3, 3>;

glm::vec2 without(const Vec3& p, int axis) {
  return {p[(axis + 1) % 3], p[(axis + 2) % 3]};
}

/// An axis along which the triangle does not look flat; 3 for a triangle without area.
int axis_of(const Corners& t) {
  int axis = 0;
  while (axis < 3 && orientation(without(t[0], axis), without(t[1], axis), without(t[2], axis)) == 0) ++axis;
  return axis;
}

bool in_box(const glm::vec2& p, const glm::vec2& a, const glm::vec2& b) {
  return glm::all(glm::lessThanEqual(glm::min(a, b), p)) && glm::all(glm::lessThanEqual(p, glm::max(a, b)));
}

bool segments_meet(const glm::vec2& p, const glm::vec2& q, const glm::vec2& a, const glm::vec2& b) {
  const int pa = orientation(a, b, p), pb = orientation(a, b, q), ap = orientation(p, q, a), aq = orientation(p, q, b);
  if (pa * pb < 0 && ap * aq < 0) return true;
  return (pa == 0 && in_box(p, a, b)) || (pb == 0 && in_box(q, a, b)) || (ap == 0 && in_box(a, p, q)) ||
         (aq == 0 && in_box(b, p, q));
}

/// All five points lie in the triangle's plane.
bool meets_in_plane(const Vec3& p, const Vec3& q, const Corners& t, int axis) {
  const glm::vec2 u = without(p, axis), v = without(q, axis);
  const glm::vec2 c[3] = {without(t[0], axis), without(t[1], axis), without(t[2], axis)};
  const int ab = orientation(c[0], c[1], u), bc = orientation(c[1], c[2], u), ca = orientation(c[2], c[0], u);
  const bool inside = (ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0);
  return inside || segments_meet(u, v, c[0], c[1]) || segments_meet(u, v, c[1], c[2]) ||
         segments_meet(u, v, c[2], c[0]);
}

/// Whether the segment p q, whose ends lie on the sides `side_p` and `side_q` of the triangle's plane, meets it.
bool segment_meets(const Vec3& p, const Vec3& q, int side_p, int side_q, const Corners& t, int axis) {
  if (side_p * side_q > 0) return false;
  if (side_p == 0 && side_q == 0) return meets_in_plane(p, q, t, axis);
  const int ab = orientation(p, q, t[0], t[1]), bc = orientation(p, q, t[1], t[2]), ca = orientation(p, q, t[2], t[0]);
  return (ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0);
}

/// An edge of `edges` meets `t`; nothing when `edges` lies on one side of the plane of `t`.
bool edges_meet(const Corners& edges, const Corners& t) {
  const int axis = axis_of(t);
  if (axis == 3) return false;
  int side[3];
  for (int k = 0; k < 3; ++k) side[k] = orientation(t[0], t[1], t[2], edges[k]);
  if (side[0] == side[1] && side[1] == side[2] && side[0] != 0) return false;
  for (int k = 0; k < 3; ++k)
    if (segment_meets(edges[k], edges[(k + 1) % 3], side[k], side[(k + 1) % 3], t, axis)) return true;
  return false;
}

/// Cells a box reaches into, both ends included.
struct CellRange {
  IVec3 low, high;
};

/// The cells' width and origin, and the range of cells of every triangle.
struct Grid {
  DVec3 origin{0.0};
  double width = 1.0;
  std::vector<CellRange> range;

  CellRange cells(const Vec3& low, const Vec3& high, double grow) const {
    return {IVec3(glm::floor((DVec3(low) - grow - origin) / width)),
            IVec3(glm::floor((DVec3(high) + grow - origin) / width))};
  }
};

struct FlatBox {
  Vec3 low, high;
};

FlatBox box_of(const TriangleMesh& mesh, Index t) {
  const auto [a, b, c] = corners_of(mesh, t);
  return {glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c)};
}

std::size_t count_of(const CellRange& r) {
  const IVec3 n = r.high - r.low + 1;
  return std::size_t(n.x) * std::size_t(n.y) * std::size_t(n.z);
}

Grid make_grid(const TriangleMesh& mesh, const std::vector<FlatBox>& box, double margin) {
  constexpr double kTrianglesAcross = 2.0, kMostCells = double(1 << 20);  // along an axis
  Box all;
  double extent = 0.0;  // a plain loop: the sum's order is fixed
  for (const FlatBox& b : box) {
    all.add(DVec3(b.low));
    all.add(DVec3(b.high));
    const DVec3 size = DVec3(b.high) - DVec3(b.low);
    extent += std::max({size.x, size.y, size.z}) / double(box.size());
  }
  Grid grid;
  grid.origin = all.low - margin;
  const DVec3 size = all.size() + 2.0 * margin;
  grid.width = std::max({kTrianglesAcross * extent + margin, std::max({size.x, size.y, size.z}) / kMostCells,
                         double(std::numeric_limits<float>::min())});
  grid.range.resize(mesh.triangle_count());
  for_each_index(box.size(), [&](std::size_t t) { grid.range[t] = grid.cells(box[t].low, box[t].high, 0.5 * margin); });
  return grid;
}

struct Entry {
  std::uint64_t cell;
  Index triangle;
  auto operator<=>(const Entry&) const = default;
};

std::uint64_t key_of(const IVec3& c) {
  return std::uint64_t(c.x) << 42 | std::uint64_t(c.y) << 21 | std::uint64_t(c.z);
}

std::vector<Entry> entries_of(const Grid& grid) {
  std::vector<std::size_t> first(grid.range.size() + 1, 0);
  for (std::size_t t = 0; t < grid.range.size(); ++t) first[t + 1] = first[t] + count_of(grid.range[t]);
  std::vector<Entry> entries(first.back());
  for_each_index(grid.range.size(), [&](std::size_t t) {
    std::size_t at = first[t];
    const auto& [low, high] = grid.range[t];
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y)
        for (int z = low.z; z <= high.z; ++z) entries[at++] = {key_of({x, y, z}), Index(t)};
  });
  tbb::parallel_sort(entries);
  return entries;
}

bool share_a_vertex(const TriangleMesh& mesh, Index a, Index b) {
  for (Index i = 3 * a; i < 3 * a + 3; ++i)
    for (Index j = 3 * b; j < 3 * b + 3; ++j)
      if (mesh.vertex[i] == mesh.vertex[j]) return true;
  return false;
}

}  // namespace

std::array<Vec3, 3> corners_of(const TriangleMesh& mesh, Index t) {
  return {mesh.position(mesh.vertex[3 * t]), mesh.position(mesh.vertex[3 * t + 1]),
          mesh.position(mesh.vertex[3 * t + 2])};
}

bool triangles_overlap(const std::array<Vec3, 3>& a, const std::array<Vec3, 3>& b) {
  return edges_meet(a, b) || edges_meet(b, a);
}

std::vector<TrianglePair> near_pairs(const TriangleMesh& mesh, double margin,
                                     const std::function<bool(const TrianglePair&)>& wanted,
                                     PairStatistics* statistics) {
  std::vector<FlatBox> box(mesh.triangle_count());
  for_each_index(box.size(), [&](std::size_t t) { box[t] = box_of(mesh, Index(t)); });
  const Grid grid = make_grid(mesh, box, margin);
  const std::vector<Entry> entries = entries_of(grid);
  const std::vector<Index> runs =
      indices_where(entries.size(), [&](Index i) { return i == 0 || entries[i].cell != entries[i - 1].cell; });

  struct Found {
    std::vector<TrianglePair> pairs;
    std::size_t candidates = 0;
  };
  const auto apart = [&](Index a, Index b) {
    return glm::any(glm::greaterThan(DVec3(box[a].low) - DVec3(box[b].high), DVec3(margin))) ||
           glm::any(glm::greaterThan(DVec3(box[b].low) - DVec3(box[a].high), DVec3(margin)));
  };
  tbb::enumerable_thread_specific<Found> found;
  for_each_index(runs.size(), [&](std::size_t r) {
    Found& own = found.local();
    const std::size_t end = r + 1 < runs.size() ? runs[r + 1] : entries.size();
    for (std::size_t i = runs[r]; i < end; ++i)
      for (std::size_t j = i + 1; j < end; ++j) {
        const TrianglePair pair{entries[i].triangle, entries[j].triangle};
        if (apart(pair.a, pair.b)) continue;
        // Of the cells both are listed in, one looks at them.
        const IVec3 home = glm::max(grid.range[pair.a].low, grid.range[pair.b].low);
        if (entries[i].cell != key_of(home) || share_a_vertex(mesh, pair.a, pair.b)) continue;
        ++own.candidates;
        if (wanted(pair)) own.pairs.push_back(pair);
      }
  });
  std::vector<TrianglePair> pairs;
  PairStatistics sums{entries.size(), 0};
  for (const Found& own : found) {
    pairs.insert(pairs.end(), own.pairs.begin(), own.pairs.end());
    sums.candidates += own.candidates;
  }
  std::sort(pairs.begin(), pairs.end());
  if (statistics) *statistics = sums;
  return pairs;
}

std::vector<TrianglePair> overlapping_pairs(const TriangleMesh& mesh, PairStatistics* statistics) {
  return near_pairs(
      mesh, 0.0,
      [&](const TrianglePair& pair) { return triangles_overlap(corners_of(mesh, pair.a), corners_of(mesh, pair.b)); },
      statistics);
}

std::size_t count_self_intersections(const TriangleMesh& mesh) {
  return overlapping_pairs(mesh).size();
}

}  // namespace isoskin
