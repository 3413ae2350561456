// Keeps edges near the wanted length: parallel split, collapse and flip with locks (design 4, 5; Bouthors-Nesme 2.5).
#pragma once

#include <cstddef>

#include "core/backend.h"
#include "core/mesh/mesh_part.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct AlterOptions {
  float edge_length = 1.0f;  // e, world units
  float shortest = 0.8f;     // e_min: collapse below this times e, unless being stretched
  float longest = 1.333f;    // e_max: split above this times e, unless being compressed
  float rate =
      0.1f;          // eps_e: an edge is being stretched (compressed) when it changes by more than this times e a frame
  float dt = 0.04f;  // seconds a frame, to turn the velocity column into a change of length
  bool respect_locks = true;  // vertices of age 0 are left alone
  // About new skin: of a collapsed edge the older vertex (the lower id) goes on, and edges with one frozen end may be
  // collapsed too, onto it. Else the id is that of either end.
  bool keep_older = false;
  bool flip = true;          // better-shaped, more regular diagonals where normals allow
  float max_flip_turn = 45;  // degrees: no flip across a sharper crease, none that turns a triangle's normal further
  float max_collapse_turn = 60;  // degrees a surviving triangle's normal may turn in a collapse
};

struct AlterReport {
  std::size_t splits = 0, collapses = 0, flips = 0;
};

/// One pass of splits, then collapses, then flips, each in rounds on independent sets chosen by geometry and ids alone;
/// the result does not depend on the number of threads. Vertices touched (made, moved, or of a flipped edge's quad) get
/// age 0. Keeps a closed, oriented 2-manifold; refuses a collapse that breaks the link condition, turns a triangle too
/// far or makes an edge too long, and the split of an inverted triangle's edge (`inverted`: one byte a triangle, may be
/// empty), and to make a piece smaller than an octahedron (core/mesh/small_pieces.h). A collapse goes to the middle, or
/// to an end where the middle does harm. A flip must lower  sum over triangles (cot A + cot B + cot C) / sqrt 3  +  0.3
/// sum over vertices (valence - 6)^2. The first sum alone is least for Delaunay triangulations (Rippa 1990); valence is
/// what limits the angles relaxation can reach. One sum that only falls cannot oscillate.
/// `frozen` (one byte a vertex, may be empty): edges, and quads, with a frozen vertex are left alone, whatever the
/// ages, but see keep_older. `among`, if given and not all, is a set in which no less is open; it goes on with the
/// edits.
AlterReport alter(TriangleMesh& mesh, const AlterOptions& options, const std::vector<std::uint8_t>& inverted = {},
                  const std::vector<std::uint8_t>& frozen = {}, OpenSet* among = nullptr);

}  // namespace isoskin
