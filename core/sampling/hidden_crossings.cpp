#include "core/sampling/hidden_crossings.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <tbb/parallel_for.h>

#include "core/parallel.h"
#include "core/sampling/ambiguous_faces.h"
#include "core/sampling/cell_shapes.h"
#include "core/vectorized.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kFine = 4;        // parts of a lattice edge where F is counted again
constexpr double kDip = 0.9;    // a middle expected below this share of the ends' mean is looked at
constexpr double kTiny = 1e-3;  // of its old magnitude: what a corner that changes sides keeps

using HiddenEdge = BrickLattice::HiddenEdge;

IVec3 unit(int axis) {
  IVec3 u(0);
  u[axis] = 1;
  return u;
}

DVec3 place(const BrickLattice& lattice, const DVec3& corner) {
  return lattice.origin + lattice.spacing * corner;
}

/// What a corner's value becomes when it changes sides; 0 is outside.
float changed(float value) {
  return value == 0.0f ? std::numeric_limits<float>::min() : -float(kTiny) * value;
}

/// Is the value `middle`, expected halfway along an edge with these values of one side at its ends, on the other side,
/// or near it? Without a branch, so that loops over it become vectors.
inline bool low_middle(float p, float q, float middle) {
  const float sum = p + q;
  return sum * (float(kDip) * 0.5f * sum - middle) > 0.0f;
}

/// Of the edge from `at` to at[step], where its line has no corner of the brick before or after it.
bool may_dip_at_end(const float* at, int step, bool has_after) {
  const float p = at[0], q = at[step];
  return low_middle(p, q,
                    has_after ? (3.0f * p + 6.0f * q - at[2 * step]) / 8.0f : (6.0f * p + 3.0f * q - at[-step]) / 8.0f);
}

/// One byte a corner of a brick, 0 or 1.
struct Flags {
  std::array<std::uint8_t, BrickLattice::kValues> flag;
  /// Those of a row along z as bits.
  unsigned row(int x, int y) const {
    const std::uint8_t* first = &flag[BrickLattice::corner_index({x, y, 0})];
    std::uint64_t eight = 0;
    for (int z = 0; z < kCells; ++z) eight |= std::uint64_t(first[z]) << 8 * z;  // one load
    constexpr std::uint64_t kGather = 0x0102040810204080;                        // byte z's lowest bit to bit 56 + z
    return unsigned(eight * kGather >> 56) | unsigned(first[kCells]) << kCells;
  }
};

/// Edges of a row along z that begin or end the lines of the brick they lie on.
unsigned ends_of_lines(int axis, int place) {
  if (axis == 2) return 1u | 1u << (kCells - 1);
  return place == 0 || place == kCells - 1 ? 0x1ffu : 0u;
}

/// For every edge value[i] to value[i + step] of a brick; means nothing at the ends of lines.
ISOSKIN_VECTORIZED void find_low_middles(const float* value, int step, Flags& flags) {
  for (int i = step; i < BrickLattice::kValues - 2 * step; ++i)
    flags.flag[i] = low_middle(value[i], value[i + step],
                               (9.0f * (value[i] + value[i + step]) - value[i - step] - value[i + 2 * step]) / 16.0f);
}

/// The edges of a brick that begin and end on one side and touch a cell that the surface crosses, as bits of rows along
/// z.
class EdgesBySurface {
public:
  explicit EdgesBySurface(const BrickSigns& signs) : signs_(signs) {
    for (int x = 0; x < kCells; ++x)
      for (int y = 0; y < kCells; ++y) any_ |= cells_[x + 1][y + 1] = std::uint16_t(signs_.surface_cells(x, y));
  }
  bool any() const { return any_ != 0; }

  /// Edges along `axis` from the points (x, y, z).
  unsigned row(int axis, int x, int y) const {
    const unsigned r = signs_.at(x, y);
    const auto cells = [&](int i, int j) { return unsigned(cells_[i + 1][j + 1]); };
    if (axis == 2) return (cells(x - 1, y - 1) | cells(x - 1, y) | cells(x, y - 1) | cells(x, y)) & ~(r ^ r >> 1);
    const unsigned near = axis == 0 ? cells(x, y - 1) | cells(x, y) : cells(x - 1, y) | cells(x, y);
    const unsigned s = axis == 0 ? signs_.at(x + 1, y) : signs_.at(x, y + 1);
    return (near | near << 1) & ~(r ^ s);
  }

private:
  const BrickSigns& signs_;
  std::array<std::array<std::uint16_t, kCorners + 1>, kCorners + 1> cells_{};  // with a rim of none
  unsigned any_ = 0;
};

/// Does F change sign between two corners of one sign? Looked for halfway and at the lowest point of the parabola.
bool dips(const BrickLattice& lattice, const Field& field, const HiddenEdge& edge, double p, double q) {
  const double sign = p > 0.0 ? 1.0 : -1.0;
  const auto value = [&](double t) {
    return sign * field.value(place(lattice, DVec3(edge.low) + t * DVec3(unit(edge.axis))));
  };
  const bool inside = p > 0.0;
  const auto other_side = [&](double v) { return inside ? v <= 0.0 : v < 0.0; };
  const double middle = value(0.5);
  if (other_side(middle)) return true;
  p *= sign;
  q *= sign;
  const double bend = 2.0 * (p - 2.0 * middle + q);
  if (bend <= 0.0) return false;
  const double lowest = (3.0 * p - 4.0 * middle + q) / (2.0 * bend);
  return lowest > 0.0 && lowest < 1.0 && other_side(value(lowest));
}

void find_hidden(const BrickLattice& lattice, const BrickSigns& signs, const Field& field, std::size_t brick,
                 std::vector<HiddenEdge>& out) {
  constexpr std::array<int, 3> stride{kCorners * kCorners, kCorners, 1};
  const float* value = &lattice.value[brick * BrickLattice::kValues];
  const EdgesBySurface edges(signs);
  if (!edges.any()) return;
  Flags low{};
  for (int axis = 0; axis < 3; ++axis) {
    find_low_middles(value, stride[axis], low);
    for (int x = 0; x < kCorners - (axis == 0); ++x)
      for (int y = 0; y < kCorners - (axis == 1); ++y) {
        unsigned bits = edges.row(axis, x, y);
        if (bits) bits &= low.row(x, y) | ends_of_lines(axis, axis == 0 ? x : y);
        for (; bits; bits &= bits - 1) {
          const IVec3 local(x, y, std::countr_zero(bits));
          const float* at = value + BrickLattice::corner_index(local);
          const bool at_end = local[axis] == 0 || local[axis] == kCells - 1;
          if (at_end && !may_dip_at_end(at, stride[axis], local[axis] == 0)) continue;
          const HiddenEdge edge{lattice.coordinate[brick] * kCells + local, axis, 0};
          if (dips(lattice, field, edge, at[0], at[stride[axis]])) out.push_back(edge);
        }
      }
  }
}

using CellValues = std::array<float, 8>;

/// Values at the corners of a box of cells.
struct Block {
  IVec3 cells;
  std::vector<float> value;

  explicit Block(const IVec3& size) : cells(size), value(std::size_t((size.x + 1) * (size.y + 1) * (size.z + 1))) {}
  float& at(const IVec3& p) { return value[std::size_t((p.x * (cells.y + 1) + p.y) * (cells.z + 1) + p.z)]; }
  float at(const IVec3& p) const { return const_cast<Block*>(this)->at(p); }
};

template <class Function>
void for_each_point(const IVec3& size, const Function& function) {
  for (int x = 0; x < size.x; ++x)
    for (int y = 0; y < size.y; ++y)
      for (int z = 0; z < size.z; ++z) function(IVec3(x, y, z));
}

/// Euler characteristic of the surface in the block, by patches - arcs + crossings; `patches` counts those of a cell
/// (a tunnel counts 0, its two loops being one annulus).
int euler(const Block& block, const auto& patches) {
  const IVec3 points = block.cells + 1;
  const std::array<int, 3> stride{points.y * points.z, points.z, 1};
  std::vector<std::uint8_t> inside(block.value.size());
  for (std::size_t i = 0; i < inside.size(); ++i) inside[i] = block.value[i] > 0.0f;
  int sum = 0;
  for_each_point(points, [&](const IVec3& p) {
    const int at = p.x * stride[0] + p.y * stride[1] + p.z;
    const std::uint8_t* s = &inside[std::size_t(at)];
    const std::array<bool, 3> more{p.x < block.cells.x, p.y < block.cells.y, p.z < block.cells.z};
    for (int a = 0; a < 3; ++a) {
      const int u = stride[(a + 1) % 3], w = stride[(a + 2) % 3];
      if (more[a]) sum += s[0] ^ s[stride[a]];
      if (more[(a + 1) % 3] && more[(a + 2) % 3])
        sum -= ((s[0] ^ s[u]) + (s[u] ^ s[u + w]) + (s[u + w] ^ s[w]) + (s[w] ^ s[0])) / 2;
    }
    if (!more[0] || !more[1] || !more[2]) return;
    CellValues v;
    int count = 0;
    for (int c = 0; c < 8; ++c) {
      const int corner = (c & 1 ? stride[0] : 0) + (c & 2 ? stride[1] : 0) + (c >> 2);
      v[c] = block.value[std::size_t(at + corner)];
      count += s[corner];
    }
    if (count % 8 != 0) sum += patches(p, v);
  });
  return sum;
}

/// The cells about the two ends of an edge, on the lattice and four times as fine.
class EdgeBlock {
public:
  /// `ends`: with the cells beyond the edge's ends.
  EdgeBlock(const BrickLattice& lattice, const Field& field, const HiddenEdge& edge, bool ends)
      : lattice_(lattice),
        field_(field),
        low_(edge.low - (ends ? IVec3(1) : IVec3(1) - unit(edge.axis))),
        coarse_(IVec3(2) + (ends ? unit(edge.axis) : -unit(edge.axis))) {
    for_each_point(coarse_.cells + 1, [&](const IVec3& p) { coarse_.at(p) = corner_value(low_ + p); });
  }

  int fine_euler() const {
    BrickLattice finer;
    finer.spacing = lattice_.spacing / kFine;
    finer.origin = place(lattice_, DVec3(low_));
    Block fine(kFine * coarse_.cells);
    std::vector<double> values(fine.value.size());
    field_.values(finer.origin, finer.spacing, fine.cells + 1, values);
    std::copy(values.begin(), values.end(), fine.value.begin());
    return euler(fine, [&](const IVec3& cell, const CellValues& v) { return patches(finer, cell, v); });
  }

  /// With the value at one corner of the lattice replaced.
  int coarse_euler(const IVec3& corner, float value) const {
    Block changed = coarse_;
    changed.at(corner - low_) = value;
    return euler(changed, [&](const IVec3& cell, const CellValues& v) { return patches(lattice_, low_ + cell, v); });
  }

  float value(const IVec3& corner) const { return coarse_.at(corner - low_); }

private:
  float corner_value(const IVec3& corner) const {
    const IVec3 brick = corner >> 3;
    const Index b = lattice_.find(brick);
    if (b == kNone) return float(field_.value(lattice_.point(corner)));
    return lattice_.value[std::size_t(b) * BrickLattice::kValues + BrickLattice::corner_index(corner - kCells * brick)];
  }

  int patches(const BrickLattice& lattice, const IVec3& cell, const CellValues& v) const {
    unsigned decided = 0, joined = 0;
    for (unsigned faces = ambiguous_faces(v); faces; faces &= faces - 1) {
      const int face = std::countr_zero(faces), axis = face / 2, side = face % 2 << axis;
      const int u = 1 << (axis + 1) % 3, w = 1 << (axis + 2) % 3;
      const std::array<float, 4> at{v[side], v[side | u], v[side | w], v[side | u | w]};
      decided |= 1u << face;
      if (inside_joined(lattice, field_, {cell + face % 2 * unit(axis), axis, at})) joined |= 1u << face;
    }
    const CellShape& s = shape(find_shape(v, decided, joined));
    return is_tunnel(lattice, field_, cell, s, v) ? 0 : s.loops;
  }

  const BrickLattice& lattice_;
  const Field& field_;
  IVec3 low_;
  Block coarse_;
};

/// The bricks that hold a corner; nothing where a cell about it lies in none.
std::vector<Index> bricks_about(const BrickLattice& lattice, const IVec3& corner) {
  std::vector<Index> bricks;
  for (int i = 0; i < 8; ++i) {
    const Index b = lattice.find((corner - IVec3(i >> 2, i >> 1 & 1, i & 1)) >> 3);
    if (b == kNone) return {};
    if (std::find(bricks.begin(), bricks.end(), b) == bricks.end()) bricks.push_back(b);
  }
  return bricks;
}

/// The Euler characteristic of the surface about the edge and its ends, where the corners do not tell that of the
/// surface about the edge.
std::optional<int> untold_euler(const BrickLattice& lattice, const Field& field, const HiddenEdge& edge) {
  const EdgeBlock about(lattice, field, edge, false);
  if (about.coarse_euler(edge.low, about.value(edge.low)) == about.fine_euler()) return {};
  return EdgeBlock(lattice, field, edge, true).fine_euler();
}

/// The end of the edge that has to change sides, if one has to.
std::optional<IVec3> end_to_change(const BrickLattice& lattice, const Field& field, const HiddenEdge& edge,
                                   int wanted) {
  const EdgeBlock block(lattice, field, edge, true);
  const auto off = [&](const IVec3& corner, float value) {
    return std::abs(block.coarse_euler(corner, value) - wanted);
  };
  int best = off(edge.low, block.value(edge.low));
  if (best == 0) return {};
  std::array<IVec3, 2> ends{edge.low, edge.low + unit(edge.axis)};
  if (std::abs(block.value(ends[1])) < std::abs(block.value(ends[0]))) std::swap(ends[0], ends[1]);
  std::optional<IVec3> found;
  for (const IVec3& end : ends) {
    if (bricks_about(lattice, end).empty()) continue;
    const int remains = off(end, changed(block.value(end)));
    if (remains < best) {
      best = remains;
      found = end;
    }
  }
  return found;
}

float& value_at(BrickLattice& lattice, Index brick, const IVec3& corner) {
  return lattice.value[std::size_t(brick) * BrickLattice::kValues +
                       BrickLattice::corner_index(corner - kCells * lattice.coordinate[brick])];
}

/// Is the edge in one of these bricks, or begins beside one, or in none?
bool lies_in(const BrickLattice& lattice, const IVec3& low, const std::vector<std::uint8_t>& bricks) {
  bool somewhere = false;
  for (int i = 0; i < 8; ++i) {
    const Index b = lattice.find((low - IVec3(i >> 2, i >> 1 & 1, i & 1)) >> 3);
    if (b == kNone) continue;
    somewhere = true;
    if (bricks[b]) return true;
  }
  return !somewhere;
}

bool by_key(const HiddenEdge& a, const HiddenEdge& b) {
  return a.key() < b.key();
}

/// Edges that may hide crossings, sorted; those of some bricks where `wanted` is not empty.
std::vector<HiddenEdge> find_hidden(const BrickLattice& lattice, const std::vector<BrickSigns>& signs,
                                    const Field& field, const std::vector<std::uint8_t>& wanted) {
  std::vector<std::vector<HiddenEdge>> found(lattice.brick_count());
  for_each_heavy(found.size(), [&](std::size_t b) {
    if ((wanted.empty() || wanted[b]) && signs[b].mixed()) find_hidden(lattice, signs[b], field, b, found[b]);
  });
  std::vector<HiddenEdge> edges;
  for (const auto& f : found) edges.insert(edges.end(), f.begin(), f.end());
  std::sort(edges.begin(), edges.end(), by_key);
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

/// Fills lattice.hidden, but for what may stay of it.
void list_hidden(BrickLattice& lattice, const std::vector<BrickSigns>& signs, const Field& field,
                 const std::vector<std::uint8_t>& stale) {
  const bool all = stale.empty();
  std::vector<HiddenEdge> edges = find_hidden(lattice, signs, field, all ? stale : with_neighbours(lattice, stale));
  if (all) {
    lattice.hidden.clear();
  } else {
    std::erase_if(edges, [&](const HiddenEdge& e) { return !lies_in(lattice, e.low, stale); });
    std::erase_if(lattice.hidden, [&](const HiddenEdge& e) { return lies_in(lattice, e.low, stale); });
  }
  std::vector<std::optional<int>> euler(edges.size());
  tbb::parallel_for(std::size_t(0), edges.size(),
                    [&](std::size_t i) { euler[i] = untold_euler(lattice, field, edges[i]); });
  for (std::size_t i = 0; i < edges.size(); ++i)
    if (euler[i]) lattice.hidden.push_back({edges[i].low, edges[i].axis, *euler[i]});
  std::sort(lattice.hidden.begin(), lattice.hidden.end(), by_key);
}

}  // namespace

std::size_t reveal_hidden_crossings(BrickLattice& lattice, std::vector<BrickSigns>& signs, const Field& field,
                                    const std::vector<std::uint8_t>& stale) {
  list_hidden(lattice, signs, field, stale);
  lattice.revealed.clear();
  std::size_t count = 0;
  for (const HiddenEdge& edge : lattice.hidden) {  // one after another: each sees what those before have changed
    const std::optional<IVec3> end = end_to_change(lattice, field, edge, edge.euler);
    if (!end) continue;
    const std::vector<Index> bricks = bricks_about(lattice, *end);
    const float value = value_at(lattice, bricks.front(), *end);
    lattice.revealed.push_back({*end, value});
    for (const Index b : bricks) {
      value_at(lattice, b, *end) = changed(value);
      signs[b] = BrickSigns(&lattice.value[std::size_t(b) * BrickLattice::kValues]);
    }
    ++count;
  }
  return count;
}

void hide_crossings(BrickLattice& lattice) {
  for (auto r = lattice.revealed.rbegin(); r != lattice.revealed.rend(); ++r)  // a corner may have changed twice
    for (const Index b : bricks_about(lattice, r->corner)) value_at(lattice, b, r->corner) = r->value;
  lattice.revealed.clear();
}

}  // namespace isoskin
