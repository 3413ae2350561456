#include "core/field/field_changes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include <tbb/parallel_for.h>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"

namespace isoskin {
namespace {

constexpr int kBrick = BrickGrid::kBrick, kTaps = BrickGrid::kTaps;
constexpr int kCube = kBrick / 2;  // voxels
constexpr int kCubesABrick = 8;    // bits
constexpr double kSliver = 1e-6;   // of a cell: sides that only touch, in spite of rounding
constexpr unsigned kAll = (1u << kCubesABrick) - 1;

bool alike(const BrickGrid& a, const BrickGrid& b) {
  return a.origin == b.origin && a.h == b.h && a.interpolation == b.interpolation && a.outside == b.outside;
}

/// Entry of the grid's table for a brick; null beyond it.
const std::int32_t* find_entry(const BrickGrid& grid, const IVec3& brick) {
  const IVec3 at = brick - grid.table_low;
  if (at.x < 0 || at.y < 0 || at.z < 0 || at.x >= grid.table_size.x || at.y >= grid.table_size.y ||
      at.z >= grid.table_size.z)
    return nullptr;
  return &grid.table[(static_cast<std::size_t>(at.x) * grid.table_size.y + at.y) * grid.table_size.z + at.z];
}

float constant_of(const BrickGrid& grid, const std::int32_t* entry) {
  return entry ? grid.constant[static_cast<std::size_t>(-1 - *entry)] : grid.outside;
}

/// One bit a cube of a brick: whether a tap that its cells see differs.
unsigned changed_cubes(const float* a, const float* b) {
  if (std::memcmp(a, b, BrickGrid::kTapValues * sizeof(float)) == 0) return 0;
  constexpr int kSeen = kCube + 3;  // taps on each axis
  unsigned changed = 0;
  for (int cube = 0; cube < kCubesABrick; ++cube) {
    const IVec3 low = kCube * IVec3(cube >> 2, cube >> 1 & 1, cube & 1);
    for (int row = 0; row < kSeen * kSeen && !(changed >> cube & 1); ++row) {
      const int at = ((low.x + row / kSeen) * kTaps + low.y + row % kSeen) * kTaps + low.z;
      changed |= unsigned(std::memcmp(a + at, b + at, kSeen * sizeof(float)) != 0) << cube;
    }
  }
  return changed;
}

/// Of one brick of `after`'s table.
unsigned changed_cubes(const BrickGrid& before, const BrickGrid& after, const IVec3& brick) {
  const std::int32_t *old = find_entry(before, brick), *now = find_entry(after, brick);
  const bool had = old && *old >= 0, has = now && *now >= 0;
  if (had != has) return kAll;
  if (!has) return constant_of(before, old) == constant_of(after, now) ? 0 : kAll;
  return changed_cubes(&before.tap[static_cast<std::size_t>(*old) * BrickGrid::kTapValues],
                       &after.tap[static_cast<std::size_t>(*now) * BrickGrid::kTapValues]);
}

FieldChanges changes_between(const BrickGrid& before, const BrickGrid& after) {
  FieldChanges changes;
  changes.everywhere = !alike(before, after);
  if (changes.everywhere) return changes;
  changes.rounded_anew = before.table_low != after.table_low;
  const IVec3 low = glm::min(before.table_low, after.table_low);
  const IVec3 size = glm::max(before.table_low + before.table_size, after.table_low + after.table_size) - low;
  std::vector<std::vector<Box>> found(static_cast<std::size_t>(size.x));
  tbb::parallel_for(0, size.x, [&](int x) {
    for (int y = 0; y < size.y; ++y)
      for (int z = 0; z < size.z; ++z) {
        const IVec3 brick = low + IVec3(x, y, z);
        const unsigned changed = changed_cubes(before, after, brick);
        for (int cube = 0; cube < kCubesABrick; ++cube) {
          if (!(changed >> cube & 1)) continue;
          const DVec3 from(kBrick * brick + kCube * IVec3(cube >> 2, cube >> 1 & 1, cube & 1));
          found[x].push_back({after.origin + after.h * from, after.origin + after.h * (from + double(kCube))});
        }
      }
  });
  for (const auto& boxes : found) changes.box.insert(changes.box.end(), boxes.begin(), boxes.end());
  return changes;
}

FieldChanges changes_between(const SkeletonField& before, const SkeletonField& after) {
  FieldChanges changes;
  changes.everywhere = before.iso() != after.iso() || before.elements().size() != after.elements().size();
  changes.rounded_anew = before.origin() != after.origin();
  for (std::size_t i = 0; i < after.elements().size() && !changes.everywhere; ++i) {
    if (before.elements()[i] == after.elements()[i]) continue;
    for (const Box& support : {before.support(i), after.support(i)}) {
      changes.everywhere |= !std::isfinite(support.diagonal());
      changes.box.push_back(support);
    }
  }
  return changes;
}

}  // namespace

FieldChanges changes_between(const Field& before, const Field& after) {
  if (&before == &after) return {};
  const auto *old_grid = dynamic_cast<const GridField*>(&before), *grid = dynamic_cast<const GridField*>(&after);
  if (old_grid && grid) return changes_between(*old_grid->grid(), *grid->grid());
  const auto *old = dynamic_cast<const SkeletonField*>(&before), *skeleton = dynamic_cast<const SkeletonField*>(&after);
  if (old && skeleton) return changes_between(*old, *skeleton);
  return {true, {}};
}

ChangeMask::ChangeMask(const FieldChanges& changes, double margin) : everywhere_(changes.everywhere) {
  if (everywhere_) std::swap(low_, high_);
  if (everywhere_ || changes.box.empty()) return;
  constexpr double kMostCells = 1 << 22, kCellsABox = 4.0;
  Box all;
  double least = std::numeric_limits<double>::infinity();
  bool raster = margin == 0.0;
  for (const Box& box : changes.box) {
    all.add(box);
    const DVec3 size = box.size();
    raster = raster && size == changes.box.front().size() && size.x == size.y && size.y == size.z;
    least = std::min({least, size.x, size.y, size.z});
  }
  all = all.grown(margin);
  side_ = std::max(raster ? least : (least + 2.0 * margin) / kCellsABox, 1e-6 * all.diagonal());
  const DVec3 across = all.size();
  while ((across.x / side_ + 1.0) * (across.y / side_ + 1.0) * (across.z / side_ + 1.0) > kMostCells) side_ *= 2.0;
  origin_ = all.low;
  size_ = IVec3(glm::floor(across / side_)) + 1;
  low_ = origin_ - side_;  // by more than rounding
  high_ = origin_ + side_ * DVec3(size_ + 1);
  cell_.assign(static_cast<std::size_t>(size_.x) * size_.y * size_.z, 0);
  for (const Box& box : changes.box) {
    const Box grown = box.grown(margin - kSliver * side_);
    const IVec3 low = glm::max(cell_of(grown.low), IVec3(0)), high = glm::min(cell_of(grown.high), size_ - 1);
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y)
        std::fill_n(&cell_[(static_cast<std::size_t>(x) * size_.y + y) * size_.z + low.z], high.z - low.z + 1,
                    std::uint8_t{1});
  }
}

IVec3 ChangeMask::cell_of(const DVec3& p) const {
  return IVec3(glm::clamp(glm::floor((p - origin_) / side_), DVec3(-1.0), DVec3(size_)));
}

bool ChangeMask::any_cell(const Box& b) const {
  const Box open = b.grown(glm::all(glm::greaterThan(b.size(), DVec3(4.0 * kSliver * side_))) ? -kSliver * side_ : 0.0);
  const IVec3 low = glm::max(cell_of(open.low), IVec3(0)), high = glm::min(cell_of(open.high), size_ - 1);
  for (int x = low.x; x <= high.x; ++x)
    for (int y = low.y; y <= high.y; ++y)
      for (int z = low.z; z <= high.z; ++z)
        if (cell_[(static_cast<std::size_t>(x) * size_.y + y) * size_.z + z]) return true;
  return false;
}

}  // namespace isoskin
