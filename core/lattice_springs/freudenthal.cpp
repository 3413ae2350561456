#include "core/lattice_springs/freudenthal.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include <tbb/parallel_sort.h>

#include "core/parallel.h"
#include "core/sampling/brick_signs.h"
#include "core/sampling/segment_roots.h"

namespace isoskin {
namespace {

using Key = std::uint64_t;  // of a lattice corner, sorting by x, y, z

constexpr int kBits = 21;

Key key_of(const IVec3& corner) {
  const IVec3 c = corner + IVec3(1 << (kBits - 1));
  return Key(c.x) << 2 * kBits | Key(c.y) << kBits | Key(c.z);
}

IVec3 corner_of(Key key) {
  constexpr Key kMask = (Key{1} << kBits) - 1;
  return IVec3(int(key >> 2 * kBits), int(key >> kBits & kMask), int(key & kMask)) - IVec3(1 << (kBits - 1));
}

/// The six orders in which a path from the low to the high corner takes its axes; the first three are even.
constexpr int kPaths[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};

/// Local corners (0 or 1 on each axis) of tetrahedron `path` of a cube, of positive orientation.
std::array<IVec3, 4> cube_tetrahedron(int path) {
  std::array<IVec3, 4> corner{};
  for (int k = 0; k < 3; ++k) {
    corner[k + 1] = corner[k];
    corner[k + 1][kPaths[path][k]] = 1;
  }
  if (path >= 3) std::swap(corner[1], corner[2]);
  return corner;
}

struct SignedCorner {
  Key key;
  bool inside;
};

/// Calls function(four signed corners) for each tetrahedron between the sides in a brick.
template <class Function>
void for_each_crossed(const BrickLattice& lattice, Index brick, const Function& function) {
  const float* value = &lattice.value[std::size_t(brick) * BrickLattice::kValues];
  const BrickSigns signs(value);
  for (int x = 0; x < BrickLattice::kCells; ++x)
    for (int y = 0; y < BrickLattice::kCells; ++y)
      for (unsigned cells = signs.surface_cells(x, y); cells; cells &= cells - 1)
        for (int path = 0; path < 6; ++path) {
          const std::array<IVec3, 4> local = cube_tetrahedron(path);
          std::array<SignedCorner, 4> corner;
          int in = 0;
          for (int k = 0; k < 4; ++k) {
            const IVec3 c = IVec3(x, y, std::countr_zero(cells)) + local[k];
            corner[k] = {key_of(BrickLattice::kCells * lattice.coordinate[brick] + c),
                         value[BrickLattice::corner_index(c)] > 0.0f};
            in += corner[k].inside;
          }
          if (in > 0 && in < 4) function(corner);
        }
}

template <class T>
void sort_unique(std::vector<T>& items) {
  tbb::parallel_sort(items);
  items.erase(std::unique(items.begin(), items.end()), items.end());
}

/// Even orders of a tetrahedron's corners that bring corner k to the front.
constexpr int kAlone[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 3, 0, 1}, {3, 2, 1, 0}};
/// Even orders that bring the two corners of a mask (bits) to the front.
constexpr struct {
  unsigned mask;
  int order[4];
} kPairs[6] = {{0b0011, {0, 1, 2, 3}}, {0b0101, {0, 2, 3, 1}}, {0b1001, {0, 3, 1, 2}},
               {0b0110, {1, 2, 0, 3}}, {0b1010, {1, 3, 2, 0}}, {0b1100, {2, 3, 0, 1}}};

/// Cosine of a triangle's smallest angle.
double largest_cosine(const Vec3& a, const Vec3& b, const Vec3& c) {
  const auto cosine = [](const DVec3& at, const DVec3& p, const DVec3& q) {
    const double lengths = glm::length(p - at) * glm::length(q - at);
    return lengths > 0.0 ? glm::dot(p - at, q - at) / lengths : 1.0;
  };
  const DVec3 x(a), y(b), z(c);
  return std::max({cosine(x, y, z), cosine(y, z, x), cosine(z, x, y)});
}

void add_quad(SimplexSurface& surface, const std::array<Index, 4>& q) {
  const auto cost = [&](int i, int j, int k) {
    return largest_cosine(surface.position[q[i]], surface.position[q[j]], surface.position[q[k]]);
  };
  if (std::max(cost(0, 1, 2), cost(0, 2, 3)) <= std::max(cost(0, 1, 3), cost(1, 2, 3)))
    surface.triangle.insert(surface.triangle.end(), {q[0], q[1], q[2], q[0], q[2], q[3]});
  else
    surface.triangle.insert(surface.triangle.end(), {q[0], q[1], q[3], q[1], q[2], q[3]});
}

}  // namespace

FreudenthalComplex intersecting_complex(const BrickLattice& lattice) {
  FreudenthalComplex complex;
  complex.spacing = lattice.spacing;
  std::vector<Key> keys;
  for (Index b = 0; b < lattice.brick_count(); ++b)
    for_each_crossed(lattice, b, [&](const std::array<SignedCorner, 4>& corner) {
      for (const SignedCorner& c : corner) keys.push_back(c.key);
    });
  sort_unique(keys);
  complex.node.resize(keys.size());
  complex.inside.resize(keys.size());
  complex.fixed.assign(keys.size(), 0);
  for_each_index(keys.size(), [&](std::size_t i) { complex.node[i] = Vec3(lattice.point(corner_of(keys[i]))); });
  for (Index b = 0; b < lattice.brick_count(); ++b)
    for_each_crossed(lattice, b, [&](const std::array<SignedCorner, 4>& corner) {
      std::array<Index, 4> t{};
      for (int k = 0; k < 4; ++k) {
        t[k] = Index(std::lower_bound(keys.begin(), keys.end(), corner[k].key) - keys.begin());
        complex.inside[t[k]] = corner[k].inside;
      }
      complex.tetrahedron.push_back(t);
    });
  for (const std::array<Index, 4>& t : complex.tetrahedron)
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) complex.edge.push_back({std::min(t[i], t[j]), std::max(t[i], t[j])});
  sort_unique(complex.edge);
  return complex;
}

BrickLattice lattice_of_box(const Box& box, double spacing, Backend& backend) {
  constexpr int kSide = BrickLattice::kCorners;
  BrickLattice lattice;
  lattice.origin = box.low;
  lattice.spacing = spacing;
  const IVec3 bricks(glm::ceil(box.size() / (BrickLattice::kCells * spacing) - 1e-9));
  for (int x = 0; x < bricks.x; ++x)
    for (int y = 0; y < bricks.y; ++y)
      for (int z = 0; z < bricks.z; ++z) lattice.coordinate.emplace_back(x, y, z);
  std::vector<Vec3> points(lattice.brick_count() * BrickLattice::kValues);
  for_each_index(points.size(), [&](std::size_t i) {
    const int local = int(i % BrickLattice::kValues);
    const IVec3 corner(local / (kSide * kSide), local / kSide % kSide, local % kSide);
    points[i] = Vec3(lattice.point(BrickLattice::kCells * lattice.coordinate[i / BrickLattice::kValues] + corner));
  });
  lattice.value.resize(points.size());
  backend.evaluate(points, lattice.value, {});
  lattice.build_index();
  return lattice;
}

void hold_border(FreudenthalComplex& complex, const BrickLattice& lattice) {
  Box box;
  for (const IVec3& c : lattice.coordinate) {
    box.add(lattice.point(BrickLattice::kCells * c));
    box.add(lattice.point(BrickLattice::kCells * (c + 1)));
  }
  const double near = 0.25 * lattice.spacing;
  for_each_index(complex.node.size(), [&](std::size_t i) {
    for (int a = 0; a < 3; ++a) {
      const double p = complex.node[i][a];
      if (p < box.low[a] + near || p > box.high[a] - near) complex.fixed[i] |= std::uint8_t(1 << a);
    }
  });
}

SimplexSurface march_simplices(const FreudenthalComplex& complex, Backend& backend) {
  constexpr float kLeast = 1e-3f;  // of an edge
  std::vector<Index> crossing(complex.edge.size(), kNone);
  std::vector<SegmentRoot> roots;
  for (std::size_t e = 0; e < complex.edge.size(); ++e) {
    const auto [a, b] = complex.edge[e];
    if (complex.inside[a] == complex.inside[b]) continue;
    crossing[e] = Index(roots.size());
    roots.push_back({complex.node[a], complex.node[b]});
  }
  find_roots(roots, backend);
  SimplexSurface surface;
  for (SegmentRoot& r : roots) {
    r.t = std::clamp(r.t, kLeast, 1.0f - kLeast);
    surface.position.push_back(r.point());
  }
  for (const std::array<Index, 4>& t : complex.tetrahedron) {
    const auto at = [&](int i, int j) {
      const std::array<Index, 2> e{std::min(t[i], t[j]), std::max(t[i], t[j])};
      return crossing[std::size_t(std::lower_bound(complex.edge.begin(), complex.edge.end(), e) -
                                  complex.edge.begin())];
    };
    unsigned mask = 0;
    for (int k = 0; k < 4; ++k) mask |= unsigned(complex.inside[t[k]]) << k;
    const int in = std::popcount(mask);
    if (in == 2) {
      for (const auto& [pair, o] : kPairs)
        if (pair == mask) add_quad(surface, {at(o[0], o[2]), at(o[0], o[3]), at(o[1], o[3]), at(o[1], o[2])});
      continue;
    }
    const int* o = kAlone[std::countr_zero(in == 1 ? mask : ~mask & 0xfu)];
    std::array<Index, 3> corner{at(o[0], o[1]), at(o[0], o[2]), at(o[0], o[3])};
    if (in == 3) std::swap(corner[1], corner[2]);
    surface.triangle.insert(surface.triangle.end(), corner.begin(), corner.end());
  }
  return surface;
}

}  // namespace isoskin
