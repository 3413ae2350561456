#include "core/sampling/marching_cubes.h"

#include <algorithm>
#include <atomic>
#include <numeric>

#include "core/sampling/cell_shapes.h"
#include "core/sampling/cell_surface.h"
#include "core/sampling/surface_bricks.h"

namespace isoskin {
namespace {

using sampling::cell_corner;
using sampling::for_bricks;
using sampling::for_each_crossing;
using sampling::for_each_surface_cell;
using sampling::offsets_from_counts;

constexpr int kCells = BrickLattice::kCells;

/// Crossing numbers of the edges of one surface cell's loops.
std::array<Index, 12> cell_crossings(const LatticeTopology& t, Index brick, const SurfaceCell& cell) {
  const CellShape& s = shape(cell.shape);
  std::array<Index, 12> crossing;
  crossing.fill(kNone);
  for (int k = 0; k < s.first[s.loops]; ++k) {
    const CellEdge e = cell_edge(s.edge[k]);
    const IVec3 corner = cell_corner(cell.cell) + IVec3(e.low[0], e.low[1], e.low[2]);
    crossing[s.edge[k]] = t.crossing(brick, corner, e.axis);
  }
  return crossing;
}

/// A crossing's point in world units, the same whichever brick is asked.
Vec3 crossing_point(const BrickLattice& lattice, Index brick, const IVec3& corner, int axis) {
  const float* const value = &lattice.value[std::size_t{brick} * BrickLattice::kValues];
  const IVec3 whole = lattice.coordinate[brick] * kCells + corner, in_brick = whole & (kCells - 1);
  DVec3 point(in_brick);
  point[axis] += sampling::crossing_place(value, corner, axis);
  return Vec3(lattice.origin + lattice.spacing * (DVec3(whole - in_brick) + point));
}

CellSurface surface_in_cell(const BrickLattice& lattice, Index brick, const SurfaceCell& cell) {
  const CellShape& s = shape(cell.shape);
  CellCrossings point;
  for (int k = 0; k < s.first[s.loops]; ++k) {
    const CellEdge e = cell_edge(s.edge[k]);
    const IVec3 corner = cell_corner(cell.cell) + IVec3(e.low[0], e.low[1], e.low[2]);
    point[s.edge[k]] = DVec3(crossing_point(lattice, brick, corner, e.axis));
  }
  return cell_surface(s, cell.tunnel, point);
}

/// Cuts the patches for which is_wanted(brick, patch) holds, by the patch's number in the brick. `fresh`: 1 for every
/// crossing they use that has no position yet, and one entry more. New positions are those crossings in order, then the
/// centres of loops in order of their bricks.
template <class Wanted>
void triangulate(const BrickLattice& lattice, const LatticeTopology& t, const Wanted& is_wanted,
                 std::vector<Index> fresh, OpenSurface& out) {
  const std::size_t bricks = lattice.brick_count();
  std::vector<Index> first_triangle(bricks + 1, 0), first_centre(bricks + 1, 0);
  for_bricks(bricks, [&](std::size_t b) {
    if (t.parts[b].part.empty()) return;
    for_each_surface_cell(t, b, [&](const SurfaceCell& cell) {
      const CellShape& s = shape(cell.shape);
      for (int l = 0; l < s.loops; ++l) {
        if (!is_wanted(b, cell.first_patch + l)) continue;
        first_triangle[b] += static_cast<Index>(triangle_count(s, cell.tunnel, l));
        first_centre[b] += static_cast<Index>(extra_count(s, cell.tunnel, l));
      }
    });
  });
  const std::size_t corners_before = out.triangle.size();
  const Index before = static_cast<Index>(out.position.size());
  const Index crossings = before + offsets_from_counts(fresh);
  const Index triangles = offsets_from_counts(first_triangle);
  const std::size_t vertices = std::size_t{crossings} + offsets_from_counts(first_centre);
  out.triangle.resize(corners_before + std::size_t{triangles} * 3);
  out.position.resize(vertices);
  out.piece.resize(vertices);
  out.of_crossing.resize(t.crossing_count, kNone);
  for_bricks(bricks, [&](std::size_t b) {
    const Index first = t.crossings[b].first;
    if (fresh[first] == fresh[first + t.crossings[b].size()]) return;
    for_each_crossing(t.crossings[b], [&](Index number, const IVec3& corner, int axis) {
      const Index c = first + number;
      if (fresh[c] == fresh[c + 1]) return;
      const Index v = out.of_crossing[c] = before + fresh[c];
      out.position[v] = crossing_point(lattice, static_cast<Index>(b), corner, axis);
      out.piece[v] = t.piece_of_crossing(static_cast<Index>(b), number);
    });
  });
  for_bricks(bricks, [&](std::size_t b) {
    std::size_t corner = corners_before + std::size_t{first_triangle[b]} * 3;
    Index centre = crossings + first_centre[b];
    if (first_triangle[b] == first_triangle[b + 1]) return;
    for_each_surface_cell(t, b, [&](const SurfaceCell& cell) {
      bool wanted = false;
      for (Index patch = 0; patch < cell.patches; ++patch) wanted |= is_wanted(b, cell.first_patch + patch);
      if (!wanted) return;
      const std::array<Index, 12> crossing = cell_crossings(t, static_cast<Index>(b), cell);
      const CellSurface surface = surface_in_cell(lattice, static_cast<Index>(b), cell);
      std::array<Index, 4> extra{};
      for (int i = 0; i < surface.extras; ++i) {
        const Index patch = cell.first_patch + surface.loop_of_extra[i];
        if (!is_wanted(b, patch)) continue;
        extra[i] = centre;
        out.position[centre] = Vec3(surface.extra[i]);
        out.piece[centre++] = t.piece_of_patch(static_cast<Index>(b), patch);
      }
      for (int k = 0; k < surface.triangles; ++k) {
        if (!is_wanted(b, cell.first_patch + surface.loop_of_triangle[k])) continue;
        for (const std::uint8_t c : surface.triangle[k])
          out.triangle[corner++] = c < 12 ? out.of_crossing[crossing[c]] : extra[c - 12];
      }
    });
  });
}

}  // namespace

TriangleMesh marching_cubes(const BrickLattice& lattice, const LatticeTopology& t,
                            const std::vector<std::uint8_t>& wanted, Index next_id,
                            std::vector<Index>* piece_of_vertex) {
  const auto is_wanted = [&](Index piece) { return wanted.empty() || wanted[piece]; };
  std::vector<Index> vertex(std::size_t{t.crossing_count} + 1, 0);
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    const Index crossings = t.crossings[b].size();
    for (Index n = 0; n < crossings; ++n)
      vertex[t.crossings[b].first + n] = is_wanted(t.piece_of_crossing(static_cast<Index>(b), n));
  });
  OpenSurface soup;
  triangulate(
      lattice, t, [&](std::size_t b, Index patch) { return is_wanted(t.piece_of_patch(static_cast<Index>(b), patch)); },
      std::move(vertex), soup);

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

void add_bricks(const BrickLattice& lattice, const LatticeTopology& t, const std::vector<std::uint8_t>& wanted_brick,
                OpenSurface& surface) {
  std::vector<Index> fresh(std::size_t{t.crossing_count} + 1, 0);
  const auto is_known = [&](Index c) { return !surface.of_crossing.empty() && surface.of_crossing[c] != kNone; };
  for_bricks(lattice.brick_count(), [&](std::size_t b) {
    if (!wanted_brick[b]) return;
    for_each_surface_cell(t, b, [&](const SurfaceCell& cell) {
      for (const Index c : cell_crossings(t, static_cast<Index>(b), cell))
        if (c != kNone && !is_known(c))
          std::atomic_ref(fresh[c]).store(1, std::memory_order_relaxed);  // bricks share crossings
    });
  });
  triangulate(
      lattice, t, [&](std::size_t b, Index) { return wanted_brick[b] != 0; }, std::move(fresh), surface);
}

}  // namespace isoskin
