#include "core/field/grid_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/four.h"

namespace isoskin {
namespace {

constexpr int kBrick = BrickGrid::kBrick;
constexpr int kTaps = BrickGrid::kTaps;
// The splines' weights sum to 1 only up to rounding.
constexpr double kRounding = 1e-14;

struct Weights {  // of the taps from `first` on (relative to the cell), and their derivatives by the index coordinate
  std::array<double, 4> value{}, slope{}, bend{};
};

Weights linear_weights(double t) {
  return {{1.0 - t, t}, {-1.0, 1.0}, {}};
}

Weights cubic_weights(double t) {
  const double s = 1.0 - t;
  return {{s * s * s / 6.0, 2.0 / 3.0 - t * t * (1.0 - 0.5 * t), 2.0 / 3.0 - s * s * (1.0 - 0.5 * s), t * t * t / 6.0},
          {-0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t},
          {s, 3.0 * t - 2.0, 3.0 * s - 2.0, t}};
}

struct Cell {                   // where a point lies
  const float* taps = nullptr;  // first tap of its support; null in a constant block
  double constant = 0.0;
  DVec3 t{0.0};
};

DVec3 to_index(const BrickGrid& grid, const DVec3& p) {
  return (p - grid.origin) / grid.h;
}

int support(const BrickGrid& grid) {
  return grid.interpolation == Interpolation::cubic ? 4 : 2;
}
// The first tap of a cell's support, in brick-local taps, is the cell's number plus this.
int lead(const BrickGrid& grid) {
  return grid.interpolation == Interpolation::cubic ? 0 : 1;
}

std::size_t entry_of(const BrickGrid& grid, const IVec3& at) {
  return (static_cast<std::size_t>(at.x) * grid.table_size.y + at.y) * grid.table_size.z + at.z;
}

Cell locate(const BrickGrid& grid, const DVec3& p) {
  const DVec3 q = to_index(grid, p) - DVec3(grid.table_low * kBrick);
  const DVec3 end(grid.table_size * kBrick);
  if (!(q.x >= 0.0 && q.y >= 0.0 && q.z >= 0.0 && q.x < end.x && q.y < end.y && q.z < end.z)) {
    return {nullptr, grid.outside, {}};
  }
  const IVec3 cell(q);
  const std::int32_t entry = grid.table[entry_of(grid, cell / kBrick)];
  if (entry < 0) return {nullptr, grid.constant[-1 - entry], {}};
  const IVec3 tap = cell % kBrick + lead(grid);
  return {grid.tap.data() + std::size_t(entry) * BrickGrid::kTapValues + (tap.x * kTaps + tap.y) * kTaps + tap.z, 0.0,
          q - DVec3(cell)};
}

std::array<Weights, 3> weights_at(const BrickGrid& grid, const DVec3& t) {
  const auto weights = grid.interpolation == Interpolation::cubic ? cubic_weights : linear_weights;
  return {weights(t.x), weights(t.y), weights(t.z)};
}

/// Points in a row along an axis that lie in one block of the table, or beyond it.
struct Run {
  struct Point {
    int tap;  // the first of its support
    std::array<double, 4> weight;
  };
  int first = 0;   // point
  int block = -1;  // of the table; -1: beyond
  std::vector<Point> point;
};

std::vector<Run> runs_along(const BrickGrid& grid, int axis, const DVec3& origin, double spacing, int count) {
  const auto weights = grid.interpolation == Interpolation::cubic ? cubic_weights : linear_weights;
  std::vector<Run> runs;
  for (int i = 0; i < count; ++i) {
    const double q = (origin[axis] + spacing * double(i) - grid.origin[axis]) / grid.h - grid.table_low[axis] * kBrick;
    const bool within = q >= 0.0 && q < grid.table_size[axis] * kBrick;
    const int cell = within ? int(q) : 0, block = within ? cell / kBrick : -1;
    if (runs.empty() || runs.back().block != block) runs.push_back({i, block, {}});
    runs.back().point.push_back({cell % kBrick + lead(grid), weights(q - cell).value});
  }
  return runs;
}

/// Sums as sample() does, but for sums that points share.
void values_within(const BrickGrid& grid, const Run& x, const Run& y, const Run& z, const IVec3& count,
                   std::span<double> out) {
  const auto slot = [&](std::size_t i, std::size_t j, std::size_t k) -> double& {
    return out[((x.first + i) * count.y + y.first + j) * count.z + z.first + k];
  };
  const bool beyond = x.block < 0 || y.block < 0 || z.block < 0;
  const std::int32_t entry = beyond ? -1 : grid.table[entry_of(grid, {x.block, y.block, z.block})];
  if (entry < 0) {
    for (std::size_t i = 0; i < x.point.size(); ++i)
      for (std::size_t j = 0; j < y.point.size(); ++j)
        for (std::size_t k = 0; k < z.point.size(); ++k)
          slot(i, j, k) = beyond ? grid.outside : grid.constant[-1 - entry];
    return;
  }
  const float* const taps = grid.tap.data() + std::size_t(entry) * BrickGrid::kTapValues;
  const int n = support(grid);
  const int x_end = x.point.back().tap + n, y_end = y.point.back().tap + n;
  std::array<std::array<double, kTaps>, kTaps> line;
  std::array<double, kTaps> plane;
  for (std::size_t k = 0; k < z.point.size(); ++k) {
    const auto& [tap_z, weight_z] = z.point[k];
    for (int a = x.point.front().tap; a < x_end; ++a)
      for (int b = y.point.front().tap; b < y_end; ++b) {
        const float* const row = taps + (a * kTaps + b) * kTaps + tap_z;
        line[a][b] = 0.0;
        for (int c = 0; c < n; ++c) line[a][b] += weight_z[c] * row[c];
      }
    for (std::size_t j = 0; j < y.point.size(); ++j) {
      const auto& [tap_y, weight_y] = y.point[j];
      for (int a = x.point.front().tap; a < x_end; ++a) {
        plane[a] = 0.0;
        for (int b = 0; b < n; ++b) plane[a] += weight_y[b] * line[a][tap_y + b];
      }
      for (std::size_t i = 0; i < x.point.size(); ++i) {
        const auto& [tap_x, weight_x] = x.point[i];
        double value = 0.0;
        for (int a = 0; a < n; ++a) value += weight_x[a] * plane[tap_x + a];
        slot(i, j, k) = value;
      }
    }
  }
}

struct FloatRange {
  float low = std::numeric_limits<float>::infinity(), high = -std::numeric_limits<float>::infinity();
  void add(const FloatRange& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
  }
};

// The taps that `brick`'s cells low..high (local, inclusive) see.
FloatRange tap_range(const BrickGrid& grid, std::size_t brick, const IVec3& low, const IVec3& high) {
  const IVec3 first = low + lead(grid), last = high + lead(grid) + support(grid) - 1;
  const float* taps = grid.tap.data() + brick * BrickGrid::kTapValues;
  const auto tap = [&](int x, int y, int z) { return taps + (x * kTaps + y) * kTaps + z; };
  if (first == IVec3(0) && last == IVec3(kTaps - 1)) {
    Extremes extremes(load(taps));
    extremes.add(taps, BrickGrid::kTapValues);
    return {extremes.low(), extremes.high()};
  }
  if (last.z - first.z >= 3) {
    Extremes extremes(load(tap(first.x, first.y, first.z)));
    for (int x = first.x; x <= last.x; ++x)
      for (int y = first.y; y <= last.y; ++y) extremes.add(tap(x, y, first.z), last.z - first.z + 1);
    return {extremes.low(), extremes.high()};
  }
  FloatRange range;
  for (int x = first.x; x <= last.x; ++x)
    for (int y = first.y; y <= last.y; ++y) {
      const auto [least, most] = std::minmax_element(tap(x, y, first.z), tap(x, y, last.z) + 1);
      range.add({*least, *most});
    }
  return range;
}

// Bernstein coefficients of four taps' segment, in place.
void to_bernstein(float* c, int stride) {
  const float c0 = c[0], c1 = c[stride], c2 = c[2 * stride], c3 = c[3 * stride];
  c[0] = (c0 + 4.0f * c1 + c2) / 6.0f;
  c[stride] = (2.0f * c1 + c2) / 3.0f;
  c[2 * stride] = (c1 + 2.0f * c2) / 3.0f;
  c[3 * stride] = (c1 + 4.0f * c2 + c3) / 6.0f;
}

// Bounds of F in one cell, by its Bernstein form where it is cubic: much closer than the hull of the taps.
FloatRange cell_range(const BrickGrid& grid, std::size_t brick, const IVec3& cell) {
  if (grid.interpolation == Interpolation::linear) return tap_range(grid, brick, cell, cell);
  const float* taps = grid.tap.data() + brick * BrickGrid::kTapValues;
  std::array<float, 64> c;
  for (int row = 0; row < 16; ++row) {
    std::copy_n(taps + ((cell.x + row / 4) * kTaps + cell.y + row % 4) * kTaps + cell.z, 4, c.data() + 4 * row);
  }
  for (int line = 0; line < 16; ++line) to_bernstein(c.data() + 4 * line, 1);
  for (int line = 0; line < 16; ++line) to_bernstein(c.data() + 16 * (line / 4) + line % 4, 4);
  for (int line = 0; line < 16; ++line) to_bernstein(c.data() + line, 16);
  const auto [low, high] = std::minmax_element(c.begin(), c.end());
  const float slack = 1e-6f * std::max(std::abs(*low), std::abs(*high));  // float rounding of the conversion
  return {*low - slack, *high + slack};
}

bool crosses(const FloatRange& range) {
  return range.low <= 0.0f && range.high >= 0.0f;
}

}  // namespace

// Bounds of F in each block of the table, then in blocks of 2^3 of those, and so on up to one.
struct GridField::RangeTree {
  struct Level {
    IVec3 size{0};
    std::vector<FloatRange> range;
    FloatRange& at(const IVec3& i) { return range[(std::size_t(i.x) * size.y + i.y) * size.z + i.z]; }
    const FloatRange& at(const IVec3& i) const { return const_cast<Level*>(this)->at(i); }
  };
  std::vector<Level> level;
};

namespace {

// Cells low..high, inclusive, from the table's first voxel on; clamped to the table when it reaches beyond.
struct CellBox {
  IVec3 low{0}, high{-1};
  bool beyond = false;
};

CellBox cells_of(const BrickGrid& grid, const Box& box) {
  const DVec3 base(grid.table_low * kBrick), end(grid.table_size * kBrick - 1);
  const DVec3 low = glm::floor(to_index(grid, box.low) - base), high = glm::floor(to_index(grid, box.high) - base);
  CellBox cells;
  for (int i = 0; i < 3; ++i) {
    cells.beyond = cells.beyond || !(low[i] >= 0.0) || !(high[i] <= end[i]);
    cells.low[i] = static_cast<int>(std::clamp(low[i], 0.0, end[i] + 1.0));
    cells.high[i] = static_cast<int>(std::clamp(high[i], -1.0, end[i]));
  }
  return cells;
}

}  // namespace

GridField::GridField(std::shared_ptr<const BrickGrid> grid) : grid_(std::move(grid)) {
  const BrickGrid& g = *grid_;
  auto tree = std::make_shared<RangeTree>();
  tree->level.push_back({g.table_size, std::vector<FloatRange>(g.table.size())});
  std::vector<FloatRange>& blocks = tree->level[0].range;
  tbb::parallel_for(std::size_t(0), g.table.size(), [&](std::size_t entry) {
    const std::int32_t brick = g.table[entry];
    const float constant = brick < 0 ? g.constant[-1 - brick] : 0.0f;
    blocks[entry] = brick < 0 ? FloatRange{constant, constant} : tap_range(g, brick, IVec3(0), IVec3(kBrick - 1));
  });
  while (tree->level.back().range.size() > 1) {
    const RangeTree::Level& fine = tree->level.back();
    RangeTree::Level coarse{(fine.size + 1) / 2, {}};
    coarse.range.resize(std::size_t(coarse.size.x) * coarse.size.y * coarse.size.z);
    for (int x = 0; x < fine.size.x; ++x) {
      for (int y = 0; y < fine.size.y; ++y) {
        for (int z = 0; z < fine.size.z; ++z) coarse.at(IVec3(x, y, z) / 2).add(fine.at(IVec3(x, y, z)));
      }
    }
    tree->level.push_back(std::move(coarse));
  }
  tree_ = std::move(tree);

  for (std::size_t brick = 0; brick < g.brick_coordinate.size(); ++brick) {
    const IVec3 block = g.brick_coordinate[brick];
    if (crosses(tree_->level[0].at(block - g.table_low))) add_to_bounds(brick);
  }
}

// Widens bounds_ by those cells of a brick in which F may be zero.
void GridField::add_to_bounds(std::size_t brick) {
  const DVec3 corner(grid_->brick_coordinate[brick] * kBrick);
  const auto world = [&](const IVec3& cell) { return grid_->origin + grid_->h * (corner + DVec3(cell)); };
  const auto add_cells = [&](const IVec3& low, const IVec3& high) {
    if (!crosses(tap_range(*grid_, brick, low, high))) return;
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y)
        for (int z = low.z; z <= high.z; ++z) {
          const IVec3 at(x, y, z);
          if (crosses(tap_range(*grid_, brick, at, at)) && crosses(cell_range(*grid_, brick, at)))
            bounds_.add({world(at), world(at + 1)});
        }
  };
  // Layers of cells that stick out, from outside; what follows sticks out less.
  for (int axis = 0; axis < 3; ++axis) {
    const auto layer = [&](int i) {
      IVec3 low(0), high(kBrick - 1);
      low[axis] = high[axis] = i;
      add_cells(low, high);
    };
    for (int i = 0; i < kBrick && world(IVec3(i))[axis] < bounds_.low[axis]; ++i) layer(i);
    for (int i = kBrick - 1; i >= 0 && world(IVec3(i + 1))[axis] > bounds_.high[axis]; --i) layer(i);
  }
}

FieldSample GridField::sample(const DVec3& p) const {
  const Cell cell = locate(*grid_, p);
  if (!cell.taps) return {cell.constant, DVec3(0.0)};
  const auto [wx, wy, wz] = weights_at(*grid_, cell.t);
  const int n = support(*grid_);
  double value = 0.0;
  DVec3 slope(0.0);
  for (int x = 0; x < n; ++x) {
    double plane = 0.0, plane_y = 0.0, plane_z = 0.0;
    for (int y = 0; y < n; ++y) {
      const float* row = cell.taps + (x * kTaps + y) * kTaps;
      double line = 0.0, line_z = 0.0;
      for (int z = 0; z < n; ++z) {
        line += wz.value[z] * row[z];
        line_z += wz.slope[z] * row[z];
      }
      plane += wy.value[y] * line;
      plane_y += wy.slope[y] * line;
      plane_z += wy.value[y] * line_z;
    }
    value += wx.value[x] * plane;
    slope += DVec3(wx.slope[x] * plane, wx.value[x] * plane_y, wx.value[x] * plane_z);
  }
  return {value, slope / grid_->h};
}

double GridField::value(const DVec3& p) const {
  const Cell cell = locate(*grid_, p);
  if (!cell.taps) return cell.constant;
  const auto [wx, wy, wz] = weights_at(*grid_, cell.t);
  const int n = support(*grid_);
  double value = 0.0;
  for (int x = 0; x < n; ++x) {  // in the order of sample(), so both give the same bits
    double plane = 0.0;
    for (int y = 0; y < n; ++y) {
      const float* row = cell.taps + (x * kTaps + y) * kTaps;
      double line = 0.0;
      for (int z = 0; z < n; ++z) line += wz.value[z] * row[z];
      plane += wy.value[y] * line;
    }
    value += wx.value[x] * plane;
  }
  return value;
}

void GridField::values(const DVec3& origin, double spacing, const IVec3& count, std::span<double> out) const {
  const std::array<std::vector<Run>, 3> runs{runs_along(*grid_, 0, origin, spacing, count.x),
                                             runs_along(*grid_, 1, origin, spacing, count.y),
                                             runs_along(*grid_, 2, origin, spacing, count.z)};
  for (const Run& x : runs[0])
    for (const Run& y : runs[1])
      for (const Run& z : runs[2]) values_within(*grid_, x, y, z, count, out);
}

DMat3 GridField::hessian(const DVec3& p) const {
  const Cell cell = locate(*grid_, p);
  if (!cell.taps) return DMat3(0.0);
  const auto [wx, wy, wz] = weights_at(*grid_, cell.t);
  const int n = support(*grid_);
  DMat3 h(0.0);
  for (int x = 0; x < n; ++x) {
    for (int y = 0; y < n; ++y) {
      for (int z = 0; z < n; ++z) {
        const double tap = cell.taps[(x * kTaps + y) * kTaps + z];
        h[0][0] += tap * wx.bend[x] * wy.value[y] * wz.value[z];
        h[1][1] += tap * wx.value[x] * wy.bend[y] * wz.value[z];
        h[2][2] += tap * wx.value[x] * wy.value[y] * wz.bend[z];
        h[0][1] += tap * wx.slope[x] * wy.slope[y] * wz.value[z];
        h[0][2] += tap * wx.slope[x] * wy.value[y] * wz.slope[z];
        h[1][2] += tap * wx.value[x] * wy.slope[y] * wz.slope[z];
      }
    }
  }
  h[1][0] = h[0][1];
  h[2][0] = h[0][2];
  h[2][1] = h[1][2];
  return h / (grid_->h * grid_->h);
}

Interval GridField::range(const Box& box) const {
  if (box.empty()) return {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  const CellBox cells = cells_of(*grid_, box);
  FloatRange sum;
  if (cells.beyond) sum.add({grid_->outside, grid_->outside});
  // From the top of the tree down: what lies within the bounds so far, or wholly in the box, is not opened.
  const auto visit = [&](const auto& self, std::size_t level, const IVec3& node) -> void {
    const int width = kBrick << level;
    const IVec3 first = node * width, last = first + (width - 1);
    if (glm::any(glm::greaterThan(first, cells.high)) || glm::any(glm::lessThan(last, cells.low))) return;
    const FloatRange& own = tree_->level[level].at(node);
    if (own.low >= sum.low && own.high <= sum.high) return;
    const bool whole =
        glm::all(glm::greaterThanEqual(first, cells.low)) && glm::all(glm::lessThanEqual(last, cells.high));
    if (whole) return sum.add(own);
    if (level == 0) {
      const std::int32_t entry = grid_->table[entry_of(*grid_, node)];
      if (entry < 0) return sum.add(own);
      return sum.add(
          tap_range(*grid_, entry, glm::max(cells.low - first, 0), glm::min(cells.high - first, kBrick - 1)));
    }
    for (int child = 0; child < 8; ++child) {
      const IVec3 at = 2 * node + IVec3(child & 1, child >> 1 & 1, child >> 2);
      if (glm::all(glm::lessThan(at, tree_->level[level - 1].size))) self(self, level - 1, at);
    }
  };
  if (glm::all(glm::lessThanEqual(cells.low, cells.high))) {
    // A box of a few cells meets at most 8 blocks: start there, not at the root.
    const IVec3 low = cells.low / kBrick, high = cells.high / kBrick;
    if (glm::all(glm::lessThanEqual(high - low, IVec3(1)))) {
      for (int x = low.x; x <= high.x; ++x) {
        for (int y = low.y; y <= high.y; ++y) {
          for (int z = low.z; z <= high.z; ++z) visit(visit, 0, IVec3(x, y, z));
        }
      }
    } else {
      visit(visit, tree_->level.size() - 1, IVec3(0));
    }
  }
  const double slack = kRounding * std::max(std::abs(double(sum.low)), std::abs(double(sum.high)));
  return {sum.low - slack, sum.high + slack};
}

}  // namespace isoskin
