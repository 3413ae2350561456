#include "core/sampling/brick_lattice.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <string>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "core/parallel.h"
#include "core/sampling/ambiguous_faces.h"
#include "core/sampling/brick_signs.h"
#include "core/sampling/grid_lattice.h"
#include "core/sampling/hidden_crossings.h"
#include "core/sampling/sampling_steps.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kValues = BrickLattice::kValues;
constexpr int kLargestCoordinate = BrickLattice::kFarthestCorner / kCells - 1;  // bricks from the origin
constexpr std::size_t kBatch = 4096;                                            // bricks a call of Backend::evaluate
constexpr int kMostRounds = 16;  // of added bricks, before the surface is said to be open

/// Corner numbers of brick `b` that it shares with its neighbour at `offset`: low..high on each axis.
struct Shared {
  IVec3 low, high;
  explicit Shared(const IVec3& offset) {
    for (int a = 0; a < 3; ++a) {
      low[a] = offset[a] > 0 ? kCells : 0;
      high[a] = offset[a] < 0 ? 0 : kCells;
    }
  }
};

/// Evaluates all corners of the given bricks through the backend.
void evaluate_by(BrickLattice& lattice, const std::vector<Index>& bricks, Backend& backend) {
  std::vector<Vec3> points;
  std::vector<float> values;
  for (std::size_t begin = 0; begin < bricks.size(); begin += kBatch) {
    const std::size_t count = std::min(kBatch, bricks.size() - begin);
    points.resize(count * kValues);
    values.resize(count * kValues);
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
      const IVec3 low = lattice.coordinate[bricks[begin + k]] * kCells;
      for (int i = 0; i < kValues; ++i) {
        const IVec3 corner(i / (kCorners * kCorners), i / kCorners % kCorners, i % kCorners);
        points[k * kValues + i] = Vec3(lattice.point(low + corner));
      }
    });
    backend.evaluate(points, values, {});
    for (std::size_t k = 0; k < count; ++k)
      std::copy_n(&values[k * kValues], kValues, &lattice.value[std::size_t{bricks[begin + k]} * kValues]);
  }
}

/// Adds bricks (sorted, none present yet) and returns their indices.
std::vector<Index> insert(BrickLattice& lattice, const std::vector<IVec3>& more) {
  BrickLattice grown;
  grown.origin = lattice.origin;
  grown.spacing = lattice.spacing;
  const std::size_t count = lattice.brick_count() + more.size();
  grown.coordinate.reserve(count);
  grown.value.resize(count * kValues);
  std::vector<Index> added;
  for (std::size_t i = 0, j = 0; i + j < count;) {
    const bool old =
        j == more.size() || (i < lattice.brick_count() && sampling::before(lattice.coordinate[i], more[j]));
    if (old) {
      std::copy_n(&lattice.value[i * kValues], kValues, &grown.value[(i + j) * kValues]);
      grown.coordinate.push_back(lattice.coordinate[i++]);
    } else {
      added.push_back(static_cast<Index>(i + j));
      grown.coordinate.push_back(more[j++]);
    }
  }
  grown.build_index();
  lattice = std::move(grown);
  return added;
}

/// n when the lattice's cells are an n-th of the voxels of `field`, else 0.
int parts_of(const Field& field, double spacing) {
  const auto* grid = dynamic_cast<const GridField*>(&field);
  return grid ? grid_parts(*grid->grid(), spacing) : 0;
}

std::vector<Index> all_bricks(const BrickLattice& lattice) {
  std::vector<Index> all(lattice.brick_count());
  std::iota(all.begin(), all.end(), Index{0});
  return all;
}

}  // namespace

namespace sampling {

bool before(const IVec3& a, const IVec3& b) {
  if (a.x != b.x) return a.x < b.x;
  if (a.y != b.y) return a.y < b.y;
  return a.z < b.z;
}

void check_count(std::size_t bricks, std::size_t most, double spacing) {
  if (bricks > most)
    throw InputError("lattice spacing " + std::to_string(spacing) + " needs more than " + std::to_string(most) +
                     " bricks of 8^3 cells; expected a coarser one");
}

std::vector<IVec3> missing_neighbours(const BrickLattice& lattice, const std::vector<BrickSigns>& signs,
                                      const std::vector<Index>& bricks) {
  std::vector<std::vector<IVec3>> found(bricks.size());
  for_each_heavy(bricks.size(), [&](std::size_t k) {
    const Index b = bricks[k];
    if (!signs[b].mixed()) return;
    for (int i = 0; i < 27; ++i) {
      const IVec3 offset(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1);
      const int away = std::abs(offset.x) + std::abs(offset.y) + std::abs(offset.z);
      if (away == 0 || away == 3 || !signs[b].crosses(offset)) continue;  // neighbours at a corner share no edge
      const IVec3 c = lattice.coordinate[b] + offset;
      if (lattice.find(c) == kNone) found[k].push_back(c);
    }
  });
  std::vector<IVec3> all;
  for (const auto& f : found) all.insert(all.end(), f.begin(), f.end());
  std::sort(all.begin(), all.end(), before);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

void unify_shared_corners(BrickLattice& lattice, const std::vector<Index>& bricks, std::vector<BrickSigns>& signs) {
  for_each_heavy(bricks.size(), [&](std::size_t k) {
    const std::size_t b = bricks[k];
    float* value = &lattice.value[b * kValues];
    for (int i = 14; i < 27; ++i) {  // later bricks, the last one last
      const IVec3 offset(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1);
      const Index other = lattice.find(lattice.coordinate[b] + offset);
      if (other == kNone) continue;
      const float* theirs = &lattice.value[std::size_t{other} * kValues];
      const Shared s(offset);
      const int shift = kCells * BrickLattice::corner_index(offset);
      for (int x = s.low.x; x <= s.high.x; ++x)
        for (int y = s.low.y; y <= s.high.y; ++y)
          for (int z = s.low.z; z <= s.high.z; ++z) {
            const int at = BrickLattice::corner_index({x, y, z});
            value[at] = theirs[at - shift];
          }
    }
    signs[b] = BrickSigns(value);
  });
}

void evaluate(BrickLattice& lattice, const std::vector<Index>& bricks, const Field& field, Backend& backend) {
  if (const int parts = parts_of(field, lattice.spacing))
    evaluate_grid(*dynamic_cast<const GridField&>(field).grid(), parts, lattice, bricks);
  else
    evaluate_by(lattice, bricks, backend);
}

BrickRange bricks_in_bounds(const Field& field, const DVec3& origin, double spacing) {
  const Box bounds = field.bounds();
  if (bounds.empty()) return {};
  const double brick = spacing * kCells;
  const DVec3 low = glm::floor((bounds.low - origin - DVec3(spacing)) / brick);
  const DVec3 high = glm::floor((bounds.high - origin + DVec3(spacing)) / brick);
  for (int a = 0; a < 3; ++a)
    if (!(std::abs(low[a]) < kLargestCoordinate && std::abs(high[a]) < kLargestCoordinate))
      throw InputError("lattice spacing " + std::to_string(spacing) +
                       " is too fine for the field's bounds; expected at least " +
                       std::to_string(glm::length(bounds.size()) / kLargestCoordinate));
  return {IVec3(low), IVec3(high)};
}

Box box_of_samples(const BrickLattice& lattice, const BrickRange& range, const IVec3& brick, int bricks) {
  constexpr double kRounding = 1e-6;
  const double farthest =
      std::max(glm::length(lattice.point(kCells * range.first)), glm::length(lattice.point(kCells * (range.last + 1))));
  return Box{lattice.point(kCells * brick), lattice.point(kCells * (brick + bricks))}.grown(kRounding * farthest);
}

/// Cubes of bricks are halved level by level.
std::vector<IVec3> subdivide(const Field& field, const BrickLattice& lattice, const BrickRange& range,
                             std::size_t max_bricks, const ChangeMask* only) {
  const IVec3 first = range.first, count = range.last - first + 1;
  if (glm::any(glm::lessThan(count, IVec3(1)))) return {};
  int size = static_cast<int>(std::bit_ceil(static_cast<unsigned>(std::max({count.x, count.y, count.z}))));
  std::vector<IVec3> cubes{first};
  for (;; size /= 2) {
    std::vector<std::uint8_t> keep(cubes.size());
    tbb::parallel_for(std::size_t{0}, cubes.size(), [&](std::size_t i) {
      const IVec3 from = cubes[i] - first;
      if (from.x >= count.x || from.y >= count.y || from.z >= count.z) return;
      const Box box = box_of_samples(lattice, range, cubes[i], size);
      if (only && !only->overlaps(box)) return;
      const Interval values = field.range(box);
      keep[i] = values.low <= 0.0 && values.high >= 0.0;
    });
    std::size_t kept = 0;
    for (std::size_t i = 0; i < cubes.size(); ++i)
      if (keep[i]) cubes[kept++] = cubes[i];
    cubes.resize(kept);
    check_count(kept, max_bricks, lattice.spacing);
    if (size == 1) break;
    std::vector<IVec3> children;
    children.reserve(kept * 8);
    for (const IVec3& c : cubes)
      for (int i = 0; i < 8; ++i) children.push_back(c + size / 2 * IVec3(i >> 2, i >> 1 & 1, i & 1));
    cubes = std::move(children);
  }
  tbb::parallel_sort(cubes.begin(), cubes.end(), before);
  return cubes;
}

BrickLattice sample_anew(BrickLattice used, const Field& field, Backend& backend, double spacing,
                         std::size_t max_bricks) {
  if (!(spacing > 0.0) || !std::isfinite(spacing))
    throw InputError("lattice spacing " + std::to_string(spacing) + "; expected a positive length");
  const auto* grid = dynamic_cast<const GridField*>(&field);
  const int parts = parts_of(field, spacing);
  BrickLattice lattice;
  lattice.value = std::move(used.value);
  lattice.spacing = parts > 0 ? grid->grid()->h / parts : spacing;
  lattice.origin = grid ? grid->grid()->origin : DVec3(0.0);
  if (parts > 0) {
    lattice.coordinate = grid_candidates(*grid->grid(), parts);
  } else {
    const BrickRange range = bricks_in_bounds(field, lattice.origin, lattice.spacing);
    lattice.first_searched = range.first;
    lattice.last_searched = range.last;
    lattice.coordinate = subdivide(field, lattice, range, max_bricks);
  }
  check_count(lattice.brick_count(), max_bricks, spacing);
  for (const IVec3& c : lattice.coordinate)
    if (glm::any(glm::greaterThan(glm::abs(c), IVec3(kLargestCoordinate))))
      throw InputError("the grid lies too far from its origin; expected voxels within " +
                       std::to_string(BrickLattice::kFarthestCorner / std::max(parts, 1)));
  lattice.value.resize(lattice.brick_count() * kValues);
  lattice.build_index();

  std::vector<Index> fresh = all_bricks(lattice);
  std::vector<BrickSigns> signs;
  for (int round = 0;; ++round) {
    evaluate(lattice, fresh, field, backend);
    // Rounding may move a crossing just past the last brick, and unifying may move one anywhere near.
    if (parts > 0) {
      signs.resize(lattice.brick_count());
      unify_shared_corners(lattice, all_bricks(lattice), signs);
    } else {
      signs = brick_signs(lattice);
    }
    const std::vector<IVec3> more = missing_neighbours(lattice, signs, parts > 0 ? all_bricks(lattice) : fresh);
    if (more.empty()) break;
    check_count(lattice.brick_count() + more.size(), max_bricks, spacing);
    if (round == kMostRounds) throw InputError("the surface runs out of the field's bounds; expected a closed surface");
    fresh = insert(lattice, more);
    lattice.extended = true;
  }
  reveal_hidden_crossings(lattice, signs, field);
  resolve_ambiguous_faces(lattice, signs, field);
  resolve_tunnels(lattice, signs, field);
  return lattice;
}

}  // namespace sampling

BrickLattice sample_lattice(const Field& field, Backend& backend, double spacing, std::size_t max_bricks) {
  return sampling::sample_anew({}, field, backend, spacing, max_bricks);
}

}  // namespace isoskin
