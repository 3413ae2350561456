#include "core/sampling/grid_lattice.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "core/parallel.h"
#include "core/vectorized.h"

namespace isoskin {
namespace {

constexpr int kCorners = BrickLattice::kCorners;
constexpr int kTaps = BrickGrid::kTaps;

/// Nine lattice corners in a row from a window of `width` taps: corner i is the sum of weight[i][k] * tap[start[i] +
/// k].
struct Row {
  int width = 0;
  std::array<int, kCorners> start{};
  std::array<std::array<double, 4>, kCorners> weight{};
};

std::array<double, 4> weights(Interpolation interpolation, double t) {
  if (interpolation == Interpolation::linear) return {0.0, 1.0 - t, t, 0.0};
  const double s = 1.0 - t;
  return {s * s * s / 6.0, (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0, (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
          t * t * t / 6.0};
}

Row make_row(Interpolation interpolation, int parts) {
  Row row;
  row.width = BrickLattice::kCells / parts + 3;
  for (int i = 0; i < kCorners; ++i) {
    const int base = i / parts;
    row.start[i] = std::min(base, row.width - 4);
    const std::array<double, 4> w = weights(interpolation, static_cast<double>(i % parts) / parts);
    // At the window's end the last weight is zero and its tap is not there: shift by one.
    for (int k = 0; k < 4; ++k)
      if (k + base - row.start[i] < 4) row.weight[i][k + base - row.start[i]] = w[k];
  }
  return row;
}

int floor_div(int a, int b) {
  return a >= 0 ? a / b : -((b - 1 - a) / b);
}

std::int32_t table_entry(const BrickGrid& grid, const IVec3& brick, bool& present) {
  const IVec3 at = brick - grid.table_low;
  present = at.x >= 0 && at.y >= 0 && at.z >= 0 && at.x < grid.table_size.x && at.y < grid.table_size.y &&
            at.z < grid.table_size.z;
  return present ? grid.table[(static_cast<std::size_t>(at.x) * grid.table_size.y + at.y) * grid.table_size.z + at.z]
                 : -1;
}

/// Bit z where tap z of a row is inside.
std::uint16_t signs_of_taps(const float* tap) {
#ifdef __SSE2__
  const __m128 zero = _mm_setzero_ps();
  const int low = _mm_movemask_ps(_mm_cmpgt_ps(_mm_loadu_ps(tap), zero));
  const int middle = _mm_movemask_ps(_mm_cmpgt_ps(_mm_loadu_ps(tap + 4), zero));
  const int high = _mm_movemask_ps(_mm_cmpgt_ps(_mm_loadu_ps(tap + kTaps - 4), zero));
  return static_cast<std::uint16_t>(low | middle << 4 | high << (kTaps - 4));
#else
  unsigned bits = 0;
  for (int z = 0; z < kTaps; ++z) bits |= static_cast<unsigned>(tap[z] > 0.0f) << z;
  return static_cast<std::uint16_t>(bits);
#endif
}

/// values[729] from the window of w^3 taps that begins at `first` in a grid brick.
template <int w>
[[gnu::always_inline]] inline void interpolate(const float* tap, const IVec3& first, const Row& row, float* values) {
  constexpr int plane = w * w;
  double window[w * plane];
  for (int x = 0; x < w; ++x)
    for (int y = 0; y < w; ++y)
      for (int z = 0; z < w; ++z)
        window[x * plane + y * w + z] = tap[((first.x + x) * kTaps + first.y + y) * kTaps + first.z + z];
  double along_x[kCorners * plane];
  for (int i = 0; i < kCorners; ++i) {
    const double* t = window + row.start[i] * plane;
    const auto& c = row.weight[i];
    for (int j = 0; j < plane; ++j)
      along_x[i * plane + j] = c[0] * t[j] + c[1] * t[plane + j] + c[2] * t[2 * plane + j] + c[3] * t[3 * plane + j];
  }
  double along_y[w][kCorners];  // by tap along z, so that the last sum runs over neighbours in memory
  for (int x = 0; x < kCorners; ++x) {
    for (int i = 0; i < kCorners; ++i) {
      const double* t = along_x + x * plane + row.start[i] * w;
      const auto& c = row.weight[i];
      for (int j = 0; j < w; ++j)
        along_y[j][i] = c[0] * t[j] + c[1] * t[w + j] + c[2] * t[2 * w + j] + c[3] * t[3 * w + j];
    }
    float along_z[kCorners][kCorners];
    for (int i = 0; i < kCorners; ++i) {
      const auto* t = along_y + row.start[i];
      const auto& c = row.weight[i];
      for (int y = 0; y < kCorners; ++y)
        along_z[i][y] = static_cast<float>(c[0] * t[0][y] + c[1] * t[1][y] + c[2] * t[2][y] + c[3] * t[3][y]);
    }
    for (int y = 0; y < kCorners; ++y)
      for (int i = 0; i < kCorners; ++i) values[(x * kCorners + y) * kCorners + i] = along_z[i][y];
  }
}

ISOSKIN_VECTORIZED void interpolate(const float* tap, const IVec3& first, const Row& row, float* values) {
  switch (row.width) {
    case 4:
      return interpolate<4>(tap, first, row, values);
    case 5:
      return interpolate<5>(tap, first, row, values);
    case 7:
      return interpolate<7>(tap, first, row, values);
    default:
      return interpolate<11>(tap, first, row, values);
  }
}

}  // namespace

int grid_parts(const BrickGrid& grid, double spacing) {
  for (const int n : {1, 2, 4, 8})
    if (std::abs(spacing * n - grid.h) <= 1e-6 * grid.h) return n;
  return 0;
}

std::vector<IVec3> grid_candidates(const BrickGrid& grid, int parts, const ChangeMask* only) {
  const int width = BrickLattice::kCells / parts;  // voxels a lattice brick
  const bool cubic = grid.interpolation == Interpolation::cubic;
  const int from = cubic ? 0 : 1, to = width + (cubic ? 2 : 1);  // taps that lattice brick (0,0,0) reads
  const auto left_out = [&](const IVec3& low, int voxels) {
    const DVec3 corner = grid.origin + grid.h * DVec3(low);
    return only && !only->overlaps({corner, corner + grid.h * double(voxels)});
  };
  std::vector<std::vector<IVec3>> found(grid.brick_coordinate.size());
  for_each_heavy(found.size(), [&](std::size_t b) {
    if (left_out(BrickGrid::kBrick * grid.brick_coordinate[b], BrickGrid::kBrick)) return;
    const float* tap = &grid.tap[b * BrickGrid::kTapValues];
    std::array<std::uint16_t, kTaps * kTaps> inside;  // bit z of a row
    for (int row = 0; row < kTaps * kTaps; ++row) inside[row] = signs_of_taps(tap + row * kTaps);
    for (int i = 0; i < parts * parts * parts; ++i) {
      const IVec3 sub(i / (parts * parts), i / parts % parts, i % parts);
      unsigned any = 0, all = ~0u;
      for (int x = sub.x * width + from; x <= sub.x * width + to; ++x)
        for (int y = sub.y * width + from; y <= sub.y * width + to; ++y)
          any |= inside[x * kTaps + y], all &= inside[x * kTaps + y];
      const unsigned taps = ((1u << (to - from + 1)) - 1) << (sub.z * width + from);
      const IVec3 brick = grid.brick_coordinate[b] * parts + sub;
      if ((any & taps) != 0 && (all & taps) != taps && !left_out(width * brick, width)) found[b].push_back(brick);
    }
  });
  std::vector<IVec3> all;
  for (const auto& f : found) all.insert(all.end(), f.begin(), f.end());
  tbb::parallel_sort(all.begin(), all.end(), [](const IVec3& a, const IVec3& b) {
    return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.z < b.z;
  });
  return all;
}

void evaluate_grid(const BrickGrid& grid, int parts, BrickLattice& lattice, const std::vector<Index>& bricks) {
  const Row row = make_row(grid.interpolation, parts);
  const int width = BrickLattice::kCells / parts;
  tbb::parallel_for(std::size_t{0}, bricks.size(), [&](std::size_t k) {
    const IVec3 c = lattice.coordinate[bricks[k]];
    const IVec3 brick(floor_div(c.x, parts), floor_div(c.y, parts), floor_div(c.z, parts));
    float* values = &lattice.value[std::size_t{bricks[k]} * BrickLattice::kValues];
    bool present = false;
    const std::int32_t entry = table_entry(grid, brick, present);
    if (present && entry >= 0)
      interpolate(&grid.tap[static_cast<std::size_t>(entry) * BrickGrid::kTapValues], (c - brick * parts) * width, row,
                  values);
    else
      std::fill_n(values, BrickLattice::kValues, present ? grid.constant[-1 - entry] : grid.outside);
  });
}

}  // namespace isoskin
