#include "core/sampling/ambiguous_faces.h"

#include <algorithm>
#include <array>
#include <bit>

#include <tbb/parallel_for.h>

#include "core/sampling/brick_signs.h"
#include "core/sampling/cell_shapes.h"
#include "core/sampling/cell_surface.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;

struct Face {
  IVec3 corner;  // of the lattice, its low one
  int axis;
  std::array<float, 4> value;  // at the low corner, one along the next axis, one along the axis after that, both
};

void add_faces(const BrickLattice& lattice, std::size_t brick, std::vector<Face>& out) {
  const float* value = &lattice.value[brick * BrickLattice::kValues];
  const BrickSigns signs(value);
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

/// Crosswise signs, so the denominator is not zero and the saddle lies within the face.
DVec3 saddle(const BrickLattice& lattice, const Face& f) {
  const double p = f.value[0], q = f.value[1], r = f.value[2], s = f.value[3];
  const double bend = p - q - r + s;
  DVec3 at(f.corner);
  at[(f.axis + 1) % 3] += std::clamp((p - r) / bend, 0.0, 1.0);
  at[(f.axis + 2) % 3] += std::clamp((p - q) / bend, 0.0, 1.0);
  return lattice.origin + lattice.spacing * at;
}

/// Does a tunnel lead through this cell of mixed signs?
bool is_tunnel(const BrickLattice& lattice, const Field& field, const IVec3& cell, const std::array<float, 8>& v) {
  const CellShape& s = shape(find_shape(lattice, cell, v));
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
  for (const double t : {0.25, 0.5, 0.75}) {
    const DVec3 at = DVec3(cell) + neck->from + t * (neck->to - neck->from);
    if ((field.value(lattice.origin + lattice.spacing * at) > 0.0) != neck->outside) return false;
  }
  return true;
}

}  // namespace

void resolve_ambiguous_faces(BrickLattice& lattice, const Field& field) {
  std::vector<std::vector<BrickLattice::Face>> found(lattice.brick_count());
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t b) {
    std::vector<Face> faces;
    add_faces(lattice, b, faces);
    for (const Face& f : faces)
      found[b].push_back({BrickLattice::face_key(f.corner, f.axis), field.value(saddle(lattice, f)) > 0.0});
  });
  lattice.face.clear();
  for (const auto& f : found) lattice.face.insert(lattice.face.end(), f.begin(), f.end());
  const auto by_key = [](const BrickLattice::Face& a, const BrickLattice::Face& b) { return a.key < b.key; };
  std::sort(lattice.face.begin(), lattice.face.end(), by_key);
  const auto same = [](const BrickLattice::Face& a, const BrickLattice::Face& b) { return a.key == b.key; };
  lattice.face.erase(std::unique(lattice.face.begin(), lattice.face.end(), same), lattice.face.end());
}

void resolve_tunnels(BrickLattice& lattice, const Field& field) {
  std::vector<std::vector<std::uint64_t>> found(lattice.brick_count());
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t b) {
    const float* value = &lattice.value[b * BrickLattice::kValues];
    const BrickSigns signs(value);
    for (int x = 0; x < kCells; ++x)
      for (int y = 0; y < kCells; ++y)
        for (unsigned cells = signs.surface_cells(x, y); cells; cells &= cells - 1) {
          const IVec3 at(x, y, std::countr_zero(cells));
          std::array<float, 8> v;
          for (int c = 0; c < 8; ++c)
            v[c] = value[((x + (c & 1)) * kCorners + y + (c >> 1 & 1)) * kCorners + at.z + (c >> 2)];
          const IVec3 cell = lattice.coordinate[b] * kCells + at;
          if (is_tunnel(lattice, field, cell, v)) found[b].push_back(BrickLattice::face_key(cell, 3));
        }
  });
  lattice.tunnel.clear();
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
