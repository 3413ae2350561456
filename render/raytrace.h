// Reference images by Embree: of the field itself, and of a mesh. Same camera, same channels as the rasterizer.
#pragma once

#include <span>

#include "core/mesh/triangle_mesh.h"
#include "render/camera.h"
#include "render/image.h"
#include "render/surface_boxes.h"

namespace isoskin {

struct RaytraceOptions {
  SurfaceBoxOptions boxes;
  double shortest =
      1e-3;  // of a box's side: pieces of ray this short are judged by the signs at their ends (not grids)
};

struct RaytraceReport {
  std::size_t boxes = 0;        // that bound the surface; triangles of a mesh
  std::size_t hits = 0;         // pixels
  std::size_t evaluations = 0;  // of F by rays
  std::size_t bounds = 0;       // of F over pieces of rays
  std::size_t elements = 0;     // of skeletons that all those had to ask; 0 for other fields
  double build_ms = 0.0;        // finding boxes and building Embree's hierarchy
  double trace_ms = 0.0;
};

struct Raytraced {
  Image image;
  RaytraceReport report;
};

/// The surface F = 0 through the camera: channels A, Z, P, N = -grad F / |grad F| and back (see Image), from the first
/// change of sign of F on the ray through each pixel's centre, beyond the camera's near depth. Grid fields are solved
/// exactly, cell by cell, as polynomials along the ray; others by bisection between bounds (ray_root.h). Parallel by
/// rows; the same bytes whatever the number of threads. Throws InputError: bad camera.
Raytraced raytrace(const Field& field, const Camera& camera, const RaytraceOptions& options = {});

/// The same, within `boxes` only.
Raytraced raytrace(const Field& field, const SurfaceBoxes& boxes, const Camera& camera,
                   const RaytraceOptions& options = {});

/// The triangles of a mesh: channels A, Z, P, N (interpolated `normals`; empty: area-weighted), rest and back. Throws
/// InputError: bad camera; std::invalid_argument: number of normals.
Raytraced raytrace(const TriangleMesh& mesh, std::span<const Vec3> normals, const Camera& camera);

}  // namespace isoskin
