// Headless OpenGL rasterizer of triangle meshes: float32 images of depth, position, normal, coverage and rest position.
#pragma once

#include <span>

#include "core/mesh/triangle_mesh.h"
#include "render/camera.h"
#include "render/image.h"

namespace isoskin {

struct RasterizeOptions {
  bool wire = false;        // also write the channel `wire`, for shade()'s wireframe
  double noise_size = 0.0;  // also write the channel `noise`: fractal_noise(rest / noise_size); 0: do not
};

/// The mesh seen through the camera: channels A, Z, P, N, rest, back and, on request, wire and noise (see Image). One
/// sample a pixel, at its centre; visibility is OpenGL's, to 1/256 pixel; attributes are those of the triangle where
/// the centre's ray meets it. N interpolates `normals` (one a vertex; empty: area-weighted triangle normals). Both
/// sides of triangles are drawn; open meshes are welcome, twins are not looked at. Same input and driver, same bytes.
/// Throws InputError: no OpenGL (GlCurrent), mesh larger than the driver's buffers, bad camera; std::invalid_argument
/// when the number of normals is neither 0 nor the number of vertices.
Image rasterize(const TriangleMesh& mesh, std::span<const Vec3> normals, const Camera& camera,
                const RasterizeOptions& options = {});

/// Unit vertex normals, triangles weighted by their area; zero where they cancel.
std::vector<Vec3> area_weighted_normals(const TriangleMesh& mesh);

}  // namespace isoskin
