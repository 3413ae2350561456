// Droplets and bubbles that outgrow the octahedron they were born as.
#pragma once

#include "core/backend.h"
#include "core/mesh/mesh_part.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Cuts every triangle of a small piece (core/mesh/small_pieces.h) in four, and its new vertices are projected, while
/// its edges are longer than 1.6 e on average (`edge_length`, world units); at most three times. A droplet that grows
/// fast would else be an octahedron for frames, far off the surface. The backend must hold the field. Returns the
/// pieces that were cut. Pieces of which `open` has all frozen stay.
std::size_t grow_small_pieces(TriangleMesh& mesh, Backend& backend, const ProjectOptions& project, double edge_length,
                              const OpenSet& open = {});

}  // namespace isoskin
