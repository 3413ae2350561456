// Joins the mesh about holes and the patches that close them.
#pragma once

#include <optional>
#include <vector>

#include "core/topology/holes.h"

namespace isoskin {

struct Weld {
  TriangleMesh mesh;
  Index first_new_vertex = 0;  // vertices that stay come first, in their order
};

/// The mesh without its removed triangles (one byte a triangle), its border edges subdivided along the seams' paths,
/// and the filling's triangles with inside != 0. New vertices get fresh ids, age 1, rest = position and no velocity.
/// `snapped` as lay_seams() returns it. Nothing when the result would not be a closed, oriented 2-manifold.
std::optional<Weld> weld(const TriangleMesh& mesh, const std::vector<std::uint8_t>& removed,
                         const std::vector<Seam>& seams, const Filling& filling,
                         const std::vector<std::uint8_t>& inside, const std::vector<Index>& snapped);

}  // namespace isoskin
