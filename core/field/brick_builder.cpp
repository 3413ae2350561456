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
constexpr int kRun = 8;  // bricks in a row along z that are filtered together
constexpr int kLongest = kWindow + (kRun - 1) * kBrick;
constexpr float kPole = -0.26794919243112270f;  // sqrt(3) - 2
constexpr float kGain = 216.0f;                 // 6 an axis

// F of a block: its values (null where it has one only), and that one.
std::pair<const float*, float> block_source(const BlockValues& blocks, const IVec3& block) {
  const IVec3 b = block - blocks.low;
  if (b.x < 0 || b.y < 0 || b.z < 0 || b.x >= blocks.size.x || b.y >= blocks.size.y || b.z >= blocks.size.z)
    return {nullptr, blocks.outside};
  const std::size_t entry = blocks.entry(block);
  return {blocks.values[entry], blocks.constant[entry]};
}

// Copies F at the voxels of the box of `size` from `first` on to out, z fastest; block by block.
void gather(const BlockValues& blocks, const IVec3& first, const IVec3& size, float* out) {
  const auto copy_block = [&](const IVec3& block) {
    const auto [values, constant] = block_source(blocks, block);
    const IVec3 low = glm::max(first, block * kBrick), high = glm::min(first + size, (block + 1) * kBrick);
    const int count = high.z - low.z;
    for (int x = low.x; x < high.x; ++x)
      for (int y = low.y; y < high.y; ++y) {
        float* to = out + ((x - first.x) * size.y + (y - first.y)) * size.z + (low.z - first.z);
        if (!values) {
          std::fill_n(to, count, constant);
          continue;
        }
        const float* from = values + ((x & 7) * kBrick + (y & 7)) * kBrick + (low.z & 7);
        if (count == kBrick)
          std::copy_n(from, kBrick, to);  // a known length: no call
        else
          std::copy_n(from, count, to);
      }
  };
  const IVec3 last = (first + size - 1) >> 3;
  for (IVec3 block = first >> 3; block.x <= last.x; ++block.x)
    for (block.y = first.y >> 3; block.y <= last.y; ++block.y)
      for (block.z = first.z >> 3; block.z <= last.z; ++block.z) copy_block(block);
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

// Spline coefficients of taps -1..9 of bricks in a row along z from the window of values around them; spoils `window`.
void coefficients(std::vector<float>& window, std::vector<float>& turned, int bricks, float* taps) {
  constexpr int kRows = kTaps * kTaps;
  const int length = kWindow + (bricks - 1) * kBrick, plane = kWindow * length;
  filter_rows(window.data(), kWindow, plane);
  for (int x = 0; x < kTaps; ++x) filter_rows(window.data() + (x + kMargin) * plane, kWindow, length);
  for (int b = 0; b < bricks; ++b, taps += BrickGrid::kTapValues) {
    for (int x = 0; x < kTaps; ++x)
      for (int y = 0; y < kTaps; ++y) {
        const float* row = window.data() + (x + kMargin) * plane + (y + kMargin) * length + b * kBrick;
        for (int z = 0; z < kWindow; ++z) turned[z * kRows + x * kTaps + y] = row[z];
      }
    filter_rows(turned.data(), kWindow, kRows);
    for (int row = 0; row < kRows; ++row)
      for (int z = 0; z < kTaps; ++z) taps[row * kTaps + z] = kGain * turned[(z + kMargin) * kRows + row];
  }
}

// Of bricks in order, where runs of up to kRun in a row along z begin, and the end.
std::vector<std::size_t> runs_of(const std::vector<IVec3>& bricks) {
  std::vector<std::size_t> first;
  for (std::size_t b = 0; b < bricks.size(); ++b) {
    const bool goes_on = b > 0 && b - first.back() < kRun && bricks[b] == bricks[b - 1] + IVec3(0, 0, 1);
    if (!goes_on) first.push_back(b);
  }
  first.push_back(bricks.size());
  return first;
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
  const auto source = [&](const IVec3& block) { return block_source(blocks, block); };
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
      gather(blocks, block * kBrick - 1, IVec3(kTaps), taps.data());
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
    std::vector<float> window = std::vector<float>(std::size_t(kWindow) * kWindow * kLongest);
    std::vector<float> turned = std::vector<float>(std::size_t(kWindow) * kTaps * kTaps);
  };
  tbb::enumerable_thread_specific<Workspace> workspaces;
  grid.tap.resize(grid.brick_coordinate.size() * BrickGrid::kTapValues);
  const std::vector<std::size_t> runs = runs_of(grid.brick_coordinate);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, runs.size() - 1, 4), [&](const auto& range) {
    Workspace& work = workspaces.local();
    for (std::size_t run = range.begin(); run < range.end(); ++run) {
      const IVec3 first = grid.brick_coordinate[runs[run]] * kBrick - 1;
      const int bricks = static_cast<int>(runs[run + 1] - runs[run]);
      float* taps = grid.tap.data() + runs[run] * BrickGrid::kTapValues;
      if (interpolation == Interpolation::linear) {
        for (int b = 0; b < bricks; ++b)
          gather(blocks, first + IVec3(0, 0, b * kBrick), IVec3(kTaps), taps + b * BrickGrid::kTapValues);
      } else {
        gather(blocks, first - kMargin, {kWindow, kWindow, kWindow + (bricks - 1) * kBrick}, work.window.data());
        coefficients(work.window, work.turned, bricks, taps);
      }
    }
  });
  return grid;
}

}  // namespace isoskin
