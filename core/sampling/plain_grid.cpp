#include "core/sampling/plain_grid.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "core/four.h"
#include "core/sampling/surface_bricks.h"
#include "core/vectorized.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickGrid::kBrick;
constexpr int kTaps = BrickGrid::kTaps;
constexpr int kRows = kTaps * kTaps;
constexpr std::array<int, 3> kStride{kRows, kTaps, 1};
constexpr int kSupport = 4;      // taps a cell sees on each axis
constexpr float kSlack = 1e-6f;  // of the largest coefficient, for rounding
/// Along which F may rise or fall: the axes, then diagonals.
const std::array<IVec3, 13> kDirections{
    IVec3(1, 0, 0), IVec3(0, 1, 0),  IVec3(0, 0, 1), IVec3(1, 1, 0),  IVec3(1, -1, 0), IVec3(0, 1, 1),  IVec3(0, 1, -1),
    IVec3(1, 0, 1), IVec3(1, 0, -1), IVec3(1, 1, 1), IVec3(1, 1, -1), IVec3(1, -1, 1), IVec3(1, -1, -1)};
constexpr int kAxisWays = 6;  // those that taps tell
constexpr int kWays = 26;     // rises along the first direction, falls, rises along the second, ...

/// Bits of a brick's taps: bit z of row x * kTaps + y.
using TapBits = std::array<std::uint16_t, kRows>;
/// Bits of its cells: bit y * 8 + z of word x.
using CellBits = std::array<std::uint64_t, kCells>;

/// Signs of p[z] - q[z], bit z set where that is less than zero, for z up to `last`, 9 or 10. Neither is read behind.
unsigned less(const float* p, const float* q, int last) {
#ifdef __SSE2__
  const auto four = [&](int z) {
    return static_cast<unsigned>(_mm_movemask_ps(_mm_cmplt_ps(_mm_loadu_ps(p + z), _mm_loadu_ps(q + z)))) << z;
  };
  return four(0) | four(4) | four(last - 3);
#else
  unsigned bits = 0;
  for (int z = 0; z <= last; ++z) bits |= static_cast<unsigned>(p[z] < q[z]) << z;
  return bits;
#endif
}

/// Where F, as far as taps tell, rises or falls from a tap to the next along an axis.
void compare(const float* tap, int axis, TapBits& rises, TapBits& falls) {
  const IVec3 count = IVec3(kTaps) - IVec3(axis == 0, axis == 1, axis == 2);
  for (int x = 0; x < count.x; ++x)
    for (int y = 0; y < count.y; ++y) {
      const float *here = tap + (x * kTaps + y) * kTaps, *there = here + kStride[axis];
      rises[x * kTaps + y] = static_cast<std::uint16_t>(less(here, there, count.z - 1));
      falls[x * kTaps + y] = static_cast<std::uint16_t>(less(there, here, count.z - 1));
    }
}

/// Of every cell, whether the bits of all taps (with `any`: of one) in a box of `size` from its first one on are set.
CellBits over_boxes(const TapBits& bits, const IVec3& size, bool any) {
  const std::uint16_t flip = any ? 0xffff : 0;  // any is not none
  std::array<std::uint16_t, kRows + (kSupport - 1) * (kTaps + 1)> row{};
  for (int r = 0; r < kRows; ++r) row[r] = bits[r] ^ flip;
  const auto join = [&](int step, int times) {
    for (int k = 1; k < times; k *= 2) {
      const int by = std::min(k, times - k) * step;
      for (int r = 0; r < kRows; ++r) row[r] &= row[r + by];
    }
  };
  for (int r = 0; r < kRows; ++r) {
    const unsigned whole = row[r];
    row[r] = static_cast<std::uint16_t>(whole & whole >> 1 & whole >> 2 & (size.z == kSupport ? whole >> 3 : whole));
  }
  join(1, size.y);
  join(kTaps, size.x);
  CellBits out{};
  for (int x = 0; x < kCells; ++x)
    for (int y = 0; y < kCells; ++y) out[x] |= std::uint64_t((row[x * kTaps + y] ^ flip) & 0xffu) << 8 * y;
  return out;
}

/// Bits of the cells such that those of all cells about them (in the brick) are set.
CellBits all_about(const CellBits& bits) {
  constexpr std::uint64_t kFirstZ = 0x0101010101010101, kLastZ = kFirstZ << 7;
  constexpr std::uint64_t kFirstY = 0xff, kLastY = kFirstY << 56;
  CellBits flat, out;
  for (int x = 0; x < kCells; ++x) {
    std::uint64_t b = bits[x];
    b &= (b << 1 | kFirstZ) & (b >> 1 | kLastZ);
    flat[x] = b & (b << 8 | kFirstY) & (b >> 8 | kLastY);
  }
  for (int x = 0; x < kCells; ++x) out[x] = flat[std::max(x - 1, 0)] & flat[x] & flat[std::min(x + 1, kCells - 1)];
  return out;
}

/// The cells that the surface may cross, and those through which F rises or falls along a direction, as far as is told.
struct Brick {
  CellBits crossed{};
  std::array<CellBits, kWays> way{};

  /// As far as taps tell.
  explicit Brick(const float* tap) {
    constexpr std::array<float, kTaps> kZero{};
    TapBits inside;
    for (int r = 0; r < kRows; ++r)
      inside[r] = static_cast<std::uint16_t>(less(kZero.data(), tap + r * kTaps, kTaps - 1));
    const CellBits some = over_boxes(inside, IVec3(kSupport), true), all = over_boxes(inside, IVec3(kSupport), false);
    for (int x = 0; x < kCells; ++x) crossed[x] = some[x] & ~all[x];
    if (empty()) return;
    for (int axis = 0; axis < 3; ++axis) {
      TapBits rises{}, falls{};
      compare(tap, axis, rises, falls);
      IVec3 size(kSupport);
      --size[axis];
      way[2 * axis] = over_boxes(rises, size, false);
      way[2 * axis + 1] = over_boxes(falls, size, false);
    }
  }
  bool empty() const { return crossed == CellBits{}; }
};

/// Crossed cells about which F goes none of the first so many ways throughout.
CellBits rough_cells(const Brick& brick, int ways) {
  CellBits rough = brick.crossed;
  for (int w = 0; w < ways && rough != CellBits{}; ++w) {
    CellBits smooth;
    for (int x = 0; x < kCells; ++x) smooth[x] = brick.way[w][x] | ~brick.crossed[x];
    smooth = all_about(smooth);
    for (int x = 0; x < kCells; ++x) rough[x] &= ~smooth[x];
  }
  return rough;
}

/// Crossed cells of which taps tell no way.
CellBits untold_cells(const Brick& brick) {
  CellBits untold = brick.crossed;
  for (int w = 0; w < kAxisWays; ++w)
    for (int x = 0; x < kCells; ++x) untold[x] &= ~brick.way[w][x];
  return untold;
}

/// Crossed cells that are one of these or beside one.
CellBits crossed_about(const Brick& brick, CellBits cells) {
  for (std::uint64_t& word : cells) word = ~word;
  cells = all_about(cells);
  for (int x = 0; x < kCells; ++x) cells[x] = ~cells[x] & brick.crossed[x];
  return cells;
}

template <class Visit>
void for_each_cell(const CellBits& bits, const Visit& visit) {
  for (int x = 0; x < kCells; ++x)
    for (std::uint64_t left = bits[x]; left; left &= left - 1) {
      const int bit = std::countr_zero(left);
      visit(IVec3(x, bit / 8, bit % 8));
    }
}

float greatest(Four v, int count) {
  float most = 0.0f;
  for (int i = 0; i < count; ++i) most = std::max(most, v[i]);
  return most;
}

/// Is F farther from zero in the middle of a cell than its slopes, which lie in the hull of the taps' differences, can
/// make up for? `tap`: the cell's first.
bool is_far(const float* tap) {
  constexpr std::array<float, kSupport> kMiddle{1.0f / 48.0f, 23.0f / 48.0f, 23.0f / 48.0f, 1.0f / 48.0f};
  Four sum{}, along_x{}, along_y{}, along_z{};
  const auto size = [](Four v) { return greater_of(v, -v); };
  for (int x = 0; x < kSupport; ++x)
    for (int y = 0; y < kSupport; ++y) {
      const float* at = tap + x * kStride[0] + y * kStride[1];
      const Four row = load(at);
      sum += kMiddle[x] * kMiddle[y] * row;
      const Four shifted{row[1], row[2], row[3], row[3]};
      along_z = greater_of(along_z, size(shifted - row));
      if (x > 0) along_x = greater_of(along_x, size(row - load(at - kStride[0])));
      if (y > 0) along_y = greater_of(along_y, size(row - load(at - kStride[1])));
    }
  const float value = kMiddle[0] * (sum[0] + sum[3]) + kMiddle[1] * (sum[1] + sum[2]);
  const float reach = 0.5f * (greatest(along_x, 4) + greatest(along_y, 4) + greatest(along_z, 3));
  return std::abs(value) > (1.0f + 10.0f * kSlack) * reach;
}

/// Bernstein coefficients of F in one cell, index (x * 4 + y) * 4 + z.
using Coefficients = std::array<float, kSupport * kSupport * kSupport>;

/// From the B-spline's, in lines along an axis.
template <int stride>
[[gnu::always_inline]] inline void to_bernstein(Coefficients& c) {
  for (int group = 0; group < 64; group += 4 * stride)
    for (int i = group; i < group + stride; ++i) {
      const float c0 = c[i], c1 = c[i + stride], c2 = c[i + 2 * stride], c3 = c[i + 3 * stride];
      c[i] = (c0 + 4.0f * c1 + c2) / 6.0f;
      c[i + stride] = (2.0f * c1 + c2) / 3.0f;
      c[i + 2 * stride] = (c1 + 2.0f * c2) / 3.0f;
      c[i + 3 * stride] = (c1 + 4.0f * c2 + c3) / 6.0f;
    }
}

ISOSKIN_VECTORIZED void find_bernstein(const float* tap, Coefficients& c) {
  for (int x = 0; x < kSupport; ++x)
    for (int y = 0; y < kSupport; ++y)
      for (int z = 0; z < kSupport; ++z) c[(x * kSupport + y) * kSupport + z] = tap[(x * kTaps + y) * kTaps + z];
  to_bernstein<16>(c);
  to_bernstein<4>(c);
  to_bernstein<1>(c);
}

/// Rows of a cell's coefficients along z, index x * 4 + y.
using CellRows = std::array<Four, kSupport * kSupport>;

/// Of four coefficients along an axis, a third of F's derivative along it, raised to F's own degree.
[[gnu::always_inline]] inline void find_slopes(Four c0, Four c1, Four c2, Four c3, Four* out, int step) {
  const Four a = c1 - c0, b = c2 - c1, d = c3 - c2;
  out[0] = a;
  out[step] = (a + 2.0f * b) / 3.0f;
  out[2 * step] = (2.0f * b + d) / 3.0f;
  out[3 * step] = d;
}

/// Those derivatives along all axes.
std::array<CellRows, 3> slopes(const Coefficients& coefficients) {
  CellRows row;
  for (int r = 0; r < 16; ++r) row[r] = load(&coefficients[4 * r]);
  std::array<CellRows, 3> out;
  for (int i = 0; i < kSupport; ++i) {
    find_slopes(row[i], row[4 + i], row[8 + i], row[12 + i], &out[0][i], 4);
    find_slopes(row[4 * i], row[4 * i + 1], row[4 * i + 2], row[4 * i + 3], &out[1][4 * i], 1);
  }
  for (int r = 0; r < 16; ++r) {
    const Four c = row[r], lower{c[0], c[0], c[1], c[2]}, middle{c[1], c[1], c[2], c[3]}, upper{c[1], c[2], c[3], c[3]};
    const Four first = middle - lower, second = upper - middle;  // a a b d, 0 b d 0
    const Four inner = (Four{0.0f, 1.0f, 2.0f, 0.0f} * first + Four{0.0f, 2.0f, 1.0f, 0.0f} * second) / 3.0f;
    out[2][r] = Four{first[0], inner[1], inner[2], first[3]};
  }
  return out;
}

/// Tells by its Bernstein form, which is much closer than the hull of taps, whether the surface may cross a cell, and
/// which of the first so many ways F goes there. `tap`: the brick's first.
void look_closer(const float* tap, const IVec3& cell, int ways, Brick& brick) {
  const float* const first = tap + cell.x * kStride[0] + cell.y * kStride[1] + cell.z;
  const std::uint64_t bit = std::uint64_t{1} << (cell.y * 8 + cell.z);
  Coefficients c;
  bool crossed = !is_far(first);
  float slack = 0.0f;
  if (crossed) {
    find_bernstein(first, c);
    Extremes of(load(c.data()));
    of.add(c.data(), static_cast<int>(c.size()));
    slack = kSlack * std::max(std::abs(of.low()), std::abs(of.high()));
    crossed = of.low() <= slack && of.high() >= -slack;
  }
  if (!crossed) {
    brick.crossed[cell.x] &= ~bit;
    return;
  }
  const std::array<CellRows, 3> slope = slopes(c);
  for (int w = 0; w < ways; w += 2) {
    const Vec3 along(kDirections[w / 2]);
    const auto sum = [&](int r) { return along.x * slope[0][r] + along.y * slope[1][r] + along.z * slope[2][r]; };
    Extremes of(sum(0));
    for (int r = 1; r < 16; ++r) of.add(sum(r));
    if (of.low() > slack) brick.way[w][cell.x] |= bit;
    if (of.high() < -slack) brick.way[w + 1][cell.x] |= bit;
  }
}

bool is_plain(const float* tap) {
  Brick brick(tap);
  if (brick.empty() || rough_cells(brick, kAxisWays) == CellBits{}) return true;
  const auto look = [&](const CellBits& cells, int ways) {
    for_each_cell(cells, [&](const IVec3& cell) { look_closer(tap, cell, ways, brick); });
  };
  look(untold_cells(brick), kAxisWays);
  const CellBits rough = rough_cells(brick, kAxisWays);
  if (rough == CellBits{}) return true;
  look(crossed_about(brick, rough), kWays);
  return rough_cells(brick, kWays) == CellBits{};
}

}  // namespace

std::optional<IVec3> find_rough(const BrickGrid& grid, const ChangeMask* only) {
  const std::vector<IVec3>& bricks = grid.brick_coordinate;
  std::atomic<std::size_t> rough{bricks.size()};
  sampling::for_bricks(bricks.size(), [&](std::size_t b) {
    if (rough.load(std::memory_order_relaxed) != bricks.size()) return;
    const DVec3 low = grid.origin + grid.h * DVec3(kCells * bricks[b]);
    if (only && !only->overlaps({low, low + grid.h * double(kCells)})) return;
    if (grid.interpolation != Interpolation::cubic || !is_plain(&grid.tap[b * BrickGrid::kTapValues]))
      rough.store(b, std::memory_order_relaxed);
  });
  if (rough == bricks.size()) return std::nullopt;
  return bricks[rough];
}

bool is_rough(const BrickGrid& grid, const IVec3& brick) {
  const IVec3 at = brick - grid.table_low;
  if (glm::any(glm::lessThan(at, IVec3(0))) || glm::any(glm::greaterThanEqual(at, grid.table_size))) return false;
  const std::int32_t entry =
      grid.table[(static_cast<std::size_t>(at.x) * grid.table_size.y + at.y) * grid.table_size.z + at.z];
  return entry >= 0 && (grid.interpolation != Interpolation::cubic ||
                        !is_plain(&grid.tap[static_cast<std::size_t>(entry) * BrickGrid::kTapValues]));
}

}  // namespace isoskin
