#include "core/field/brick_builder.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace isoskin {
namespace {

constexpr int kBrick = BrickGrid::kBrick;
constexpr int kTaps = BrickGrid::kTaps;
constexpr int kMargin = 12;  // voxels the filter runs in before its first wanted tap
constexpr int kWindow = kTaps + 2 * kMargin;
constexpr float kPole = -0.26794919243112270f;  // sqrt(3) - 2
constexpr float kGain = 216.0f;                 // 6 an axis

// Copies F at the n^3 voxels from `first` on to out, z fastest.
void gather(const BlockValues& blocks, const IVec3& first, int n, float* out) {
  const auto segment = [&](const IVec3& voxel, int count, float* to) {
    const IVec3 block = voxel >> 3;
    const IVec3 b = block - blocks.low;
    const bool known =
        b.x >= 0 && b.y >= 0 && b.z >= 0 && b.x < blocks.size.x && b.y < blocks.size.y && b.z < blocks.size.z;
    const std::size_t entry = known ? blocks.entry(block) : 0;
    if (!known || !blocks.values[entry]) {
      std::fill_n(to, count, known ? blocks.constant[entry] : blocks.outside);
      return;
    }
    const float* from = blocks.values[entry] + ((voxel.x & 7) * kBrick + (voxel.y & 7)) * kBrick + (voxel.z & 7);
    std::copy_n(from, count, to);
  };
  for (int x = 0; x < n; ++x) {
    for (int y = 0; y < n; ++y) {
      for (int z = 0; z < n;) {
        const IVec3 voxel = first + IVec3(x, y, z);
        const int count = std::min(kBrick - (voxel.z & 7), n - z);
        segment(voxel, count, out + (x * n + y) * n + z);
        z += count;
      }
    }
  }
}

// Inverse of the sampled cubic B-spline (without its gain) along the rows of data[n][width]; rows from kMargin on are
// right, the signal counts as constant beyond both ends.
void filter_rows(float* data, int n, int width) {
  for (int i = 0; i < width; ++i) data[i] *= 1.0f / (1.0f - kPole);
  for (int k = 1; k < n; ++k) {
    float* row = data + k * width;
    for (int i = 0; i < width; ++i) row[i] += kPole * row[i - width];
  }
  float* last = data + (n - 1) * width;
  for (int i = 0; i < width; ++i) last[i] *= -kPole / (1.0f - kPole);
  for (int k = n - 2; k >= kMargin; --k) {
    float* row = data + k * width;
    for (int i = 0; i < width; ++i) row[i] = kPole * (row[i + width] - row[i]);
  }
}

// Spline coefficients of taps -1..9 from the window of values around them; spoils `window`.
void coefficients(std::vector<float>& window, std::vector<float>& turned, float* taps) {
  constexpr int kPlane = kWindow * kWindow, kRows = kTaps * kTaps;
  filter_rows(window.data(), kWindow, kPlane);
  for (int x = 0; x < kTaps; ++x) {
    float* plane = window.data() + (x + kMargin) * kPlane;
    filter_rows(plane, kWindow, kWindow);
    for (int y = 0; y < kTaps; ++y) {
      const float* row = plane + (y + kMargin) * kWindow;
      for (int z = 0; z < kWindow; ++z) turned[z * kRows + x * kTaps + y] = row[z];
    }
  }
  filter_rows(turned.data(), kWindow, kRows);
  for (int row = 0; row < kRows; ++row) {
    for (int z = 0; z < kTaps; ++z) taps[row * kTaps + z] = kGain * turned[(z + kMargin) * kRows + row];
  }
}

enum class Need : std::uint8_t { nothing, brick };

// What a block needs, told by F at taps -1..9.
Need need(const float* taps, bool has_values) {
  const auto [low, high] = std::minmax_element(taps, taps + BrickGrid::kTapValues);
  if (*low == *high) return Need::nothing;
  if (has_values) return Need::brick;
  const float own = taps[(kTaps + 1) * kTaps + 1];  // the block's constant: voxel (0,0,0)
  if (*low <= 0.0f && *high >= 0.0f) return Need::brick;
  return std::min(std::abs(*low), std::abs(*high)) < 0.5f * std::abs(own) ? Need::brick : Need::nothing;
}

}  // namespace

BrickGrid build_bricks(const BlockValues& blocks, const DVec3& origin, double h, Interpolation interpolation) {
  BrickGrid grid;
  grid.origin = origin;
  grid.h = h;
  grid.interpolation = interpolation;
  grid.outside = blocks.outside;
  grid.table_low = blocks.low - 1;
  grid.table_size = blocks.size + 2;
  const std::size_t entries = std::size_t(grid.table_size.x) * grid.table_size.y * grid.table_size.z;
  const auto block_of = [&](std::size_t entry) {
    const int z = static_cast<int>(entry % grid.table_size.z), xy = static_cast<int>(entry / grid.table_size.z);
    return grid.table_low + IVec3(xy / grid.table_size.y, xy % grid.table_size.y, z);
  };
  const auto source = [&](const IVec3& block) -> std::pair<const float*, float> {
    const IVec3 b = block - blocks.low;
    if (b.x < 0 || b.y < 0 || b.z < 0 || b.x >= blocks.size.x || b.y >= blocks.size.y || b.z >= blocks.size.z) {
      return {nullptr, blocks.outside};
    }
    const std::size_t entry = blocks.entry(block);
    return {blocks.values[entry], blocks.constant[entry]};
  };

  std::vector<Need> needs(entries, Need::nothing);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, entries, 64), [&](const tbb::blocked_range<std::size_t>& range) {
    std::vector<float> taps(BrickGrid::kTapValues);
    for (std::size_t entry = range.begin(); entry < range.end(); ++entry) {
      const IVec3 block = block_of(entry);
      const auto [values, constant] = source(block);
      bool alone = values == nullptr;  // one value, and so have all neighbours
      for (int n = 0; alone && n < 27; ++n) {
        const auto [other, value] = source(block + IVec3(n / 9, n / 3 % 3, n % 3) - 1);
        alone = !other && value == constant;
      }
      if (alone) continue;
      gather(blocks, block * kBrick - 1, kTaps, taps.data());
      needs[entry] = need(taps.data(), values != nullptr);
    }
  });

  grid.table.resize(entries);
  std::map<float, std::int32_t> constants;
  for (std::size_t entry = 0; entry < entries; ++entry) {
    const IVec3 block = block_of(entry);
    if (needs[entry] == Need::brick) {
      grid.table[entry] = static_cast<std::int32_t>(grid.brick_coordinate.size());
      grid.brick_coordinate.push_back(block);
      continue;
    }
    const auto [values, constant] = source(block);
    const float f = values ? values[0] : constant;
    const auto [at, fresh] = constants.try_emplace(f, static_cast<std::int32_t>(constants.size()));
    if (fresh) grid.constant.push_back(f);
    grid.table[entry] = -1 - at->second;
  }

  struct Workspace {
    std::vector<float> window = std::vector<float>(std::size_t(kWindow) * kWindow * kWindow);
    std::vector<float> turned = std::vector<float>(std::size_t(kWindow) * kTaps * kTaps);
  };
  tbb::enumerable_thread_specific<Workspace> workspaces;
  const std::size_t bricks = grid.brick_coordinate.size();
  grid.tap.resize(bricks * BrickGrid::kTapValues);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, bricks, 8), [&](const tbb::blocked_range<std::size_t>& range) {
    Workspace& work = workspaces.local();
    for (std::size_t brick = range.begin(); brick < range.end(); ++brick) {
      const IVec3 first = grid.brick_coordinate[brick] * kBrick - 1;
      float* taps = grid.tap.data() + brick * BrickGrid::kTapValues;
      if (interpolation == Interpolation::linear) {
        gather(blocks, first, kTaps, taps);
      } else {
        gather(blocks, first - kMargin, kWindow, work.window.data());
        coefficients(work.window, work.turned, taps);
      }
    }
  });
  return grid;
}

}  // namespace isoskin
