#include "core/sampling/ambiguous_faces.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "core/parallel.h"
#include "core/sampling/cell_surface.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;

void add_faces(const BrickLattice& lattice, const BrickSigns& signs, std::size_t brick,
               std::vector<CrosswiseFace>& out) {
  if (!signs.mixed()) return;
  const float* value = &lattice.value[brick * BrickLattice::kValues];
  constexpr std::array<int, 3> stride{kCorners * kCorners, kCorners, 1};
  for (int axis = 0; axis < 3; ++axis)
    for (int x = 0; x < (axis == 0 ? kCorners : kCells); ++x)
      for (int y = 0; y < (axis == 1 ? kCorners : kCells); ++y)
        for (unsigned faces = signs.ambiguous_faces(axis, x, y); faces; faces &= faces - 1) {
          const IVec3 at(x, y, std::countr_zero(faces));
          const float* v = value + (at.x * kCorners + at.y) * kCorners + at.z;
          const int u = stride[(axis + 1) % 3], w = stride[(axis + 2) % 3];
          out.push_back({lattice.coordinate[brick] * kCells + at, axis, {v[0], v[u], v[w], v[u + w]}});
        }
}

/// F on a finer lattice in a cell or (flat along one axis) a face, and which of its points hang together: along fine
/// edges, and across fine faces whose signs lie crosswise where the asymptotic decider joins them.
class FinePoints {
public:
  static constexpr int kParts = 4;  // of a lattice edge

  template <class Value>
  FinePoints(const IVec3& parts, const Value& value) : side_(parts + 1) {
    for (int x = 0; x < side_.x; ++x)
      for (int y = 0; y < side_.y; ++y)
        for (int z = 0; z < side_.z; ++z) value_[index({x, y, z})] = value(IVec3(x, y, z));
  }

  /// Is there a way between two points of one sign?
  bool joined(const IVec3& from, const IVec3& to) {
    inside_ = at(from) > 0.0;
    seen_.fill(false);
    open_.assign(1, from);
    seen_[index(from)] = true;
    while (!open_.empty()) {
      const IVec3 p = open_.back();
      open_.pop_back();
      if (p == to) return true;
      for (int a = 0; a < 3; ++a)
        for (const int i : {-1, 1}) {
          enter(p, a, i);
          for (const int j : {-1, 1}) enter_across(p, a, i, (a + 1) % 3, j);
        }
    }
    return false;
  }

private:
  static constexpr int kSide = kParts + 1;
  static int index(const IVec3& p) { return (p.x * kSide + p.y) * kSide + p.z; }
  double at(const IVec3& p) const { return value_[index(p)]; }
  bool wanted(const IVec3& p) const { return (at(p) > 0.0) == inside_; }

  static IVec3 moved(IVec3 p, int axis, int by) {
    p[axis] += by;
    return p;
  }
  bool within(const IVec3& p) const {
    return glm::all(glm::greaterThanEqual(p, IVec3(0))) && glm::all(glm::lessThan(p, side_));
  }
  void add(const IVec3& p) {
    if (!std::exchange(seen_[index(p)], true)) open_.push_back(p);
  }
  void enter(const IVec3& p, int axis, int by) {
    const IVec3 q = moved(p, axis, by);
    if (within(q) && wanted(q)) add(q);
  }
  void enter_across(const IVec3& p, int a, int i, int b, int j) {
    const IVec3 u = moved(p, a, i), w = moved(p, b, j), q = moved(u, b, j);
    if (!within(q) || !wanted(q) || wanted(u) || wanted(w)) return;
    const double own = at(p) * at(q), other = at(u) * at(w);
    if (inside_ ? own > other : own >= other) add(q);
  }

  IVec3 side_;
  std::array<double, kSide * kSide * kSide> value_;
  std::array<bool, kSide * kSide * kSide> seen_;
  std::vector<IVec3> open_;
  bool inside_ = false;
};

/// Drops entries of faces and cells that a stale brick has, or that no brick has any more; all where `stale` is empty.
template <class Entry, class Key>
void keep_fresh(const BrickLattice& lattice, std::vector<Entry>& entries, const std::vector<std::uint8_t>& stale,
                const Key& key) {
  if (stale.empty()) return entries.clear();
  std::erase_if(entries, [&](const Entry& entry) {
    const IVec3 corner = BrickLattice::corner_of(key(entry));
    const int axis = int(key(entry) & 3);
    IVec3 below = corner;
    if (axis < 3) --below[axis];
    bool somewhere = false;
    for (const IVec3& cell : {corner, below}) {
      const Index b = lattice.find(cell >> 3);
      if (b != kNone && stale[b]) return true;
      somewhere |= b != kNone;
    }
    return !somewhere;
  });
}

/// The corners of a lattice cell, in parts of an edge.
IVec3 fine_corner(int c) {
  return FinePoints::kParts * IVec3(c & 1, c >> 1 & 1, c >> 2 & 1);
}
bool is_corner(const IVec3& p) {
  return p.x % FinePoints::kParts == 0 && p.y % FinePoints::kParts == 0 && p.z % FinePoints::kParts == 0;
}

/// The saddle of F that lies in the cell and joins inside to inside (or outside to outside), by Newton's method on the
/// gradient from a point of the cell (in cells from its low corner).
std::optional<DVec3> saddle_within(const BrickLattice& lattice, const Field& field, const IVec3& cell, DVec3 at,
                                   bool joins_inside) {
  constexpr int kSteps = 8;
  constexpr double kLongest = 0.25, kClose = 1e-4;  // of the cell's edge
  if (!field.is_c2()) return {};
  for (int step = 0; step < kSteps; ++step) {
    const DVec3 p = lattice.origin + lattice.spacing * (DVec3(cell) + at);
    const DMat3 hessian = field.hessian(p);
    const double determinant = glm::determinant(hessian);
    // One positive eigenvalue of three joins inside: an even number of negative ones and a positive determinant.
    if (!std::isfinite(determinant) || determinant == 0.0) return {};
    DVec3 move = -(glm::inverse(hessian) * field.sample(p).gradient) / lattice.spacing;
    const double length = glm::length(move);
    if (!std::isfinite(length)) return {};
    if (length < kClose) return (determinant > 0.0) == joins_inside ? std::optional(p) : std::nullopt;
    if (length > kLongest) move *= kLongest / length;
    at += move;
    if (glm::any(glm::lessThan(at, DVec3(0.0))) || glm::any(glm::greaterThan(at, DVec3(1.0)))) return {};
  }
  return {};
}

/// The end of a loop's first edge that lies on the given side.
int corner_behind(const CellShape& s, int loop, const std::array<float, 8>& v, bool inside) {
  const CellEdge e = cell_edge(s.edge[s.first[loop]]);
  const int low = e.low[0] | e.low[1] << 1 | e.low[2] << 2;
  return (v[low] > 0.0f) == inside ? low : low | 1 << e.axis;
}

}  // namespace

bool inside_joined(const BrickLattice& lattice, const Field& field, const CrosswiseFace& f) {
  constexpr int n = FinePoints::kParts;
  const int u = (f.axis + 1) % 3, w = (f.axis + 2) % 3;
  IVec3 parts(n);
  parts[f.axis] = 0;
  FinePoints points(parts, [&](const IVec3& p) {
    if (is_corner(p)) return double(f.value[(p[u] ? 1 : 0) + (p[w] ? 2 : 0)]);
    return field.value(lattice.origin + lattice.spacing * (DVec3(f.corner) + DVec3(p) / double(n)));
  });
  IVec3 far_u(0), far_w(0);
  far_u[u] = far_w[w] = n;
  return f.value[0] > 0.0f ? points.joined(IVec3(0), far_u + far_w) : points.joined(far_u, far_w);
}

bool is_tunnel(const BrickLattice& lattice, const Field& field, const IVec3& cell, const CellShape& s,
               const std::array<float, 8>& v) {
  if (s.loops != 2) return false;
  CellCrossings crossing;
  for (int k = 0; k < s.first[2]; ++k) {
    const CellEdge e = cell_edge(s.edge[k]);
    const int low = e.low[0] | e.low[1] << 1 | e.low[2] << 2;
    DVec3 at(e.low[0], e.low[1], e.low[2]);
    at[e.axis] += crossing_fraction(v[low], v[low | 1 << e.axis]);
    crossing[s.edge[k]] = at;
  }
  const std::optional<Neck> neck = find_neck(s, crossing);
  if (!neck) return false;
  const bool inside = neck->outside;  // a tunnel is of the side that does not lie between the loops
  if (const auto saddle = saddle_within(lattice, field, cell, 0.5 * (neck->from + neck->to), inside))
    return (field.value(*saddle) > 0.0) == inside;
  FinePoints points(IVec3(FinePoints::kParts), [&](const IVec3& p) {
    if (is_corner(p)) return double(v[(p.x ? 1 : 0) | (p.y ? 2 : 0) | (p.z ? 4 : 0)]);
    return field.value(lattice.origin + lattice.spacing * (DVec3(cell) + DVec3(p) / double(FinePoints::kParts)));
  });
  return points.joined(fine_corner(corner_behind(s, 0, v, inside)), fine_corner(corner_behind(s, 1, v, inside)));
}

void resolve_ambiguous_faces(BrickLattice& lattice, const std::vector<BrickSigns>& signs, const Field& field,
                             const std::vector<std::uint8_t>& stale) {
  std::vector<std::vector<BrickLattice::Face>> found(lattice.brick_count());
  for_each_heavy(found.size(), [&](std::size_t b) {
    if (!stale.empty() && !stale[b]) return;
    std::vector<CrosswiseFace> faces;
    add_faces(lattice, signs[b], b, faces);
    for (const CrosswiseFace& f : faces)
      found[b].push_back({BrickLattice::face_key(f.corner, f.axis), inside_joined(lattice, field, f)});
  });
  keep_fresh(lattice, lattice.face, stale, [](const BrickLattice::Face& f) { return f.key; });
  for (const auto& f : found) lattice.face.insert(lattice.face.end(), f.begin(), f.end());
  const auto by_key = [](const BrickLattice::Face& a, const BrickLattice::Face& b) { return a.key < b.key; };
  std::sort(lattice.face.begin(), lattice.face.end(), by_key);
  const auto same = [](const BrickLattice::Face& a, const BrickLattice::Face& b) { return a.key == b.key; };
  lattice.face.erase(std::unique(lattice.face.begin(), lattice.face.end(), same), lattice.face.end());
}

void resolve_tunnels(BrickLattice& lattice, const std::vector<BrickSigns>& of_brick, const Field& field,
                     const std::vector<std::uint8_t>& stale) {
  std::vector<std::vector<std::uint64_t>> found(lattice.brick_count());
  for_each_heavy(found.size(), [&](std::size_t b) {
    const BrickSigns& signs = of_brick[b];
    if ((!stale.empty() && !stale[b]) || !signs.mixed()) return;
    const float* value = &lattice.value[b * BrickLattice::kValues];
    for (int x = 0; x < kCells; ++x)
      for (int y = 0; y < kCells; ++y)
        for (unsigned cells = signs.surface_cells(x, y); cells; cells &= cells - 1) {
          const IVec3 at(x, y, std::countr_zero(cells));
          const unsigned of_cell = signs.cell_signs(x, y, at.z);
          if (ambiguous_faces(of_cell) == 0 && shape(plain_shape(of_cell)).loops != 2) continue;
          std::array<float, 8> v;
          for (int c = 0; c < 8; ++c)
            v[c] = value[((x + (c & 1)) * kCorners + y + (c >> 1 & 1)) * kCorners + at.z + (c >> 2)];
          const IVec3 cell = lattice.coordinate[b] * kCells + at;
          if (is_tunnel(lattice, field, cell, shape(find_shape(lattice, cell, v)), v))
            found[b].push_back(BrickLattice::face_key(cell, 3));
        }
  });
  keep_fresh(lattice, lattice.tunnel, stale, [](std::uint64_t key) { return key; });
  for (const auto& f : found) lattice.tunnel.insert(lattice.tunnel.end(), f.begin(), f.end());
  std::sort(lattice.tunnel.begin(), lattice.tunnel.end());
}

std::uint16_t find_shape(const BrickLattice& lattice, const IVec3& cell, const std::array<float, 8>& v) {
  unsigned decided = 0, joined = 0;
  for (unsigned faces = lattice.face.empty() ? 0 : ambiguous_faces(v); faces; faces &= faces - 1) {
    const int face = std::countr_zero(faces);
    IVec3 corner = cell;
    corner[face / 2] += face % 2;
    const BrickLattice::Face* known = lattice.find_face(corner, face / 2);
    if (known) decided |= 1u << face;
    if (known && known->joined) joined |= 1u << face;
  }
  return find_shape(v, decided, joined);
}

}  // namespace isoskin
