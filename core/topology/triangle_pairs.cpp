#include "core/topology/triangle_pairs.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>
#include <span>

#include <tbb/enumerable_thread_specific.h>

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

Grid make_grid(const std::vector<FlatBox>& box, double margin) {
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
  grid.range.resize(box.size());
  for_each_index(box.size(), [&](std::size_t t) { grid.range[t] = grid.cells(box[t].low, box[t].high, 0.5 * margin); });
  return grid;
}

struct Entry {
  std::uint64_t cell;
  Index triangle;
};

std::uint64_t key_of(const IVec3& c) {
  return std::uint64_t(c.x) << 42 | std::uint64_t(c.y) << 21 | std::uint64_t(c.z);
}

template <class Visit>
void for_each_cell(const CellRange& range, const Visit& visit) {
  for (int x = range.low.x; x <= range.high.x; ++x)
    for (int y = range.low.y; y <= range.high.y; ++y)
      for (int z = range.low.z; z <= range.high.z; ++z) visit(key_of({x, y, z}));
}

/// The grid's entries, those of one cell in one bucket of a hash table, in no order: sorting them by cells takes
/// several times as long.
struct CellTable {
  std::vector<std::uint32_t> first;  // per bucket, CSR over `entry`; buckets + 1
  std::vector<Entry> entry;

  explicit CellTable(const Grid& grid) {
    constexpr std::size_t kBucketsPerTriangle = 2;  // so that few hold triangles of several cells
    const std::size_t buckets = std::bit_ceil(kBucketsPerTriangle * grid.range.size() + 1);
    const int shift = 64 - std::countr_zero(buckets);
    const auto bucket_of = [&](std::uint64_t cell) {
      return shift == 64 ? 0 : std::size_t(cell * 0x9e3779b97f4a7c15u >> shift);
    };
    const auto next_in = [](std::uint32_t& counter) {
      return std::atomic_ref<std::uint32_t>(counter).fetch_add(1, std::memory_order_relaxed);
    };
    first.assign(buckets + 1, 0);
    for_each_index(grid.range.size(), [&](std::size_t t) {
      for_each_cell(grid.range[t], [&](std::uint64_t cell) { next_in(first[bucket_of(cell) + 1]); });
    });
    std::inclusive_scan(first.begin(), first.end(), first.begin());
    entry.resize(first.back());
    std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
    for_each_index(grid.range.size(), [&](std::size_t t) {
      for_each_cell(grid.range[t], [&](std::uint64_t cell) {
        entry[next_in(next[bucket_of(cell)])] = {cell, Index(t)};
      });
    });
  }
};

}  // namespace

bool share_a_vertex(const TriangleMesh& mesh, Index a, Index b) {
  for (Index i = 3 * a; i < 3 * a + 3; ++i)
    for (Index j = 3 * b; j < 3 * b + 3; ++j)
      if (mesh.vertex[i] == mesh.vertex[j]) return true;
  return false;
}

std::array<Vec3, 3> corners_of(const TriangleMesh& mesh, Index t) {
  return {mesh.position(mesh.vertex[3 * t]), mesh.position(mesh.vertex[3 * t + 1]),
          mesh.position(mesh.vertex[3 * t + 2])};
}

FlatBox box_of(const std::array<Vec3, 3>& t) {
  return {glm::min(glm::min(t[0], t[1]), t[2]), glm::max(glm::max(t[0], t[1]), t[2])};
}

bool triangles_overlap(const std::array<Vec3, 3>& a, const std::array<Vec3, 3>& b) {
  return edges_meet(a, b) || edges_meet(b, a);
}

std::vector<TrianglePair> near_boxes(const std::vector<FlatBox>& box, double margin,
                                     const std::function<bool(const TrianglePair&)>& wanted,
                                     PairStatistics* statistics) {
  const Grid grid = make_grid(box, margin);
  const CellTable table(grid);

  struct Found {
    std::vector<TrianglePair> pairs;
    std::vector<FlatBox> boxes;  // of a bucket
    std::size_t candidates = 0;
  };
  const auto apart = [&](const FlatBox& a, const FlatBox& b) {
    const Vec3 gap = glm::max(a.low - b.high, b.low - a.high);
    return std::max({gap.x, gap.y, gap.z}) > float(margin);
  };
  tbb::enumerable_thread_specific<Found> found;
  for_each_index(table.first.size() - 1, [&](std::size_t bucket) {
    Found& own = found.local();
    const std::span entries(table.entry.data() + table.first[bucket], table.entry.data() + table.first[bucket + 1]);
    own.boxes.clear();
    for (const Entry& entry : entries) own.boxes.push_back(box[entry.triangle]);
    for (std::size_t i = 0; i < entries.size(); ++i)
      for (std::size_t j = i + 1; j < entries.size(); ++j) {
        if (entries[i].cell != entries[j].cell || apart(own.boxes[i], own.boxes[j])) continue;
        const TrianglePair pair{std::min(entries[i].triangle, entries[j].triangle),
                                std::max(entries[i].triangle, entries[j].triangle)};
        // Of the cells both are listed in, one looks at them.
        const IVec3 home = glm::max(grid.range[pair.a].low, grid.range[pair.b].low);
        if (entries[i].cell != key_of(home)) continue;
        ++own.candidates;
        if (wanted(pair)) own.pairs.push_back(pair);
      }
  });
  std::vector<TrianglePair> pairs;
  PairStatistics sums{table.entry.size(), 0};
  for (const Found& own : found) {
    pairs.insert(pairs.end(), own.pairs.begin(), own.pairs.end());
    sums.candidates += own.candidates;
  }
  std::sort(pairs.begin(), pairs.end());
  if (statistics) *statistics = sums;
  return pairs;
}

std::vector<TrianglePair> near_pairs(const TriangleMesh& mesh, double margin,
                                     const std::function<bool(const TrianglePair&)>& wanted,
                                     PairStatistics* statistics) {
  std::vector<FlatBox> box(mesh.triangle_count());
  for_each_index(box.size(), [&](std::size_t t) { box[t] = box_of(corners_of(mesh, Index(t))); });
  std::atomic<std::size_t> neighbours = 0;
  const auto is_wanted = [&](const TrianglePair& pair) {
    if (!share_a_vertex(mesh, pair.a, pair.b)) return wanted(pair);
    if (statistics) ++neighbours;
    return false;
  };
  const std::vector<TrianglePair> pairs = near_boxes(box, margin, is_wanted, statistics);
  if (statistics) statistics->candidates -= neighbours;
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
