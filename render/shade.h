// Colours an image of positions and normals; meshes and fields are shaded by the same code.
#pragma once

#include "render/camera.h"
#include "render/image.h"

namespace isoskin {

enum class Pattern : std::uint8_t { plain, checker, noise };  // noise: Perlin's, see render/perlin.h

/// Colours are linear. Lengths of 0 are chosen from the camera: shares of the picture's height at the target.
struct ShadeOptions {
  Pattern pattern = Pattern::plain;    // looked up by rest position (by P where the image has no rest)
  double pattern_size = 0.0;           // side of a checker or of the coarsest noise, world units; 0: 1/18 of the height
  Vec3 color{0.045f, 0.235f, 0.420f};  // plain, and the pattern's first colour
  Vec3 second{0.640f, 0.560f, 0.430f};      // the pattern's second colour
  Vec3 back_color{0.750f, 0.035f, 0.030f};  // where the surface is seen from behind
  double wire_width = 0.0;                  // of the wireframe's lines, pixels; 0: none (needs the channel `wire`)
  Vec3 wire_color{0.015f, 0.020f, 0.030f};
  double occlusion = 0.85;        // strength of screen-space ambient occlusion, 0 to 1
  double occlusion_radius = 0.0;  // how far it reaches, world units; 0: 1/14 of the height
};

/// The side of a checker or of the coarsest noise that the options mean, world units.
double pattern_size(const ShadeOptions& options, const Camera& camera);

/// Adds R, G, B (linear, premultiplied by A) from A, Z, P, N and, where present, rest, back, wire, noise (else it is
/// computed here) and shadow: a soft key light from the upper left of the camera, a fill light, a sky, a rim light and
/// ambient occlusion. Deterministic. Throws InputError: channel missing, bad camera; std::invalid_argument when camera
/// and image differ in size.
void shade(Image& image, const Camera& camera, const ShadeOptions& options = {});

}  // namespace isoskin
