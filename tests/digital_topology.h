// An oracle that never sees a mesh: pieces, cavities and handles of {F > 0} counted on a dense lattice of signs by
// labelling and Euler characteristics of voxel sets (design 12).
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/field/field.h"

namespace isoskin {

struct DigitalTopology {
  int components = 0;  // pieces of the inside, voxels joined at corners
  int cavities = 0;    // pieces of the outside that do not reach the border, joined across faces
  int euler = 0;       // of the union of closed inside voxels; handles = components + cavities - euler
  int handles() const { return components + cavities - euler; }
};

namespace digital {

struct Lattice {
  IVec3 size{0};
  std::vector<std::uint8_t> inside;
  std::size_t index(int x, int y, int z) const { return (std::size_t(x) * size.y + y) * size.z + z; }
  bool at(int x, int y, int z) const {
    return x >= 0 && y >= 0 && z >= 0 && x < size.x && y < size.y && z < size.z && inside[index(x, y, z)];
  }
};

inline Lattice sample(const Field& field, const Box& box, double spacing) {
  Lattice lattice;
  lattice.size = IVec3(glm::ceil(box.size() / spacing)) + 3;
  lattice.inside.resize(std::size_t(lattice.size.x) * lattice.size.y * lattice.size.z);
  for (int x = 0; x < lattice.size.x; ++x)
    for (int y = 0; y < lattice.size.y; ++y)
      for (int z = 0; z < lattice.size.z; ++z)
        lattice.inside[lattice.index(x, y, z)] = field.value(box.low + spacing * DVec3(x - 1, y - 1, z - 1)) > 0.0;
  return lattice;
}

/// Pieces of the voxels for which `wanted` holds; with `corners` voxels that touch at a corner hang together.
/// `open_border`: pieces that reach the border are not counted.
inline int pieces(const Lattice& lattice, bool wanted, bool corners, bool skip_border) {
  std::vector<std::uint8_t> seen(lattice.inside.size(), 0);
  int count = 0;
  std::vector<IVec3> stack;
  for (int x = 0; x < lattice.size.x; ++x)
    for (int y = 0; y < lattice.size.y; ++y)
      for (int z = 0; z < lattice.size.z; ++z) {
        if (seen[lattice.index(x, y, z)] || lattice.at(x, y, z) != wanted) continue;
        bool border = false;
        stack.assign(1, IVec3(x, y, z));
        seen[lattice.index(x, y, z)] = 1;
        while (!stack.empty()) {
          const IVec3 p = stack.back();
          stack.pop_back();
          for (int a = -1; a <= 1; ++a)
            for (int b = -1; b <= 1; ++b)
              for (int c = -1; c <= 1; ++c) {
                if (!corners && std::abs(a) + std::abs(b) + std::abs(c) != 1) continue;
                const IVec3 q = p + IVec3(a, b, c);
                if (glm::any(glm::lessThan(q, IVec3(0))) || glm::any(glm::greaterThanEqual(q, lattice.size))) {
                  border = true;
                  continue;
                }
                const std::size_t i = lattice.index(q.x, q.y, q.z);
                if (seen[i] || bool(lattice.inside[i]) != wanted) continue;
                seen[i] = 1;
                stack.push_back(q);
              }
        }
        count += !(border && skip_border);
      }
  return count;
}

/// Euler characteristic of the union of closed inside voxels: vertices - edges + faces - cubes.
inline int euler(const Lattice& lattice) {
  int sum = 0;
  for (int x = 0; x <= lattice.size.x; ++x)
    for (int y = 0; y <= lattice.size.y; ++y)
      for (int z = 0; z <= lattice.size.z; ++z) {
        // Cells of the complex whose lowest corner is lattice corner (x,y,z): one of each kind per set of axes.
        for (int axes = 0; axes < 8; ++axes) {
          bool touched = false;
          for (int a = 0; a <= ((axes & 1) ? 0 : 1) && !touched; ++a)
            for (int b = 0; b <= ((axes & 2) ? 0 : 1) && !touched; ++b)
              for (int c = 0; c <= ((axes & 4) ? 0 : 1) && !touched; ++c) touched = lattice.at(x - a, y - b, z - c);
          if (touched) sum += (__builtin_popcount(unsigned(axes)) % 2) ? -1 : 1;
        }
      }
  return sum;
}

}  // namespace digital

inline DigitalTopology digital_topology(const Field& field, const Box& box, double spacing) {
  const digital::Lattice lattice = digital::sample(field, box, spacing);
  DigitalTopology topology;
  topology.components = digital::pieces(lattice, true, true, false);
  topology.cavities = digital::pieces(lattice, false, false, true);
  topology.euler = digital::euler(lattice);
  return topology;
}

}  // namespace isoskin
