// Where a skin's vertices go from one frame to the next, and what material they carry (design 3, predict).
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/mechanics/flow.h"
#include "core/mesh/mesh_part.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Moves every vertex by its motion over `dt` seconds and projects it onto `field`, the backend's current one. With
/// `velocity` (of the time arrived at, world units a second) the motion is a step of Heun's method from the vertex's
/// own velocity to the grid's; without it the surface's flow (flow.h). A vertex whose prediction finds no surface is
/// projected from where it was. Afterwards the velocity column holds the motion made where there is no grid (zero where
/// a vertex found no surface, or dt is 0): what a vertex slides later, when the skin relaxes, is not the surface's.
///
/// Vertices that `open` has frozen stay where they are, their velocity becomes zero, and where all vertices about one
/// are frozen nothing is computed.
void predict(TriangleMesh& mesh, const VelocityField* velocity, double dt, const Field& field, Backend& backend,
             const ProjectOptions& options, const OpenSet& open = {}, const FlowOptions& flow = {});

/// -grad F / |grad F| of the field the backend holds, zero where the gradient vanishes. As Backend::vertex_normals()
/// but for rounding, without a mesh that would have to be made resident first.
std::vector<Vec3> outward_normals(const std::vector<Vec3>& points, Backend& backend);

/// The velocity column from the grid, at every vertex.
void sample_velocities(TriangleMesh& mesh, const VelocityField& velocity);

/// The velocity column -F_t grad F / |grad F|^2 with F_t from the field `next` that comes `dt` seconds later (> 0),
/// where F is the field the backend holds: what a first frame's vertices know of their motion.
void estimate_velocities(TriangleMesh& mesh, const Field& next, double dt, Backend& backend);

/// Vertices have slid from `before` (one position a vertex) while the material stood still: each takes the rest
/// position of the material it has come to lie on, by linear interpolation in the triangle about it that it slid into.
void slide_rest(TriangleMesh& mesh, const std::vector<Vec3>& before);

}  // namespace isoskin
