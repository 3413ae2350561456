#include "render/surface_boxes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "core/field/blend_graph.h"
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

// Skeletons of fewer and fewer elements as boxes shrink, one for each set of elements that occurs.
class SkeletonParts {
public:
  explicit SkeletonParts(const SkeletonField& field) : field_(field) {
    std::vector<Index> all;
    for (std::size_t e = 0; e < field.elements().size(); ++e) {
      single_.emplace_back(std::vector{field.elements()[e]}, 0.0);
      all.push_back(static_cast<Index>(e));
    }
    elements_[&field] = std::move(all);
  }

  /// Whether some elements reach so far only that leaving them out is exact.
  bool worthwhile() const { return std::any_of(field_.elements().begin(), field_.elements().end(), is_compact); }

  void narrow(std::vector<SurfaceBox>& boxes) {
    std::vector<std::vector<Index>> near(boxes.size());
    tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t b) {
      for (const Index e : elements_.at(boxes[b].field)) {
        const Interval f = single_[e].range(boxes[b].box);
        if (f.low != 0.0 || f.high != 0.0) near[b].push_back(e);
      }
    });
    for (std::size_t b = 0; b < boxes.size(); ++b) boxes[b].field = part(near[b]);
  }

  std::vector<std::shared_ptr<const Field>> take() { return std::move(owned_); }

private:
  const Field* part(const std::vector<Index>& elements) {
    const Field*& made = made_[elements];
    if (!made) {
      std::vector<SkeletonElement> kept;
      for (const Index e : elements) kept.push_back(field_.elements()[e]);
      made = owned_.emplace_back(std::make_shared<SkeletonField>(std::move(kept), field_.iso())).get();
      elements_[made] = elements;
    }
    return made;
  }

  const SkeletonField& field_;
  std::vector<SkeletonField> single_;
  std::vector<std::shared_ptr<const Field>> owned_;
  std::map<std::vector<Index>, const Field*> made_;
  std::unordered_map<const Field*, std::vector<Index>> elements_;  // looked up only, never walked
};

// Level by level, so that the order does not depend on threads; `narrow` may replace the fields of a level's boxes.
template <class Narrow>
std::vector<SurfaceBox> bisect(const Field& field, const SurfaceBoxOptions& options, const Narrow& narrow) {
  const Box bounds = field.bounds();
  if (bounds.empty()) return {};
  const double size = options.size > 0.0         ? options.size
                      : field.resolution() > 0.0 ? 2.0 * field.resolution()
                                                 : kDefaultShare * bounds.diagonal();
  // A flat box would be bisected for ever on its thin axis: start from a cube.
  const double half = 0.5 * std::max({bounds.size().x, bounds.size().y, bounds.size().z, size}) * (1.0 + 1e-9);
  std::vector<SurfaceBox> level{{{bounds.center() - half, bounds.center() + half}, &field}};
  for (double side = 2.0 * half; side > size && level.size() * 4 <= options.max_boxes; side *= 0.5) {
    std::vector<std::uint8_t> keep(8 * level.size());
    tbb::parallel_for(std::size_t{0}, keep.size(), [&](std::size_t i) {
      keep[i] = may_change_sign(level[i / 8].field->range(octant(level[i / 8].box, static_cast<int>(i % 8))));
    });
    std::vector<SurfaceBox> finer;
    for (std::size_t i = 0; i < keep.size(); ++i) {
      if (keep[i]) finer.push_back({octant(level[i / 8].box, static_cast<int>(i % 8)), level[i / 8].field});
    }
    narrow(finer);
    level = std::move(finer);
  }
  return level;
}

SurfaceBoxes skeleton_boxes(const SkeletonField& field, const SurfaceBoxOptions& options) {
  SkeletonParts parts(field);
  const bool worthwhile = parts.worthwhile();
  SurfaceBoxes out;
  out.boxes = bisect(field, options, [&](std::vector<SurfaceBox>& boxes) {
    if (worthwhile) parts.narrow(boxes);
  });
  out.owned = parts.take();
  return out;
}

std::vector<SkeletonElement> felt(const SkeletonField& field, const Box& box) {
  std::vector<SkeletonElement> elements;
  for (const SkeletonElement& e : field.elements()) {
    const Interval f = SkeletonField({e}, 0.0).range(box);
    if (f.low != 0.0 || f.high != 0.0) elements.push_back(e);
  }
  return elements;
}

/// F on the box, of the elements felt there.
std::shared_ptr<const Field> narrowed(const Field& field, const Box& box) {
  if (const auto* skeleton = dynamic_cast<const SkeletonField*>(&field))
    return std::make_shared<SkeletonField>(felt(*skeleton, box), skeleton->iso());
  const auto& blend = dynamic_cast<const BlendGraphField&>(field);
  std::vector<SkeletonElement> elements;
  std::vector<std::vector<Index>> groups;
  bool silent = false;  // groups of which none is felt are alike
  for (const SkeletonField& group : blend.groups()) {
    const std::vector<SkeletonElement> members = felt(group, box);
    if (members.empty() && std::exchange(silent, true)) continue;
    groups.emplace_back(members.size());
    std::iota(groups.back().begin(), groups.back().end(), Index(elements.size()));
    elements.insert(elements.end(), members.begin(), members.end());
  }
  return blended(std::move(elements), blend.groups().front().iso(), groups);
}

}  // namespace

SurfaceBoxes seed_boxes(const Field& field, const Seeds& seeds) {
  SurfaceBoxes out;
  for (const Box& box : seeds.boxes()) {
    if (box.empty()) continue;
    out.owned.push_back(narrowed(field, box));
    out.boxes.push_back({box, out.owned.back().get()});
  }
  out.side = kDefaultShare * field.bounds().diagonal();
  return out;
}

std::size_t element_count(const Field& field) {
  if (const auto* skeleton = dynamic_cast<const SkeletonField*>(&field)) return skeleton->elements().size();
  std::size_t count = 0;
  if (const auto* blend = dynamic_cast<const BlendGraphField*>(&field))
    for (const SkeletonField& group : blend->groups()) count += group.elements().size();
  return count;
}

SurfaceBoxes main_box(const Field& field) {
  SurfaceBoxes out;
  const Box bounds = field.bounds();
  if (!bounds.empty()) out.boxes.push_back({bounds, &field});
  out.side = kDefaultShare * bounds.diagonal();
  return out;
}

SurfaceBoxes surface_boxes(const Field& field, const SurfaceBoxOptions& options) {
  if (const auto* grid = dynamic_cast<const GridField*>(&field)) return grid_boxes(*grid);
  if (const auto* skeleton = dynamic_cast<const SkeletonField*>(&field)) return skeleton_boxes(*skeleton, options);
  SurfaceBoxes out;
  out.boxes = bisect(field, options, [](std::vector<SurfaceBox>&) {});
  return out;
}

Box bounding_box(const SurfaceBoxes& boxes) {
  Box all;
  for (const SurfaceBox& b : boxes.boxes) all.add(b.box);
  return all;
}

}  // namespace isoskin
