// Soft shadows of a mesh on itself, for pictures.
#pragma once

#include "core/mesh/triangle_mesh.h"
#include "render/camera.h"
#include "render/image.h"

namespace isoskin {

struct ShadowOptions {
  int samples = 10;       // rays a pixel
  double softness = 4.0;  // half the angle under which the light is seen, degrees
};

/// Adds the channel `shadow`, which shade() then uses: the share of the key light that the mesh hides from each covered
/// pixel's P, by Embree rays spread over the light. Deterministic. Throws InputError: channels A, P or N missing, bad
/// camera; std::invalid_argument when camera and image differ in size.
void add_shadows(Image& image, const TriangleMesh& mesh, const Camera& camera, const ShadowOptions& options = {});

}  // namespace isoskin
