#include "core/sampling/marching_cubes.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include <tbb/enumerable_thread_specific.h>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/sampling/ambiguous_faces.h"
#include "core/sampling/brick_signs.h"
#include "core/sampling/cell_shapes.h"
#include "core/sampling/surface_bricks.h"

namespace isoskin {
namespace {

using sampling::cell_corner;
using sampling::for_bricks;
using sampling::for_each_crossing;

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kValues = BrickLattice::kValues;

/// Whether signs tell the shape of such a cell, and it is one loop.
const std::array<bool, 256>& told_by_signs() {
  static const std::array<bool, 256> told = [] {
    std::array<bool, 256> all{};
    for (unsigned signs = 1; signs < 255; ++signs)
      all[signs] = ambiguous_faces(signs) == 0 && shape(plain_shape(signs)).loops == 1;
    return all;
  }();
  return told;
}

/// Crossings and, where signs do not tell them, cells of a brick with corners of both signs.
void find_cells_and_crossings(const BrickLattice& lattice, LatticeTopology& t, std::size_t b) {
  const BrickSigns& signs = t.signs[b];
  BrickCrossings& c = t.crossings[b];
  const std::array<bool, 256>& told = told_by_signs();
  bool all_told = true;
  for (int x = 0; x < kCells; ++x)
    for (int y = 0; y < kCells; ++y) {
      const unsigned r = signs.at(x, y);
      c.mask[x] |= std::uint64_t{(r ^ signs.at(x + 1, y)) & 0xff} << 8 * y;
      c.mask[8 + x] |= std::uint64_t{(r ^ signs.at(x, y + 1)) & 0xff} << 8 * y;
      c.mask[16 + x] |= std::uint64_t{(r ^ r >> 1) & 0xff} << 8 * y;
      for (unsigned cells = signs.surface_cells(x, y); cells; cells &= cells - 1)
        all_told &= told[signs.cell_signs(x, y, std::countr_zero(cells))];
    }
  for (int w = 1; w < 24; ++w) c.before[w] = static_cast<std::uint16_t>(c.before[w - 1] + std::popcount(c.mask[w - 1]));
  if (all_told) return;
  std::vector<SurfaceCell> cells;
  const float* value = &lattice.value[b * kValues];
  sampling::for_each_surface_cell(t, b, [&](SurfaceCell cell) {
    const IVec3 local = cell_corner(cell.cell), at = lattice.coordinate[b] * kCells + local;
    if (ambiguous_faces(signs.cell_signs(local.x, local.y, local.z)) != 0) {
      std::array<float, 8> v;
      for (int i = 0; i < 8; ++i) v[i] = value[BrickLattice::corner_index(local + IVec3(i & 1, i >> 1 & 1, i >> 2))];
      cell.shape = find_shape(lattice, at, v);
    }
    cell.patches = shape(cell.shape).loops;
    cell.tunnel = cell.patches == 2 && lattice.has_tunnel(at);
    cell.first_patch = cells.empty() ? 0 : static_cast<std::uint16_t>(cells.back().first_patch + cells.back().patches);
    cells.push_back(cell);
  });
  t.cells[b] = std::move(cells);
}

/// Per brick what it was; as before it had any, where none is alike. Most keep their numbers, and so their places.
template <class Item>
std::vector<Item> taken_over(std::vector<Item> before, const std::vector<Index>& same_as) {
  std::vector<Item> now;
  bool in_place = before.size() == same_as.size();
  for (std::size_t b = 0; b < same_as.size() && in_place; ++b) in_place = same_as[b] == kNone || same_as[b] == b;
  if (in_place) now = std::move(before);
  now.resize(same_as.size());
  for_bricks(same_as.size(), [&](std::size_t b) {
    if (same_as[b] == kNone)
      now[b] = Item{};
    else if (!in_place)
      now[b] = std::move(before[same_as[b]]);
  });
  return now;
}

/// `same_as`: per brick the one before that is alike, kNone where there is none.
void find_cells_and_crossings(const BrickLattice& lattice, const std::vector<Index>& same_as, LatticeTopology& before,
                              LatticeTopology& t) {
  const std::size_t bricks = lattice.brick_count();
  t.crossings = taken_over(std::move(before.crossings), same_as);
  t.cells = taken_over(std::move(before.cells), same_as);
  t.signs = taken_over(std::move(before.signs), same_as);
  const bool same_bricks = !lattice.same_as.empty() && lattice.gone.empty() && before.upper.size() == bricks;
  if (same_bricks) t.upper = before.upper;
  t.upper.resize(bricks);
  for_bricks(bricks, [&](std::size_t b) {
    for (int i = 0; i < 8 && !same_bricks; ++i)
      t.upper[b][i] =
          i == 0 ? static_cast<Index>(b) : lattice.find(lattice.coordinate[b] + IVec3(i >> 2, i >> 1 & 1, i & 1));
    if (same_as[b] != kNone) return;
    t.signs[b] = BrickSigns(&lattice.value[b * kValues]);
    if (t.signs[b].mixed()) find_cells_and_crossings(lattice, t, b);
  });
  for (BrickCrossings& c : t.crossings) {
    c.first = t.crossing_count;
    t.crossing_count += c.size();
  }
}

[[noreturn]] void throw_open(const BrickLattice& lattice, Index brick) {
  const IVec3 where = lattice.coordinate[brick];
  throw std::invalid_argument("the surface leaves the lattice at brick (" + std::to_string(where.x) + ", " +
                              std::to_string(where.y) + ", " + std::to_string(where.z) + ")");
}

/// Do the cells with corners of both signs hang together through faces with corners of both signs?
bool hangs_together(const BrickSigns& signs) {
  constexpr std::uint64_t kFirstRow = 0xff;
  std::array<std::uint64_t, kCells> cells{}, across_x{}, across_y{}, across_z{};  // to the cell before; bit y * 8 + z
  for (int x = 0; x < kCells; ++x)
    for (int y = 0; y < kCells; ++y) {
      const unsigned a = signs.at(x, y), b = signs.at(x + 1, y), c = signs.at(x, y + 1), d = signs.at(x + 1, y + 1);
      const auto mixed = [](unsigned p, unsigned q) {
        return ((p | q) | (p | q) >> 1) & ~(p & q & (p & q) >> 1) & 0xff;
      };
      cells[x] |= std::uint64_t{signs.surface_cells(x, y)} << 8 * y;
      across_x[x] |= std::uint64_t{mixed(a, c)} << 8 * y;
      across_y[x] |= std::uint64_t{mixed(a, b)} << 8 * y;
      across_z[x] |= std::uint64_t{(a | b | c | d) & ~(a & b & c & d) & 0xfe} << 8 * y;
    }
  std::array<std::uint64_t, kCells> seen{};
  const auto first = std::find_if(cells.begin(), cells.end(), [](std::uint64_t c) { return c != 0; });
  if (first == cells.end()) return true;
  seen[first - cells.begin()] = *first & (~*first + 1);
  const auto spread_in = [&](int x) {
    for (std::uint64_t before = 0; before != seen[x];) {
      before = seen[x];
      seen[x] |= seen[x] << 1 & across_z[x];
      seen[x] |= (seen[x] & across_z[x]) >> 1;
      seen[x] |= seen[x] << 8 & across_y[x] & ~kFirstRow;
      seen[x] |= (seen[x] & across_y[x] & ~kFirstRow) >> 8;
    }
  };
  for (bool grows = true; grows;) {
    const auto before = seen;
    for (int x = 0; x < kCells; ++x) {
      if (x > 0) seen[x] |= seen[x - 1] & across_x[x];
      spread_in(x);
    }
    for (int x = kCells - 2; x >= 0; --x) {
      seen[x] |= seen[x + 1] & across_x[x + 1];
      spread_in(x);
    }
    grows = seen != before;
  }
  return seen == cells;
}

/// Crossings of a brick's upper neighbour (see LatticeTopology::upper) that lie in both bricks: its masks' bits.
using Shared = std::array<std::uint64_t, 24>;
constexpr std::array<Shared, 8> shared_crossings() {
  constexpr std::uint64_t kLowZ = 0x0101010101010101, kLowY = 0xff;
  std::array<Shared, 8> shared{};
  for (int neighbour = 1; neighbour < 8; ++neighbour)
    for (int word = 0; word < 24; ++word) {
      const bool towards_axis = neighbour >> (2 - word / 8) & 1, off_x = (neighbour & 4) && word % 8 != 0;
      if (towards_axis || off_x) continue;
      shared[neighbour][word] =
          (neighbour & 2 ? kLowY : ~std::uint64_t{0}) & (neighbour & 1 ? kLowZ : ~std::uint64_t{0});
    }
  return shared;
}
constexpr std::array<Shared, 8> kShared = shared_crossings();

/// Finds the parts of one brick after another.
class PartFinder {
public:
  /// Fills the brick's cells where there are several parts.
  BrickParts find(const BrickLattice& lattice, LatticeTopology& t, Index brick) {
    parts_ = {};
    check_closed(lattice, t, brick);
    if (!t.cells[brick].empty() || !hangs_together(t.signs[brick])) {
      tell_apart(t, brick);
    } else {
      int patches = 0;
      for (int row = 0; row < kCells * kCells; ++row)
        patches += std::popcount(t.signs[brick].surface_cells(row / kCells, row % kCells));
      parts_.part.emplace_back().euler = patches - int(t.crossings[brick].size());
    }
    measure(lattice, t, brick);
    return std::move(parts_);
  }

private:
  static constexpr int kEdges = 3 * kValues;  // by axis, then by the corner they start at

  /// Slots of a cell's twelve edges from that of its low corner along x.
  static std::array<int, 12> slots_of_cell() {
    std::array<int, 12> all;
    for (int e = 0; e < 12; ++e) {
      const CellEdge edge = cell_edge(e);
      all[e] = edge.axis * kValues + BrickLattice::corner_index({edge.low[0], edge.low[1], edge.low[2]});
    }
    return all;
  }

  static void check_closed(const BrickLattice& lattice, const LatticeTopology& t, Index brick) {
    for (int i = 1; i < 7; ++i)
      if (t.upper[brick][i] == kNone && t.signs[brick].crosses({i >> 2, i >> 1 & 1, i & 1})) throw_open(lattice, brick);
  }

  void tell_apart(LatticeTopology& t, Index brick) {
    std::vector<SurfaceCell>& cells = t.cells[brick];
    if (cells.empty()) {
      std::vector<SurfaceCell> all;
      sampling::for_each_surface_cell(t, brick, [&](const SurfaceCell& cell) { all.push_back(cell); });
      cells = std::move(all);
    }
    number_crossings(t, brick);
    for (const SurfaceCell& cell : cells) join(cell);
    number_parts(t, brick);
    if (parts_.part.size() > 1) return;
    parts_.of_patch.clear();
    parts_.of_crossing.clear();
    parts_.link.clear();
  }

  /// All crossings of the brick's closed box: its own in their order, then those of its upper neighbours.
  void number_crossings(const LatticeTopology& t, Index brick) {
    slot_.clear();
    for_each_crossing(t.crossings[brick], [&](Index, const IVec3& low, int axis) { number_crossing(axis, low); });
    own_ = slot_.size();
    const BrickSigns& signs = t.signs[brick];
    for (int x = 0; x < kCorners; ++x)
      for (int y = 0; y < kCorners; ++y) {
        const unsigned r = signs.at(x, y), upper = x == kCells || y == kCells ? 0x1ffu : 0x100u;
        if (x < kCells) number_row(0, x, y, (r ^ signs.at(x + 1, y)) & upper);
        if (y < kCells) number_row(1, x, y, (r ^ signs.at(x, y + 1)) & upper);
        if (upper & 1) number_row(2, x, y, (r ^ r >> 1) & 0xff);
      }
    parent_.resize(slot_.size());
    std::iota(parent_.begin(), parent_.end(), std::uint16_t{0});
  }

  void number_row(int axis, int x, int y, unsigned bits) {
    for (; bits; bits &= bits - 1) number_crossing(axis, {x, y, std::countr_zero(bits)});
  }

  void number_crossing(int axis, const IVec3& low) {
    const int slot = axis * kValues + BrickLattice::corner_index(low);
    number_[slot] = static_cast<std::uint16_t>(slot_.size());
    slot_.push_back(static_cast<std::uint16_t>(slot));
  }

  std::uint16_t root(std::uint16_t a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  /// Of the set of `a`, a root, and that of `b`.
  std::uint16_t unite(std::uint16_t a, std::uint16_t b) {
    if (parent_[b] == a) return a;
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
    return std::min(a, b);
  }

  /// Numbers of the crossings on the edges of a cell.
  std::uint16_t crossing(int cell_slot, std::uint8_t edge) const { return number_[cell_slot + slots_[edge]]; }
  static int cell_slot(std::uint16_t cell) { return BrickLattice::corner_index(cell_corner(cell)); }

  void join(const SurfaceCell& cell) {
    const CellShape& s = shapes_[cell.shape];
    const int slot = cell_slot(cell.cell);
    for (int l = 0; l < s.loops; ++l) {
      std::uint16_t set = root(crossing(slot, s.edge[s.first[l]]));
      for (int k = s.first[l] + 1; k < s.first[l + 1]; ++k) set = unite(set, crossing(slot, s.edge[k]));
    }
    if (cell.tunnel) unite(root(crossing(slot, s.edge[s.first[0]])), crossing(slot, s.edge[s.first[1]]));
  }

  void number_parts(const LatticeTopology& t, Index brick) {
    auto& part = parts_.part;
    const SurfaceCell& last = t.cells[brick].back();
    parts_.of_patch.resize(std::size_t{last.first_patch} + last.patches);
    parts_.of_crossing.resize(own_);
    for (std::uint16_t& parent : parent_) parent = parent_[parent];  // never later than its child: now all are roots
    part_of_root_.assign(slot_.size(), kNone);
    for (const SurfaceCell& cell : t.cells[brick]) {
      const CellShape& s = shapes_[cell.shape];
      const int slot = cell_slot(cell.cell);
      for (int l = 0; l < s.loops; ++l) {
        Index& number = part_of_root_[parent_[crossing(slot, s.edge[s.first[l]])]];
        if (number == kNone) {
          number = static_cast<Index>(part.size());
          part.emplace_back();
        }
        parts_.of_patch[cell.first_patch + l] = static_cast<std::uint16_t>(number);
        ++part[number].euler;
      }
      if (cell.tunnel) part[parts_.of_patch[cell.first_patch]].euler -= 2;  // an annulus instead of two discs
    }
    // Every crossing lies on four patches and has four segments, each shared by two of them: V - E + F = F - V.
    for (std::size_t i = 0; i < own_; ++i) {
      const Index number = part_of_root_[parent_[i]];
      parts_.of_crossing[i] = static_cast<std::uint16_t>(number);
      --part[number].euler;
    }
    for (std::size_t i = own_; i < slot_.size(); ++i) {
      const int axis = slot_[i] / kValues, corner = slot_[i] % kValues;
      const IVec3 low(corner / (kCorners * kCorners), corner / kCorners % kCorners, corner % kCorners);
      const int neighbour = (low.x == kCells) << 2 | (low.y == kCells) << 1 | (low.z == kCells);
      const Index c = t.crossing(brick, low, axis);
      parts_.link.push_back({static_cast<std::uint16_t>(part_of_root_[parent_[i]]),
                             static_cast<std::uint16_t>(c - t.crossings[t.upper[brick][neighbour]].first),
                             static_cast<std::uint8_t>(neighbour)});
    }
  }

  /// Enclosed volume by the divergence theorem, along all three axes: a lattice line has been inside up to a crossing
  /// where it leaves, and from one on where it enters.
  void measure(const BrickLattice& lattice, const LatticeTopology& t, Index brick) {
    constexpr double kAxes = 3.0;
    const float* const value = &lattice.value[std::size_t{brick} * kValues];
    for_each_crossing(t.crossings[brick], [&](Index number, const IVec3& corner, int axis) {
      BrickParts::Part& part = parts_.part[parts_.of_crossing.empty() ? 0 : parts_.of_crossing[number]];
      DVec3 at(corner);
      at[axis] += sampling::crossing_place(value, corner, axis);
      const int leaves = value[BrickLattice::corner_index(corner)] > 0 ? 1 : -1;
      part.volume += leaves * at[axis] / kAxes;
      part.faces[axis] += leaves;
      part.box.add(at);
    });
    const DVec3 low(lattice.coordinate[brick] * kCells);
    for (BrickParts::Part& part : parts_.part)
      if (!part.box.empty())
        part.box = {lattice.origin + lattice.spacing * (low + part.box.low),
                    lattice.origin + lattice.spacing * (low + part.box.high)};
  }

  const std::array<int, 12> slots_ = slots_of_cell();
  const CellShape* const shapes_ = &shape(0);  // all of them
  BrickParts parts_;
  std::array<std::uint16_t, kEdges> number_;  // of the crossing on an edge, where there is one
  std::vector<std::uint16_t> slot_, parent_;
  std::vector<Index> part_of_root_;
  std::size_t own_ = 0;
};

/// Whether all that PartFinder asks of a brick, its upper neighbours' crossings included, is as it was for brick `old`.
bool parts_stay(const std::vector<Index>& same_as, const LatticeTopology& before, const LatticeTopology& t,
                std::size_t brick, Index old) {
  for (int i = 0; i < 8; ++i) {
    const Index neighbour = t.upper[brick][i], was = before.upper[old][i];
    if (neighbour == kNone ? was != kNone : same_as[neighbour] != was || was == kNone) return false;
  }
  return true;
}

/// One byte a brick: whether its parts were not taken over.
std::vector<std::uint8_t> find_parts(const BrickLattice& lattice, const std::vector<Index>& same_as,
                                     LatticeTopology& before, LatticeTopology& t) {
  t.parts = taken_over(std::move(before.parts), same_as);
  std::vector<std::uint8_t> found(t.parts.size());
  tbb::enumerable_thread_specific<PartFinder> finder;
  for_bricks(t.parts.size(), [&](std::size_t b) {
    found[b] = same_as[b] == kNone;
    if (!t.signs[b].mixed()) return;
    found[b] = found[b] || !parts_stay(same_as, before, t, b, same_as[b]);
    if (found[b]) t.parts[b] = finder.local().find(lattice, t, static_cast<Index>(b));
  });
  return found;
}

/// See LatticeTopology::changed.
std::vector<Index> changed_bricks(const std::vector<Index>& same_as, const std::vector<std::uint8_t>& found,
                                  const LatticeTopology& before, const LatticeTopology& t) {
  return indices_where(same_as.size(), [&](Index b) {
    if (found[b]) return true;
    const auto piece = t.part_piece.begin() + t.first_part[b], end = t.part_piece.begin() + t.first_part[b + 1];
    return !std::equal(piece, end, before.part_piece.begin() + before.first_part[same_as[b]]);
  });
}

/// Joins the parts of a brick to those of its neighbour `i`, some of which it shares crossings with, if it has but one.
void join_single(const LatticeTopology& t, DisjointSets& sets, Index brick, int i) {
  const Index other = t.upper[brick][i];
  const BrickParts& parts = t.parts[other];
  if (parts.of_crossing.empty()) {
    std::uint64_t any = 0;
    for (int word = 0; word < 24 && !any; ++word) any = t.crossings[other].mask[word] & kShared[i][word];
    if (any) sets.unite(t.first_part[brick], t.first_part[other]);
    return;
  }
  const BrickCrossings& c = t.crossings[other];
  for (int word = 0; word < 24; ++word)
    for (std::uint64_t bits = c.mask[word] & kShared[i][word]; bits; bits &= bits - 1) {
      const int number = c.before[word] + std::popcount(c.mask[word] & ((bits & (~bits + 1)) - 1));
      sets.unite(t.first_part[brick], t.first_part[other] + parts.of_crossing[number]);
    }
}

/// Makes pieces of the bricks' parts.
void join_parts(const BrickLattice& lattice, LatticeTopology& t) {
  const std::vector<BrickParts>& bricks = t.parts;
  t.first_part.assign(bricks.size() + 1, 0);
  for (std::size_t b = 0; b < bricks.size(); ++b)
    t.first_part[b + 1] = t.first_part[b] + static_cast<Index>(bricks[b].part.size());
  DisjointSets sets(t.first_part.back());
  for_bricks(bricks.size(), [&](std::size_t brick) {
    const Index b = static_cast<Index>(brick);
    for (const BrickParts::Link& link : bricks[b].link) {
      const Index other = t.upper[b][link.neighbour];
      sets.unite(t.first_part[b] + link.part, t.first_part[other] + bricks[other].part_of_crossing(link.crossing));
    }
    if (bricks[b].part.size() != 1) return;
    for (int i = 1; i < 7; ++i)
      if (t.upper[b][i] != kNone) join_single(t, sets, b, i);
  });
  t.part_piece.resize(t.first_part.back());
  const double cell = std::pow(lattice.spacing, 3);
  for (std::size_t b = 0; b < bricks.size(); ++b)
    for (Index k = 0; k < bricks[b].part.size(); ++k) {
      const Index at = t.first_part[b] + k, root = sets.root(at);  // no later than the part itself
      if (root == at) {
        t.part_piece[root] = static_cast<Index>(t.euler.size());
        t.euler.push_back(0);
        t.volume.push_back(0.0);
        t.box.emplace_back();
      }
      const Index p = t.part_piece[at] = t.part_piece[root];
      const BrickParts::Part& part = bricks[b].part[k];
      const DVec3 offset(kCells * (lattice.coordinate[b] - lattice.coordinate.front()));
      t.euler[p] += part.euler;
      t.volume[p] += (part.volume + glm::dot(offset, DVec3(part.faces)) / 3.0) * cell;
      t.box[p].add(part.box);
    }
}

}  // namespace

Index LatticeTopology::crossing(Index brick, IVec3 corner, int axis) const {
  const int up = (corner.x == kCells) << 2 | (corner.y == kCells) << 1 | (corner.z == kCells);
  if (up) {
    brick = upper[brick][up];
    if (brick == kNone) return kNone;
    corner = {corner.x & 7, corner.y & 7, corner.z & 7};
  }
  const BrickCrossings& c = crossings[brick];
  const int word = axis * 8 + corner.x;
  const std::uint64_t bit = std::uint64_t{1} << (corner.y * 8 + corner.z);
  if (!(c.mask[word] & bit)) return kNone;
  return c.first + c.before[word] + static_cast<Index>(std::popcount(c.mask[word] & (bit - 1)));
}

Index LatticeTopology::crossing_piece(Index brick, IVec3 corner, int axis) const {
  const Index c = crossing(brick, corner, axis);
  if (c == kNone) return kNone;
  brick = upper[brick][(corner.x == kCells) << 2 | (corner.y == kCells) << 1 | (corner.z == kCells)];
  return piece_of_crossing(brick, c - crossings[brick].first);
}

LatticeTopology lattice_topology(const BrickLattice& lattice, LatticeTopology before) {
  const bool goes_on = !before.parts.empty() && !lattice.same_as.empty();
  const std::vector<Index> same_as = goes_on ? lattice.same_as : std::vector<Index>(lattice.brick_count(), kNone);
  LatticeTopology t;
  find_cells_and_crossings(lattice, same_as, before, t);
  const std::vector<std::uint8_t> found = find_parts(lattice, same_as, before, t);
  join_parts(lattice, t);
  if (goes_on) t.changed = changed_bricks(same_as, found, before, t);
  return t;
}

}  // namespace isoskin
