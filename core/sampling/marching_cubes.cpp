#include "core/sampling/marching_cubes.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <memory>
#include <numeric>
#include <stdexcept>
#include <string>

#include <tbb/blocked_range.h>
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

void find_cells_and_crossings(const BrickLattice& lattice, LatticeTopology& t) {
  const std::size_t bricks = lattice.brick_count();
  t.first_cell.assign(bricks + 1, 0);
  t.crossings.resize(bricks);
  t.upper.resize(bricks);
  t.signs.resize(bricks);
  for_bricks(bricks, [&](std::size_t b) {
    for (int i = 0; i < 8; ++i)
      t.upper[b][i] =
          i == 0 ? static_cast<Index>(b) : lattice.find(lattice.coordinate[b] + IVec3(i >> 2, i >> 1 & 1, i & 1));
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

void fill_cells(const BrickLattice& lattice, LatticeTopology& t) {
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    if (t.first_cell[b] == t.first_cell[b + 1]) return;
    const float* value = &lattice.value[b * kValues];
    const BrickSigns& signs = t.signs[b];
    Index at = t.first_cell[b];
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

void place_crossings(const BrickLattice& lattice, LatticeTopology& t) {
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    const float* value = &lattice.value[b * kValues];
    Index at = t.crossings[b].first;
    for (int word = 0; word < 24; ++word)
      for (std::uint64_t bits = t.crossings[b].mask[word]; bits; bits &= bits - 1) {
        const int axis = word / 8, bit = std::countr_zero(bits);
        const IVec3 low(word % 8, bit / 8, bit % 8);
        IVec3 high = low;
        ++high[axis];
        const double p = value[BrickLattice::corner_index(low)], q = value[BrickLattice::corner_index(high)];
        DVec3 point(lattice.coordinate[b] * kCells + low);
        point[axis] += crossing_fraction(p, q);
        t.crossing_point[at++] = Vec3(lattice.origin + lattice.spacing * point);
      }
  });
}

IVec3 cell_corner(int cell) {
  return {cell / (kCells * kCells), cell / kCells % kCells, cell % kCells};
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
    if (c == kNone) {
      const IVec3 where = lattice.coordinate[brick];
      throw std::invalid_argument("the surface leaves the lattice at brick (" + std::to_string(where.x) + ", " +
                                  std::to_string(where.y) + ", " + std::to_string(where.z) + ")");
    }
    crossing[s.edge[k]] = c;
  }
  return crossing;
}

/// Disjoint sets whose representative is always the smallest member, so the outcome does not depend on scheduling.
class Sets {
public:
  explicit Sets(std::size_t n) : parent_(std::make_unique<std::atomic<Index>[]>(n)) {
    tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) { parent_[i].store(static_cast<Index>(i), relaxed); });
  }
  Index find(Index a) const {
    for (;;) {
      const Index p = parent_[a].load(relaxed);
      if (p == a) return a;
      const Index up = parent_[p].load(relaxed);
      if (up != p) parent_[a].store(up, relaxed);  // halves the path; a stale `up` is still an ancestor
      a = p;
    }
  }
  void join(Index a, Index b) {
    for (;;) {
      a = find(a);
      b = find(b);
      if (a == b) return;
      if (a < b) std::swap(a, b);
      Index expected = a;
      if (parent_[a].compare_exchange_strong(expected, b, relaxed)) return;
    }
  }

private:
  static constexpr auto relaxed = std::memory_order_relaxed;
  std::unique_ptr<std::atomic<Index>[]> parent_;
};

CellSurface surface_in_cell(const LatticeTopology& t, Index at, const std::array<Index, 12>& crossing) {
  CellCrossings point;
  for (int e = 0; e < 12; ++e)
    if (crossing[e] != kNone) point[e] = DVec3(t.crossing_point[crossing[e]]);
  return cell_surface(shape(t.shape[at]), t.tunnel[at], point);
}

/// Adds six times the signed volumes between the triangles of a cell's loops and the point `apex` to volume[loop].
void add_volumes(const LatticeTopology& t, Index at, const std::array<Index, 12>& crossing, const DVec3& apex,
                 double* volume) {
  const CellSurface surface = surface_in_cell(t, at, crossing);
  for (int k = 0; k < surface.triangles; ++k) {
    const auto corner = [&](int i) {
      const int c = surface.triangle[k][i];
      return (c < 12 ? DVec3(t.crossing_point[crossing[c]]) : surface.extra[c - 12]) - apex;
    };
    volume[surface.loop_of_triangle[k]] += glm::dot(corner(0), glm::cross(corner(1), corner(2)));
  }
}

void join_patches(const BrickLattice& lattice, LatticeTopology& t, std::vector<double>& volume_of_patch) {
  Sets sets(t.crossing_point.size());
  std::vector<Index> some_crossing(t.piece.size());
  const DVec3 apex = lattice.brick_count() ? lattice.point(lattice.coordinate.front() * kCells) : DVec3(0.0);
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    for (Index at = t.first_cell[b]; at < t.first_cell[b + 1]; ++at) {
      const CellShape& s = shape(t.shape[at]);
      const std::array<Index, 12> crossing = cell_crossings(lattice, t, static_cast<Index>(b), at);
      for (int l = 0; l < s.loops; ++l) {
        const Index first = crossing[s.edge[s.first[l]]];
        for (int k = s.first[l] + 1; k < s.first[l + 1]; ++k) sets.join(first, crossing[s.edge[k]]);
        some_crossing[t.first_patch[at] + l] = first;
      }
      if (t.tunnel[at]) sets.join(crossing[s.edge[s.first[0]]], crossing[s.edge[s.first[1]]]);
      add_volumes(t, at, crossing, apex, &volume_of_patch[t.first_patch[at]]);
    }
  });
  tbb::parallel_for(std::size_t{0}, t.crossing_piece.size(), [&](std::size_t c) {
    t.crossing_piece[c] = sets.find(static_cast<Index>(c));  // the set, for now
  });
  std::vector<Index> piece_of_set(t.crossing_point.size(), kNone);
  Index pieces = 0;
  for (std::size_t p = 0; p < t.piece.size(); ++p) {
    Index& piece = piece_of_set[t.crossing_piece[some_crossing[p]]];
    if (piece == kNone) piece = pieces++;
    t.piece[p] = piece;
  }
  tbb::parallel_for(std::size_t{0}, t.crossing_piece.size(),
                    [&](std::size_t c) { t.crossing_piece[c] = piece_of_set[t.crossing_piece[c]]; });
  t.euler.assign(pieces, 0);
  t.volume.assign(pieces, 0.0);
  t.box.assign(pieces, Box{});
}

void measure_pieces(LatticeTopology& t, const std::vector<double>& volume_of_patch) {
  // Every crossing lies on four patches and has four segments, each shared by two of them: V - E + F = F - V.
  for (std::size_t p = 0; p < t.piece.size(); ++p) {
    ++t.euler[t.piece[p]];
    t.volume[t.piece[p]] += volume_of_patch[p];
  }
  for (std::size_t at = 0; at < t.tunnel.size(); ++at)  // an annulus instead of two discs
    if (t.tunnel[at]) t.euler[t.piece[t.first_patch[at]]] -= 2;
  for (std::size_t c = 0; c < t.crossing_piece.size(); ++c) {
    --t.euler[t.crossing_piece[c]];
    t.box[t.crossing_piece[c]].add(DVec3(t.crossing_point[c]));
  }
  for (double& v : t.volume) v /= 6.0;
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

LatticeTopology lattice_topology(const BrickLattice& lattice) {
  LatticeTopology t;
  find_cells_and_crossings(lattice, t);
  fill_cells(lattice, t);
  place_crossings(lattice, t);
  std::vector<double> volume_of_patch(t.piece.size());
  join_patches(lattice, t, volume_of_patch);
  measure_pieces(t, volume_of_patch);
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
