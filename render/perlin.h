// Improved noise (Perlin 2002), as a C++ function and as the GLSL function that the rasterizer's shader calls.
#pragma once

#include <array>

#include "core/types.h"

namespace isoskin {

/// Perlin's permutation of 0..255, twice over.
extern const std::array<std::uint32_t, 512> kPerlinPermutation;

/// Gradient noise, about -1 to 1, 0 at points of the integer lattice, C2, of period 256 along each axis.
float perlin_noise(const Vec3& p);

/// Four octaves of it, stretched to fill 0 to 1: what the noise pattern mixes its two colours by.
float fractal_noise(const Vec3& p);

/// The same two functions in GLSL 4.5; they read the permutation from `uint permutation[]`.
extern const char* const kPerlinShader;

}  // namespace isoskin
