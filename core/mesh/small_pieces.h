// Pieces so small that they are kept as they are: neither split, coarsened nor relaxed, only projected. Elements that
// are pressed to half their size on a sphere fold over, and a tetrahedron turns itself inside out.
#pragma once

#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

inline constexpr int kSmallPiece = 8;  // triangles: an octahedron
/// An octahedron with edges longer than this, in units of e, should be cut in four times as many triangles: on a
/// sphere they then have edges of about e.
inline constexpr double kSmallPieceEdge = 1.6;

/// True when the connected piece of halfedge h has at most kSmallPiece triangles.
bool is_small_piece(const TriangleMesh& mesh, Index h);

/// The vertices of all small pieces, ascending. Parallel.
std::vector<Index> small_piece_vertices(const TriangleMesh& mesh);

/// Of those with one of these triangles.
std::vector<Index> small_piece_vertices(const TriangleMesh& mesh, const std::vector<Index>& triangles);

}  // namespace isoskin
