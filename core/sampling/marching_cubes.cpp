#include "core/sampling/marching_cubes.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "core/sampling/ambiguous_faces.h"
#include "core/sampling/brick_signs.h"
#include "core/sampling/cell_shapes.h"
#include "core/sampling/cell_surface.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kValues = BrickLattice::kValues;

template <class F>
void for_bricks(std::size_t count, const F& f) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 16), [&](const auto& range) {
    for (std::size_t b = range.begin(); b != range.end(); ++b) f(b);
  });
}

/// Turns counts into CSR offsets: first[i] becomes the sum of all before it; the total is returned and stored last.
Index offsets_from_counts(std::vector<Index>& first) {
  Index sum = 0;
  for (Index& f : first) sum += std::exchange(f, sum);
  return sum;
}

/// The brick of the lattice before that is alike; kNone where there is none.
Index same_as(const BrickLattice& lattice, const LatticeTopology& before, std::size_t brick) {
  return before.parts.empty() || lattice.same_as.empty() ? kNone : lattice.same_as[brick];
}

void find_cells_and_crossings(const BrickLattice& lattice, const LatticeTopology& before, LatticeTopology& t) {
  const std::size_t bricks = lattice.brick_count();
  t.first_cell.assign(bricks + 1, 0);
  t.crossings.resize(bricks);
  t.upper.resize(bricks);
  t.signs.resize(bricks);
  for_bricks(bricks, [&](std::size_t b) {
    for (int i = 0; i < 8; ++i)
      t.upper[b][i] =
          i == 0 ? static_cast<Index>(b) : lattice.find(lattice.coordinate[b] + IVec3(i >> 2, i >> 1 & 1, i & 1));
    if (const Index old = same_as(lattice, before, b); old != kNone) {
      t.signs[b] = before.signs[old];
      t.first_cell[b] = before.first_cell[old + 1] - before.first_cell[old];
      t.crossings[b] = before.crossings[old];
      t.crossings[b].first = static_cast<Index>(before.parts[old].of_crossing.size());
      return;
    }
    const BrickSigns signs = t.signs[b] = BrickSigns(&lattice.value[b * kValues]);
    if (!signs.mixed()) return;
    BrickCrossings& c = t.crossings[b];
    Index cells = 0;
    for (int x = 0; x < kCells; ++x) {
      std::uint64_t surface = 0;
      for (int y = 0; y < kCells; ++y) {
        surface |= std::uint64_t{signs.surface_cells(x, y)} << 8 * y;
        const unsigned r = signs.at(x, y);
        c.mask[x] |= std::uint64_t{(r ^ signs.at(x + 1, y)) & 0xff} << 8 * y;
        c.mask[8 + x] |= std::uint64_t{(r ^ signs.at(x, y + 1)) & 0xff} << 8 * y;
        c.mask[16 + x] |= std::uint64_t{(r ^ r >> 1) & 0xff} << 8 * y;
      }
      cells += static_cast<Index>(std::popcount(surface));
    }
    t.first_cell[b] = cells;
    for (int w = 1; w < 24; ++w)
      c.before[w] = static_cast<std::uint16_t>(c.before[w - 1] + std::popcount(c.mask[w - 1]));
    c.first = static_cast<Index>(c.before[23] + std::popcount(c.mask[23]));  // the count, for now
  });
  const Index cells = offsets_from_counts(t.first_cell);
  Index crossings = 0;
  for (BrickCrossings& c : t.crossings) crossings += std::exchange(c.first, crossings);
  t.cell.resize(cells);
  t.shape.resize(cells);
  t.tunnel.resize(cells);
  t.first_patch.assign(std::size_t{cells} + 1, 0);
  t.crossing_point.resize(crossings);
  t.crossing_piece.assign(crossings, kNone);
}

void fill_cells(const BrickLattice& lattice, const LatticeTopology& before, LatticeTopology& t) {
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    if (t.first_cell[b] == t.first_cell[b + 1]) return;
    Index at = t.first_cell[b];
    if (const Index old = same_as(lattice, before, b); old != kNone) {
      for (Index c = before.first_cell[old]; c < before.first_cell[old + 1]; ++c, ++at) {
        t.cell[at] = before.cell[c];
        t.shape[at] = before.shape[c];
        t.tunnel[at] = before.tunnel[c];
        t.first_patch[at] = before.first_patch[c + 1] - before.first_patch[c];
      }
      return;
    }
    const float* value = &lattice.value[b * kValues];
    const BrickSigns& signs = t.signs[b];
    for (int x = 0; x < kCells; ++x)
      for (int y = 0; y < kCells; ++y)
        for (unsigned cells = signs.surface_cells(x, y); cells; cells &= cells - 1) {
          const int z = std::countr_zero(cells);
          const unsigned of_cell = signs.cell_signs(x, y, z);
          const IVec3 cell = lattice.coordinate[b] * kCells + IVec3(x, y, z);
          t.cell[at] = static_cast<std::uint16_t>((x * kCells + y) * kCells + z);
          if (ambiguous_faces(of_cell) == 0) {
            t.shape[at] = plain_shape(of_cell);
          } else {
            std::array<float, 8> v;
            for (int c = 0; c < 8; ++c)
              v[c] = value[BrickLattice::corner_index({x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)})];
            t.shape[at] = find_shape(lattice, cell, v);
          }
          t.tunnel[at] = shape(t.shape[at]).loops == 2 && lattice.has_tunnel(cell);
          t.first_patch[at] = shape(t.shape[at]).loops;
          ++at;
        }
  });
  t.piece.resize(offsets_from_counts(t.first_patch));
}

IVec3 cell_corner(int cell) {
  return {cell / (kCells * kCells), cell / kCells % kCells, cell % kCells};
}

[[noreturn]] void throw_open(const BrickLattice& lattice, Index brick) {
  const IVec3 where = lattice.coordinate[brick];
  throw std::invalid_argument("the surface leaves the lattice at brick (" + std::to_string(where.x) + ", " +
                              std::to_string(where.y) + ", " + std::to_string(where.z) + ")");
}

/// Crossing numbers of the edges of one surface cell's loops.
std::array<Index, 12> cell_crossings(const BrickLattice& lattice, const LatticeTopology& t, Index brick, Index at) {
  const CellShape& s = shape(t.shape[at]);
  std::array<Index, 12> crossing;
  crossing.fill(kNone);
  for (int k = 0; k < s.first[s.loops]; ++k) {
    const CellEdge e = cell_edge(s.edge[k]);
    const IVec3 corner = cell_corner(t.cell[at]) + IVec3(e.low[0], e.low[1], e.low[2]);
    const Index c = t.crossing(brick, corner, e.axis);
    if (c == kNone) throw_open(lattice, brick);
    crossing[s.edge[k]] = c;
  }
  return crossing;
}

/// Disjoint sets; the representative is the smallest member.
class Sets {
public:
  explicit Sets(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), Index{0}); }
  Index find(Index a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  void join(Index a, Index b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

private:
  std::vector<Index> parent_;
};

CellSurface surface_in_cell(const LatticeTopology& t, Index at, const std::array<Index, 12>& crossing) {
  CellCrossings point;
  for (int e = 0; e < 12; ++e)
    if (crossing[e] != kNone) point[e] = DVec3(t.crossing_point[crossing[e]]);
  return cell_surface(shape(t.shape[at]), t.tunnel[at], point);
}

/// Finds the parts of one brick after another.
class PartFinder {
public:
  /// Fills crossing_point of one brick.
  BrickParts find(const BrickLattice& lattice, LatticeTopology& t, Index brick) {
    parts_ = {};
    number_crossings(lattice, t, brick);
    for (Index at = t.first_cell[brick]; at < t.first_cell[brick + 1]; ++at) join(t, at);
    number_parts(lattice, t, brick);
    for (Index at = t.first_cell[brick]; at < t.first_cell[brick + 1]; ++at)
      add_volume(t, t.first_patch[t.first_cell[brick]], at);
    place(lattice, t, brick);
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

  /// All crossings of the brick's closed box: its own in their order, then those of its upper neighbours.
  void number_crossings(const BrickLattice& lattice, const LatticeTopology& t, Index brick) {
    value_ = &lattice.value[std::size_t{brick} * kValues];
    point_.clear();
    slot_.clear();
    for (int word = 0; word < 24; ++word)
      for (std::uint64_t bits = t.crossings[brick].mask[word]; bits; bits &= bits - 1) {
        const int bit = std::countr_zero(bits);
        number_crossing(word / 8, {word % 8, bit / 8, bit % 8});
      }
    own_ = point_.size();
    const BrickSigns& signs = t.signs[brick];
    for (int x = 0; x < kCorners; ++x)
      for (int y = 0; y < kCorners; ++y) {
        const unsigned r = signs.at(x, y), upper = x == kCells || y == kCells ? 0x1ffu : 0x100u;
        if (x < kCells) number_row(0, x, y, (r ^ signs.at(x + 1, y)) & upper);
        if (y < kCells) number_row(1, x, y, (r ^ signs.at(x, y + 1)) & upper);
        if (upper & 1) number_row(2, x, y, (r ^ r >> 1) & 0xff);
      }
    parent_.resize(point_.size());
    std::iota(parent_.begin(), parent_.end(), std::uint16_t{0});
  }

  void number_row(int axis, int x, int y, unsigned bits) {
    for (; bits; bits &= bits - 1) number_crossing(axis, {x, y, std::countr_zero(bits)});
  }

  void number_crossing(int axis, const IVec3& low) {
    constexpr std::array<int, 3> step{kCorners * kCorners, kCorners, 1};
    const int corner = BrickLattice::corner_index(low), slot = axis * kValues + corner;
    DVec3 point(low);
    point[axis] += crossing_fraction(value_[corner], value_[corner + step[axis]]);
    number_[slot] = static_cast<std::uint16_t>(point_.size());
    slot_.push_back(static_cast<std::uint16_t>(slot));
    point_.push_back(point);
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

  void join(const LatticeTopology& t, Index at) {
    const CellShape& s = shapes_[t.shape[at]];
    const int slot = cell_slot(t.cell[at]);
    for (int l = 0; l < s.loops; ++l) {
      std::uint16_t set = root(crossing(slot, s.edge[s.first[l]]));
      for (int k = s.first[l] + 1; k < s.first[l + 1]; ++k) set = unite(set, crossing(slot, s.edge[k]));
    }
    if (t.tunnel[at]) unite(root(crossing(slot, s.edge[s.first[0]])), crossing(slot, s.edge[s.first[1]]));
  }

  void number_parts(const BrickLattice& lattice, LatticeTopology& t, Index brick) {
    auto& part = parts_.part;
    const Index first = t.first_patch[t.first_cell[brick]];
    parts_.of_patch.resize(t.first_patch[t.first_cell[brick + 1]] - first);
    parts_.of_crossing.resize(own_);
    for (std::uint16_t& parent : parent_) parent = parent_[parent];  // never later than its child: now all are roots
    part_of_root_.assign(point_.size(), kNone);
    for (Index at = t.first_cell[brick]; at < t.first_cell[brick + 1]; ++at) {
      const CellShape& s = shapes_[t.shape[at]];
      const int slot = cell_slot(t.cell[at]);
      for (int l = 0; l < s.loops; ++l) {
        Index& number = part_of_root_[parent_[crossing(slot, s.edge[s.first[l]])]];
        if (number == kNone) {
          number = static_cast<Index>(part.size());
          part.emplace_back();
        }
        parts_.of_patch[t.first_patch[at] + l - first] = static_cast<std::uint16_t>(number);
        ++part[number].euler;
      }
      if (t.tunnel[at]) part[parts_.of_patch[t.first_patch[at] - first]].euler -= 2;  // an annulus instead of two discs
    }
    // Every crossing lies on four patches and has four segments, each shared by two of them: V - E + F = F - V.
    for (std::size_t i = 0; i < own_; ++i) {
      const Index number = part_of_root_[parent_[i]];
      parts_.of_crossing[i] = static_cast<std::uint16_t>(number);
      --part[number].euler;
    }
    for (std::size_t i = own_; i < point_.size(); ++i) {
      const int axis = slot_[i] / kValues, corner = slot_[i] % kValues;
      const IVec3 low(corner / (kCorners * kCorners), corner / kCorners % kCorners, corner % kCorners);
      const int neighbour = (low.x == kCells) << 2 | (low.y == kCells) << 1 | (low.z == kCells);
      const Index c = t.crossing(brick, low, axis);
      if (c == kNone) throw_open(lattice, brick);
      parts_.link.push_back({static_cast<std::uint16_t>(part_of_root_[parent_[i]]),
                             static_cast<std::uint16_t>(c - t.crossings[t.upper[brick][neighbour]].first),
                             static_cast<std::uint8_t>(neighbour)});
    }
  }

  void add_volume(const LatticeTopology& t, Index first_patch, Index at) {
    const CellShape& s = shapes_[t.shape[at]];
    const int slot = cell_slot(t.cell[at]);
    const std::uint16_t* const part = &parts_.of_patch[t.first_patch[at] - first_patch];
    if (s.centres > 0 || t.tunnel[at]) {
      CellCrossings crossings;
      for (int k = 0; k < s.first[s.loops]; ++k) crossings[s.edge[k]] = point_[crossing(slot, s.edge[k])];
      const CellSurface surface = cell_surface(s, t.tunnel[at], crossings);
      for (int k = 0; k < surface.triangles; ++k) {
        const auto corner = [&](int i) {
          const int c = surface.triangle[k][i];
          return c < 12 ? crossings[c] : surface.extra[c - 12];
        };
        add_triangle(parts_.part[part[surface.loop_of_triangle[k]]], corner(0), corner(1), corner(2));
      }
      return;
    }
    for (int l = 0; l < s.loops; ++l) {
      BrickParts::Part& to = parts_.part[part[l]];
      for (int k = s.first_triangle[l]; k < s.first_triangle[l + 1]; ++k) {
        const auto& corner = s.triangle[k];
        add_triangle(to, point_[crossing(slot, corner[0])], point_[crossing(slot, corner[1])],
                     point_[crossing(slot, corner[2])]);
      }
    }
  }

  static void add_triangle(BrickParts::Part& to, const DVec3& a, const DVec3& b, const DVec3& c) {
    const double shadow = 0.5 * ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
    to.shadow += shadow;
    to.volume += shadow * (a.z + b.z + c.z) / 3.0;
  }

  void place(const BrickLattice& lattice, LatticeTopology& t, Index brick) {
    const DVec3 low(lattice.coordinate[brick] * kCells);
    const Index first = t.crossings[brick].first;
    for (std::size_t i = 0; i < own_; ++i)
      t.crossing_point[first + i] = Vec3(lattice.origin + lattice.spacing * (low + point_[i]));
    for (std::size_t i = 0, end; i < own_; i = end) {  // in runs of one part
      const std::uint16_t number = parts_.of_crossing[i];
      Vec3 least = t.crossing_point[first + i], most = least;
      for (end = i + 1; end < own_ && parts_.of_crossing[end] == number; ++end) {
        least = glm::min(least, t.crossing_point[first + end]);
        most = glm::max(most, t.crossing_point[first + end]);
      }
      parts_.part[number].box.add(DVec3(least));
      parts_.part[number].box.add(DVec3(most));
    }
  }

  const std::array<int, 12> slots_ = slots_of_cell();
  const CellShape* const shapes_ = &shape(0);  // all of them
  BrickParts parts_;
  const float* value_ = nullptr;
  std::array<std::uint16_t, kEdges> number_;  // of the crossing on an edge, where there is one
  std::vector<DVec3> point_;                  // per crossing
  std::vector<std::uint16_t> slot_, parent_;
  std::vector<Index> part_of_root_;
  std::size_t own_ = 0;
};

/// Whether all that PartFinder asks of a brick, its upper neighbours' crossings included, is as it was for brick `old`.
bool parts_stay(const BrickLattice& lattice, const LatticeTopology& before, const LatticeTopology& t, std::size_t brick,
                Index old) {
  for (int i = 0; i < 8; ++i) {
    const Index neighbour = t.upper[brick][i], was = before.upper[old][i];
    if (neighbour == kNone ? was != kNone : same_as(lattice, before, neighbour) != was || was == kNone) return false;
  }
  return true;
}

void find_parts(const BrickLattice& lattice, LatticeTopology& before, LatticeTopology& t) {
  t.parts.resize(lattice.brick_count());
  tbb::enumerable_thread_specific<PartFinder> finder;
  for_bricks(t.parts.size(), [&](std::size_t b) {
    if (t.first_cell[b] == t.first_cell[b + 1]) return;
    const Index old = same_as(lattice, before, b);
    if (old == kNone || !parts_stay(lattice, before, t, b, old)) {
      t.parts[b] = finder.local().find(lattice, t, static_cast<Index>(b));
      return;
    }
    t.parts[b] = std::move(before.parts[old]);
    std::copy_n(before.crossing_point.begin() + before.crossings[old].first, t.parts[b].of_crossing.size(),
                t.crossing_point.begin() + t.crossings[b].first);
  });
}

/// Makes pieces of the bricks' parts.
void join_parts(const BrickLattice& lattice, LatticeTopology& t) {
  const std::vector<BrickParts>& bricks = t.parts;
  std::vector<Index> first(bricks.size() + 1, 0);
  for (std::size_t b = 0; b < bricks.size(); ++b) first[b + 1] = first[b] + static_cast<Index>(bricks[b].part.size());
  Sets sets(first.back());
  for (std::size_t b = 0; b < bricks.size(); ++b)
    for (const BrickParts::Link& link : bricks[b].link) {
      const Index other = t.upper[b][link.neighbour];
      sets.join(first[b] + link.part, first[other] + bricks[other].of_crossing[link.crossing]);
    }
  std::vector<Index> piece(first.back());
  for (std::size_t b = 0; b < bricks.size(); ++b)
    for (Index k = 0; k < bricks[b].part.size(); ++k) {
      const Index root = sets.find(first[b] + k);  // no later than the part itself
      if (root == first[b] + k) {
        piece[root] = static_cast<Index>(t.euler.size());
        t.euler.push_back(0);
        t.volume.push_back(0.0);
        t.box.emplace_back();
      }
      const Index p = piece[first[b] + k] = piece[root];
      const BrickParts::Part& part = bricks[b].part[k];
      const int height = kCells * (lattice.coordinate[b].z - lattice.coordinate.front().z);
      t.euler[p] += part.euler;
      t.volume[p] += (part.volume + height * part.shadow) * std::pow(lattice.spacing, 3);
      t.box[p].add(part.box);
    }
  for_bricks(bricks.size(), [&](std::size_t b) {
    const auto piece_of = [&](std::uint16_t part) { return piece[first[b] + part]; };
    const BrickParts& parts = bricks[b];
    std::transform(parts.of_patch.begin(), parts.of_patch.end(), t.piece.begin() + t.first_patch[t.first_cell[b]],
                   piece_of);
    std::transform(parts.of_crossing.begin(), parts.of_crossing.end(), t.crossing_piece.begin() + t.crossings[b].first,
                   piece_of);
  });
}

/// Triangles of some of the patches, with the piece of every vertex.
struct Triangulation {
  std::vector<Vec3> position;
  std::vector<Index> triangle;
  std::vector<Index> piece;
};

/// Cuts the patches for which is_wanted(brick, patch) holds. `vertex`: 1 for every crossing they use, and one entry
/// more. Vertices are those crossings in order, then the centres of loops in order of their bricks.
template <class Wanted>
Triangulation triangulate(const BrickLattice& lattice, const LatticeTopology& t, const Wanted& is_wanted,
                          std::vector<Index> vertex) {
  const std::size_t bricks = lattice.brick_count();
  std::vector<Index> first_triangle(bricks + 1, 0), first_centre(bricks + 1, 0);
  for_bricks(bricks, [&](std::size_t b) {
    for (Index at = t.first_cell[b]; at < t.first_cell[b + 1]; ++at) {
      const CellShape& s = shape(t.shape[at]);
      for (int l = 0; l < s.loops; ++l) {
        if (!is_wanted(b, t.first_patch[at] + l)) continue;
        first_triangle[b] += static_cast<Index>(triangle_count(s, t.tunnel[at], l));
        first_centre[b] += static_cast<Index>(extra_count(s, t.tunnel[at], l));
      }
    }
  });
  Triangulation out;
  std::vector<std::uint8_t> used(t.crossing_piece.size());
  for (std::size_t c = 0; c < used.size(); ++c) used[c] = vertex[c] != 0;
  const Index crossings = offsets_from_counts(vertex);
  const Index triangles = offsets_from_counts(first_triangle);
  const std::size_t vertices = std::size_t{crossings} + offsets_from_counts(first_centre);
  out.triangle.resize(std::size_t{triangles} * 3);
  out.position.resize(vertices);
  out.piece.resize(vertices);
  tbb::parallel_for(std::size_t{0}, used.size(), [&](std::size_t c) {
    if (!used[c]) return;
    out.position[vertex[c]] = t.crossing_point[c];
    out.piece[vertex[c]] = t.crossing_piece[c];
  });
  for_bricks(bricks, [&](std::size_t b) {
    std::size_t corner = std::size_t{first_triangle[b]} * 3;
    Index centre = crossings + first_centre[b];
    if (first_triangle[b] == first_triangle[b + 1]) return;
    for (Index at = t.first_cell[b]; at < t.first_cell[b + 1]; ++at) {
      bool wanted = false;
      for (Index patch = t.first_patch[at]; patch < t.first_patch[at + 1]; ++patch) wanted |= is_wanted(b, patch);
      if (!wanted) continue;
      const std::array<Index, 12> crossing = cell_crossings(lattice, t, static_cast<Index>(b), at);
      const CellSurface surface = surface_in_cell(t, at, crossing);
      std::array<Index, 4> extra{};
      for (int i = 0; i < surface.extras; ++i) {
        const Index patch = t.first_patch[at] + surface.loop_of_extra[i];
        if (!is_wanted(b, patch)) continue;
        extra[i] = centre;
        out.position[centre] = Vec3(surface.extra[i]);
        out.piece[centre++] = t.piece[patch];
      }
      for (int k = 0; k < surface.triangles; ++k) {
        if (!is_wanted(b, t.first_patch[at] + surface.loop_of_triangle[k])) continue;
        for (const std::uint8_t c : surface.triangle[k])
          out.triangle[corner++] = c < 12 ? vertex[crossing[c]] : extra[c - 12];
      }
    }
  });
  return out;
}

}  // namespace

std::pair<Index, Index> LatticeTopology::patches(Index brick, int cell_in_brick) const {
  const auto begin = cell.begin() + first_cell[brick], end = cell.begin() + first_cell[brick + 1];
  const auto found = std::lower_bound(begin, end, cell_in_brick);
  if (found == end || *found != cell_in_brick) return {0, 0};
  const auto at = found - cell.begin();
  return {first_patch[at], first_patch[at + 1]};
}

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

LatticeTopology lattice_topology(const BrickLattice& lattice, LatticeTopology before) {
  LatticeTopology t;
  find_cells_and_crossings(lattice, before, t);
  fill_cells(lattice, before, t);
  find_parts(lattice, before, t);
  join_parts(lattice, t);
  return t;
}

TriangleMesh marching_cubes(const BrickLattice& lattice, const LatticeTopology& t,
                            const std::vector<std::uint8_t>& wanted, Index next_id,
                            std::vector<Index>* piece_of_vertex) {
  const auto is_wanted = [&](Index piece) { return wanted.empty() || wanted[piece]; };
  std::vector<Index> vertex(t.crossing_piece.size() + 1, 0);
  for (std::size_t c = 0; c < t.crossing_piece.size(); ++c) vertex[c] = is_wanted(t.crossing_piece[c]);
  Triangulation soup = triangulate(
      lattice, t, [&](std::size_t, Index patch) { return is_wanted(t.piece[patch]); }, std::move(vertex));

  TriangleMesh mesh;
  mesh.vertex = std::move(soup.triangle);
  mesh.vertices.resize(soup.position.size());
  mesh.vertices.rest = soup.position;
  mesh.vertices.position = std::move(soup.position);
  std::iota(mesh.vertices.id.begin(), mesh.vertices.id.end(), next_id);
  mesh.next_id = next_id + static_cast<Index>(mesh.vertex_count());
  link_twins(mesh);
  if (piece_of_vertex) *piece_of_vertex = std::move(soup.piece);
  return mesh;
}

OpenSurface marching_cubes_open(const BrickLattice& lattice, const LatticeTopology& t,
                                const std::vector<std::uint8_t>& wanted_brick) {
  std::vector<Index> vertex(t.crossing_piece.size() + 1, 0);
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    if (!wanted_brick[b]) return;
    for (Index at = t.first_cell[b]; at < t.first_cell[b + 1]; ++at)
      for (const Index c : cell_crossings(lattice, t, static_cast<Index>(b), at))
        if (c != kNone) std::atomic_ref(vertex[c]).store(1, std::memory_order_relaxed);  // bricks share crossings
  });
  Triangulation soup = triangulate(
      lattice, t, [&](std::size_t b, Index) { return wanted_brick[b] != 0; }, std::move(vertex));
  return {std::move(soup.position), std::move(soup.triangle), std::move(soup.piece)};
}

}  // namespace isoskin
