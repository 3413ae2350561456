// Lattices from dense arrays of corner values, and the topology of their signs by labelling: an oracle that never saw a
// patch or a triangle.
#pragma once

#include <functional>
#include <numeric>
#include <vector>

#include "core/sampling/brick_lattice.h"

namespace isoskin::dense {

/// (8 n + 1)^3 corner values of n^3 bricks.
struct Values {
  int bricks = 1;
  int corners = 9;
  std::vector<float> value;

  explicit Values(int n) : bricks(n), corners(8 * n + 1), value(std::size_t(corners) * corners * corners, -1.0f) {}
  Values(int n, const std::function<float(const IVec3&)>& f) : Values(n) {
    for (std::size_t i = 0; i < value.size(); ++i) value[i] = f(corner(i));
  }
  std::size_t index(const IVec3& c) const { return (std::size_t(c.x) * corners + c.y) * corners + c.z; }
  IVec3 corner(std::size_t i) const {
    const auto n = std::size_t(corners);
    return {int(i / (n * n)), int(i / n % n), int(i % n)};
  }
  float at(const IVec3& c) const { return value[index(c)]; }
  bool on_border(const IVec3& c) const {
    for (int a = 0; a < 3; ++a)
      if (c[a] == 0 || c[a] == corners - 1) return true;
    return false;
  }
};

/// Corner (0,0,0) of the values becomes the low corner of `first_brick`.
inline BrickLattice to_lattice(const Values& v, double spacing = 1.0, const DVec3& origin = DVec3(0.0),
                               const IVec3& first_brick = IVec3(0)) {
  BrickLattice lattice;
  lattice.origin = origin;
  lattice.spacing = spacing;
  for (int x = 0; x < v.bricks; ++x)
    for (int y = 0; y < v.bricks; ++y)
      for (int z = 0; z < v.bricks; ++z) {
        lattice.coordinate.push_back(first_brick + IVec3(x, y, z));
        for (int i = 0; i < BrickLattice::kValues; ++i)
          lattice.value.push_back(v.at(8 * IVec3(x, y, z) + IVec3(i / 81, i / 9 % 9, i % 9)));
      }
  lattice.build_index();
  return lattice;
}

struct Labelling {
  std::vector<std::size_t> label;  // per corner: a member of its set
  int inside = 0, outside = 0;     // sets
};

/// Sets of corners of one sign that hang together: along lattice edges, and across a face's diagonal where the bilinear
/// interpolant at the face's saddle has that sign (a saddle value of 0 is outside).
inline Labelling label(const Values& v) {
  std::vector<std::size_t> parent(v.value.size());
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  const auto find = [&](std::size_t a) {
    while (parent[a] != a) a = parent[a] = parent[parent[a]];
    return a;
  };
  const auto join = [&](const IVec3& a, const IVec3& b) { parent[find(v.index(a))] = find(v.index(b)); };
  const auto in = [&](const IVec3& c) { return v.at(c) > 0; };
  for (std::size_t i = 0; i < v.value.size(); ++i) {
    const IVec3 c = v.corner(i);
    for (int a = 0; a < 3; ++a) {
      IVec3 e(0), f(0);
      e[a] = 1;
      f[(a + 1) % 3] = 1;
      if (c[a] + 1 >= v.corners) continue;
      if (in(c) == in(c + e)) join(c, c + e);
      if (c[(a + 1) % 3] + 1 >= v.corners) continue;
      const double p = v.at(c), q = v.at(c + e), r = v.at(c + f), s = v.at(c + e + f);
      if (in(c) != in(c + e + f) || in(c + e) != in(c + f) || in(c) == in(c + e)) continue;
      const bool saddle_inside = (p * s - q * r) / (p + s - q - r) > 0;
      if (saddle_inside == in(c))
        join(c, c + e + f);
      else
        join(c + e, c + f);
    }
  }
  Labelling out;
  out.label.resize(v.value.size());
  for (std::size_t i = 0; i < parent.size(); ++i) {
    out.label[i] = find(i);
    if (out.label[i] == i) ++(v.value[i] > 0 ? out.inside : out.outside);
  }
  return out;
}

/// Euler characteristic of the inside when no face joins two inside corners across its diagonal: corners, edges, faces
/// and cells wholly inside, alternately; a ring of six around two opposite outside corners is filled.
inline long long euler_of_separated_inside(const Values& v) {
  long long chi = 0;
  for (std::size_t i = 0; i < v.value.size(); ++i) {
    const IVec3 c = v.corner(i);
    for (int span = 0; span < 8; ++span) {
      const IVec3 size(span & 1, span >> 1 & 1, span >> 2);
      if (glm::any(glm::greaterThanEqual(c + size, IVec3(v.corners)))) continue;
      int in = 0, all = 0;
      bool opposite_out = false;
      for (int k = 0; k < 8; ++k) {
        const IVec3 d(k & 1, k >> 1 & 1, k >> 2);
        if (glm::any(glm::greaterThan(d, size))) continue;
        ++all;
        in += v.at(c + d) > 0;
        opposite_out |= !(v.at(c + d) > 0) && !(v.at(c + size - d) > 0);
      }
      const int sign = (size.x + size.y + size.z) % 2 ? -1 : 1;
      if (in == all) chi += sign;
      if (all == 8 && in == 6 && opposite_out) ++chi;
    }
  }
  return chi;
}

}  // namespace isoskin::dense
