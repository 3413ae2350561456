#include "core/topology/triangle_pairs.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>
#include <span>

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_reduce.h>

#include "core/parallel.h"
#include "core/topology/exact_sign.h"
#include "core/vectorized.h"

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

/// The cells' width and origin.
struct Grid {
  DVec3 origin{0.0};
  double width = 1.0, grow = 0.0;

  CellRange cells(const FlatBox& box) const {
    return {IVec3(glm::floor((DVec3(box.low) - grow - origin) / width)),
            IVec3(glm::floor((DVec3(box.high) + grow - origin) / width))};
  }
};

Grid make_grid(std::size_t count, const BoxOf& box_of, double margin) {
  constexpr double kTrianglesAcross = 2.0, kMostCells = double(1 << 20);  // along an axis
  constexpr std::size_t kBlock = 4096;
  struct Part {
    Box all;
    double extents = 0.0;
  };
  const auto add_boxes = [&](const tbb::blocked_range<std::size_t>& range, Part part) {
    for (std::size_t i = range.begin(); i != range.end(); ++i) {
      const FlatBox box = box_of(Index(i));
      const DVec3 low(box.low), high(box.high), size = high - low;
      part.all.add(low);
      part.all.add(high);
      part.extents += std::max({size.x, size.y, size.z});
    }
    return part;
  };
  const auto join = [](Part a, const Part& b) {
    a.all.add(b.all);
    a.extents += b.extents;
    return a;
  };
  const Part whole =
      tbb::parallel_deterministic_reduce(tbb::blocked_range<std::size_t>(0, count, kBlock), Part{}, add_boxes, join);
  const Box& all = whole.all;
  const double extent = whole.extents / double(std::max<std::size_t>(1, count));
  Grid grid;
  grid.origin = all.low - margin;
  const DVec3 size = all.size() + 2.0 * margin;
  grid.width = std::max({kTrianglesAcross * extent + margin, std::max({size.x, size.y, size.z}) / kMostCells,
                         double(std::numeric_limits<float>::min())});
  grid.grow = 0.5 * margin;
  return grid;
}

struct Entry {
  std::uint64_t cell;
  Index triangle;
  std::uint32_t begins;  // bit k: along axis k the triangle's cells begin with this one
};

std::uint64_t key_of(const IVec3& c) {
  return std::uint64_t(c.x) << 42 | std::uint64_t(c.y) << 21 | std::uint64_t(c.z);
}

/// visit(key, Entry::begins).
template <class Visit>
void for_each_cell(const CellRange& range, const Visit& visit) {
  const IVec3& low = range.low;
  for (int x = low.x; x <= range.high.x; ++x)
    for (int y = low.y; y <= range.high.y; ++y)
      for (int z = low.z; z <= range.high.z; ++z)
        visit(key_of({x, y, z}),
              std::uint32_t(x == low.x) | std::uint32_t(y == low.y) << 1 | std::uint32_t(z == low.z) << 2);
}

/// The grid's entries, those of one cell in one bucket of a hash table, in no order: sorting them by cells takes
/// several times as long.
struct CellTable {
  std::vector<std::uint32_t> first;  // per bucket, CSR over `entry`; buckets + 1
  std::vector<Entry> entry;

  CellTable(const Grid& grid, std::size_t count, const BoxOf& box_of) {
    constexpr std::size_t kBucketsPerTriangle = 2;  // so that few hold triangles of several cells
    const std::size_t buckets = std::bit_ceil(kBucketsPerTriangle * count + 1);
    const int shift = 64 - std::countr_zero(buckets);
    const auto bucket_of = [&](std::uint64_t cell) {
      return shift == 64 ? 0 : std::size_t(cell * 0x9e3779b97f4a7c15u >> shift);
    };
    const auto next_in = [](std::uint32_t& counter) {
      return std::atomic_ref<std::uint32_t>(counter).fetch_add(1, std::memory_order_relaxed);
    };
    first.assign(buckets + 1, 0);
    for_each_index(count, [&](std::size_t t) {
      for_each_cell(grid.cells(box_of(Index(t))),
                    [&](std::uint64_t cell, std::uint32_t) { next_in(first[bucket_of(cell) + 1]); });
    });
    std::inclusive_scan(first.begin(), first.end(), first.begin());
    entry.resize(first.back());
    std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
    for_each_index(count, [&](std::size_t t) {
      for_each_cell(grid.cells(box_of(Index(t))), [&](std::uint64_t cell, std::uint32_t begins) {
        entry[next_in(next[bucket_of(cell)])] = {cell, Index(t), begins};
      });
    });
  }
};

/// The boxes of a bucket, a column a coordinate, and Entry::begins.
struct BoxColumns {
  std::vector<float> low[3], high[3];
  std::vector<std::uint32_t> begins;

  void assign(std::span<const Entry> entries, const BoxOf& box_of) {
    for (int k = 0; k < 3; ++k) low[k].resize(entries.size()), high[k].resize(entries.size());
    begins.resize(entries.size());
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const FlatBox b = box_of(entries[i].triangle);
      for (int k = 0; k < 3; ++k) low[k][i] = b.low[k], high[k][i] = b.high[k];
      begins[i] = entries[i].begins;
    }
  }
};

/// near[j], j > i: 1 where boxes i and j of a cell are no farther apart than `margin` and this is the first of the
/// cells that both reach into.
ISOSKIN_VECTORIZED
void compare_boxes(const BoxColumns& box, std::uint32_t i, std::uint32_t count, float margin, std::uint32_t* near) {
  constexpr std::uint32_t kAllAxes = 7;
  const float *x = box.low[0].data(), *y = box.low[1].data(), *z = box.low[2].data();
  const float *xx = box.high[0].data(), *yy = box.high[1].data(), *zz = box.high[2].data();
  const std::uint32_t* begins = box.begins.data();
  const float lx = x[i], ly = y[i], lz = z[i], hx = xx[i], hy = yy[i], hz = zz[i];
  const std::uint32_t own = begins[i];
  for (std::uint32_t j = i + 1; j < count; ++j) {
    const bool apart = (lx - xx[j] > margin) | (x[j] - hx > margin) | (ly - yy[j] > margin) | (y[j] - hy > margin) |
                       (lz - zz[j] > margin) | (z[j] - hz > margin);
    near[j] = !apart & ((own | begins[j]) == kAllAxes);
  }
}

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

std::vector<TrianglePair> near_boxes(std::size_t count, const BoxOf& box_of, double margin,
                                     const std::function<bool(const TrianglePair&)>& wanted,
                                     PairStatistics* statistics) {
  const CellTable table(make_grid(count, box_of, margin), count, box_of);

  struct Found {
    std::vector<TrianglePair> pairs;
    BoxColumns boxes;  // of a bucket
    std::vector<std::uint32_t> near;
    std::size_t candidates = 0;
  };
  tbb::enumerable_thread_specific<Found> found;
  const auto look_into = [&](std::span<const Entry> entries, Found& own) {
    const auto count = std::uint32_t(entries.size());
    own.boxes.assign(entries, box_of);
    own.near.resize(count);
    for (std::uint32_t i = 0; i + 1 < count; ++i) {
      compare_boxes(own.boxes, i, count, float(margin), own.near.data());
      for (std::uint32_t j = i + 1; j < count; ++j) {
        if (!own.near[j] || entries[i].cell != entries[j].cell) continue;
        const TrianglePair pair{std::min(entries[i].triangle, entries[j].triangle),
                                std::max(entries[i].triangle, entries[j].triangle)};
        ++own.candidates;
        if (wanted(pair)) own.pairs.push_back(pair);
      }
    }
  };
  constexpr std::size_t kBuckets = 1024;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, table.first.size() - 1, kBuckets), [&](const auto& range) {
    Found& own = found.local();
    for (std::size_t bucket = range.begin(); bucket != range.end(); ++bucket)
      if (table.first[bucket + 1] > table.first[bucket] + 1)
        look_into({table.entry.data() + table.first[bucket], table.entry.data() + table.first[bucket + 1]}, own);
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
  std::atomic<std::size_t> neighbours = 0;
  const auto is_wanted = [&](const TrianglePair& pair) {
    if (!share_a_vertex(mesh, pair.a, pair.b)) return wanted(pair);
    if (statistics) ++neighbours;
    return false;
  };
  const std::vector<TrianglePair> pairs = near_boxes(
      mesh.triangle_count(), [&](Index t) { return box_of(corners_of(mesh, t)); }, margin, is_wanted, statistics);
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
