// Pairs of triangles that are near to each other or overlap: how collisions and self-intersections are found (design 8;
// Nesme-Bouthors 4.1, which compares all pairs).
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// True when the closed triangles share a point; exact for finite float32 coordinates, so touching and coplanar ones
/// are always decided alike. A triangle without area is its longest edge; two of those are never said to overlap.
bool triangles_overlap(const std::array<Vec3, 3>& a, const std::array<Vec3, 3>& b);

/// Two triangles of a mesh, a < b.
struct TrianglePair {
  Index a = kNone, b = kNone;
  auto operator<=>(const TrianglePair&) const = default;
};

/// What the broad phase did.
struct PairStatistics {
  std::size_t entries = 0;     // triangles listed in grid cells
  std::size_t candidates = 0;  // pairs whose boxes overlap and which share no vertex
};

/// Closed, axis-aligned.
struct FlatBox {
  Vec3 low, high;
};

/// Of a triangle.
FlatBox box_of(const std::array<Vec3, 3>& corners);

/// Of a number, always the same; called from any thread, several times.
using BoxOf = std::function<FlatBox(Index)>;

/// The pairs of `count` boxes, by their numbers, that overlap when grown as in near_pairs() and are `wanted`,
/// ascending.
std::vector<TrianglePair> near_boxes(std::size_t count, const BoxOf& box_of, double margin,
                                     const std::function<bool(const TrianglePair&)>& wanted,
                                     PairStatistics* statistics = nullptr);

/// The pairs without a common vertex whose bounding boxes, grown by `margin` / 2 to every side, overlap and that are
/// `wanted`, ascending. A uniform grid of cells about as wide as two triangles, rebuilt on every call: time and memory
/// grow with the triangles and the pairs found, as long as triangles have about one size. Parallel (`wanted` is called
/// from any thread); the result does not depend on the number of threads.
std::vector<TrianglePair> near_pairs(const TriangleMesh& mesh, double margin,
                                     const std::function<bool(const TrianglePair&)>& wanted,
                                     PairStatistics* statistics = nullptr);

/// The pairs without a common vertex that overlap, ascending.
std::vector<TrianglePair> overlapping_pairs(const TriangleMesh& mesh, PairStatistics* statistics = nullptr);

/// Number of self-intersections: overlapping pairs of triangles without a common vertex.
std::size_t count_self_intersections(const TriangleMesh& mesh);

/// The three corners of triangle t.
std::array<Vec3, 3> corners_of(const TriangleMesh& mesh, Index t);

/// Whether triangles a and b do.
bool share_a_vertex(const TriangleMesh& mesh, Index a, Index b);

}  // namespace isoskin
