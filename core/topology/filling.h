// What a local re-skin fills holes with: the lattice's surface about them, to be cut along seams.
#pragma once

#include <span>
#include <tuple>
#include <vector>

#include "core/backend.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin {

/// A part of the lattice's surface, with the neighbourhoods and normals that seams need. Grows: see catch_up().
struct Filling {
  struct Edge {
    Index to, triangle;  // the triangle with the halfedge to `to`; kNone on the outside of the filling's border
    bool operator<(const Edge& other) const { return to != other.to ? to < other.to : triangle < other.triangle; }
  };

  OpenSurface surface;
  std::vector<Vec3> normal;  // of the field, outward, at every position
  std::vector<Index> first;  // per vertex: its first edge in `edge`, which has gaps
  std::vector<Index> count;  // per vertex: of its edges, which are sorted
  std::vector<Edge> edge;
  std::vector<Index> twin;  // per halfedge, numbered as those of a TriangleMesh; kNone at the border

  std::size_t triangle_count() const { return surface.triangle.size() / 3; }
  std::span<const Edge> edges(Index v) const { return {edge.data() + first[v], count[v]}; }
  /// The triangle with the halfedge, kNone where there is none.
  Index triangle(Index from, Index to) const;

  /// The surface has been added to: brings the rest up to it. The backend must hold the field.
  void catch_up(Backend& backend);

private:
  void make_room_for_edges(Index first_halfedge);
  void link_twins(Index first_halfedge);
};

/// Outward unit normals of the field, zero where the gradient vanishes.
std::vector<Vec3> field_normals(const std::vector<Vec3>& points, Backend& backend);

/// Finds paths on a filling's edges. Keeps its memory from one path to the next, also while the filling grows.
class PathFinder {
public:
  explicit PathFinder(const Filling& filling) : filling_(filling) {}

  /// The shortest from a to b that keeps near the straight line and off `used` vertices (b may be one); at most `slack`
  /// longer than the line. Empty when there is none.
  std::vector<Index> path(Index a, Index b, const std::vector<std::uint8_t>& used, float slack);

private:
  // The least that the whole path may cost, what it has cost so far, vertex, where it came from.
  using Entry = std::tuple<float, float, Index, Index>;

  const Filling& filling_;
  std::vector<Index> came_from_;  // of vertices seen in this search
  std::vector<Index> seen_in_;    // per vertex: the last search that saw it
  Index search_ = 0;
  std::vector<Entry> open_;  // a heap
};

}  // namespace isoskin
