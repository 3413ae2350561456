#include "render/surface_boxes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"

namespace isoskin {
namespace {

constexpr double kDefaultShare = 1.0 / 128.0;  // side of a box, of the bounds' diagonal

// F = 0 counts as outside, here and in the root search.
bool may_change_sign(const Interval& f) {
  return f.high > 0.0 && f.low <= 0.0;
}

// Whether the coefficients that shape cell (x, y, z) of a brick differ in sign.
bool cell_changes_sign(const BrickGrid& grid, const float* taps, int x, int y, int z) {
  // Taps start one voxel before the brick; a cubic cell is shaped by taps -1..2 about it, a linear one by 0..1.
  const int first = grid.interpolation == Interpolation::cubic ? 0 : 1;
  const int count = grid.interpolation == Interpolation::cubic ? 4 : 2;
  bool inside = false, outside = false;
  for (int i = x + first; i < x + first + count; ++i) {
    for (int j = y + first; j < y + first + count; ++j) {
      const float* row = taps + (i * BrickGrid::kTaps + j) * BrickGrid::kTaps + z + first;
      for (int k = 0; k < count; ++k) (row[k] > 0.0f ? inside : outside) = true;
    }
  }
  return inside && outside;
}

std::vector<Box> brick_cells(const BrickGrid& grid, std::size_t brick) {
  std::vector<Box> cells;
  const float* taps = grid.tap.data() + brick * BrickGrid::kTapValues;
  const IVec3 first = grid.brick_coordinate[brick] * BrickGrid::kBrick;
  for (int x = 0; x < BrickGrid::kBrick; ++x) {
    for (int y = 0; y < BrickGrid::kBrick; ++y) {
      for (int z = 0; z < BrickGrid::kBrick; ++z) {
        if (!cell_changes_sign(grid, taps, x, y, z)) continue;
        const DVec3 low = grid.origin + grid.h * DVec3(first + IVec3(x, y, z));
        cells.push_back({low, low + grid.h});
      }
    }
  }
  return cells;
}

SurfaceBoxes grid_boxes(const GridField& field) {
  const BrickGrid& grid = *field.grid();
  std::vector<std::vector<Box>> cells(grid.brick_coordinate.size());
  tbb::parallel_for(std::size_t{0}, cells.size(), [&](std::size_t b) { cells[b] = brick_cells(grid, b); });
  SurfaceBoxes out;
  out.degree = grid.interpolation == Interpolation::cubic ? 9 : 3;
  for (const auto& of_brick : cells) {
    for (const Box& cell : of_brick) out.boxes.push_back({cell, &field});
  }
  return out;
}

Box octant(const Box& box, int which) {
  const DVec3 c = box.center();
  Box child = box;
  for (int axis = 0; axis < 3; ++axis) (which >> axis & 1 ? child.low : child.high)[axis] = c[axis];
  return child;
}

// Level by level, so that the order does not depend on threads.
std::vector<Box> bisect(const Field& field, const SurfaceBoxOptions& options) {
  const Box bounds = field.bounds();
  if (bounds.empty()) return {};
  const double diagonal = bounds.diagonal();
  const double size = options.size > 0.0         ? options.size
                      : field.resolution() > 0.0 ? 2.0 * field.resolution()
                                                 : kDefaultShare * diagonal;
  // A flat box would be bisected for ever on its thin axis: start from a cube.
  const double half = 0.5 * std::max({bounds.size().x, bounds.size().y, bounds.size().z, size}) * (1.0 + 1e-9);
  std::vector<Box> level{{bounds.center() - half, bounds.center() + half}};
  for (double side = 2.0 * half; side > size && level.size() * 4 <= options.max_boxes; side *= 0.5) {
    std::vector<std::uint8_t> keep(8 * level.size());
    tbb::parallel_for(std::size_t{0}, keep.size(), [&](std::size_t i) {
      keep[i] = may_change_sign(field.range(octant(level[i / 8], static_cast<int>(i % 8))));
    });
    std::vector<Box> finer;
    for (std::size_t i = 0; i < keep.size(); ++i) {
      if (keep[i]) finer.push_back(octant(level[i / 8], static_cast<int>(i % 8)));
    }
    level = std::move(finer);
  }
  return level;
}

// The elements that are not constantly zero in the box.
std::vector<Index> elements_in(const std::vector<SkeletonField>& single, const Box& box) {
  std::vector<Index> near;
  for (std::size_t e = 0; e < single.size(); ++e) {
    const Interval f = single[e].range(box);
    if (f.low != 0.0 || f.high != 0.0) near.push_back(static_cast<Index>(e));
  }
  return near;
}

void thin_out(const SkeletonField& field, SurfaceBoxes& out) {
  std::vector<SkeletonField> single;
  for (const SkeletonElement& e : field.elements()) single.emplace_back(std::vector{e}, 0.0);
  std::vector<std::vector<Index>> near(out.boxes.size());
  tbb::parallel_for(std::size_t{0}, near.size(),
                    [&](std::size_t b) { near[b] = elements_in(single, out.boxes[b].box); });
  std::map<std::vector<Index>, const Field*> made;
  for (std::size_t b = 0; b < near.size(); ++b) {
    const Field*& part = made[near[b]];
    if (!part) {
      std::vector<SkeletonElement> elements;
      for (const Index e : near[b]) elements.push_back(field.elements()[e]);
      out.owned.push_back(std::make_unique<SkeletonField>(std::move(elements), field.iso()));
      part = out.owned.back().get();
    }
    out.boxes[b].field = part;
  }
}

}  // namespace

SurfaceBoxes surface_boxes(const Field& field, const SurfaceBoxOptions& options) {
  if (const auto* grid = dynamic_cast<const GridField*>(&field)) return grid_boxes(*grid);
  SurfaceBoxes out;
  for (const Box& box : bisect(field, options)) out.boxes.push_back({box, &field});
  if (const auto* skeleton = dynamic_cast<const SkeletonField*>(&field)) thin_out(*skeleton, out);
  return out;
}

Box bounding_box(const SurfaceBoxes& boxes) {
  Box all;
  for (const SurfaceBox& b : boxes.boxes) all.add(b.box);
  return all;
}

}  // namespace isoskin
