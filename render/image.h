// Images of named float32 channels, as OpenEXR files and 8-bit PNG previews (design 10).
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// Channel names the renderers write, the ones stock OpenEXR tools know. A pixel nothing covers holds A = 0, Z = +inf
/// and zeros elsewhere.
///   A            coverage: 1 where the ray through the pixel centre meets the surface, else 0
///   Z            depth: distance from the eye measured along the view axis, world units
///   P.X P.Y P.Z  position of the first hit, world units
///   N.X N.Y N.Z  outward unit normal
///   rest.X/Y/Z   rest position, the tracked texture coordinate (meshes only)
///   back         1 where the surface is seen from behind: ray . geometric normal > 0
///   noise        Perlin noise of the rest position, 0 to 1 (the rasterizer's noise option only)
///   wire         distance to the nearest edge of the hit triangle, pixels (the rasterizer's wireframe option only)
///   shadow       share of the key light that is hidden (shadow.h)
///   R G B        shaded, linear, premultiplied by coverage
struct Image {
  int width = 0, height = 0;
  std::map<std::string, std::vector<float>> channel;  // width * height floats each, row by row from the top
  float unit = 0.0f;             // what depth errors are told in: the field's voxel, or e; world units; 0: not known
  float depth_tolerance = 0.0f;  // units by which a mesh and its field may differ in depth; 0: not known

  std::size_t pixels() const { return static_cast<std::size_t>(width) * height; }
  bool has(const std::string& name) const { return channel.contains(name); }
  /// Adds a channel, or refills one that is there.
  std::vector<float>& add(const std::string& name, float fill = 0.0f);
  /// Throws InputError naming the channel when it is missing.
  const std::vector<float>& at(const std::string& name) const;
  std::vector<float>& at(const std::string& name);
};

/// Three channels NAME.X, NAME.Y, NAME.Z of an image read as vectors. Throws InputError when one is missing.
struct VectorChannels {
  VectorChannels(const Image& image, const std::string& name);
  Vec3 operator[](std::size_t pixel) const { return {(*x)[pixel], (*y)[pixel], (*z)[pixel]}; }
  const std::vector<float>*x, *y, *z;
};

/// Writes every channel as 32-bit float (ZIP compressed scanlines), atomically; unit and depth_tolerance as attributes
/// `isoskin.unit` and `isoskin.depth_tolerance`. Throws InputError naming the file when
/// it cannot be written; std::invalid_argument when a channel's size is not width * height.
void save_exr(const std::filesystem::path& path, const Image& image, const std::string& comments = "");

/// Reads the flat scanline or tiled image of any OpenEXR file; half and integer channels become float. Throws
/// InputError naming the file when it is missing, truncated or not such an image.
Image load_exr(const std::filesystem::path& path);

struct PngOptions {
  std::array<float, 3> top{0.235f, 0.275f, 0.325f};     // linear colour behind the picture at its top
  std::array<float, 3> bottom{0.035f, 0.040f, 0.050f};  // and at its bottom
  bool palette = false;  // at most 256 colours, channels rounded to as many bits as that takes: a quarter the size
};

/// 8-bit sRGB picture of R, G, B (linear, premultiplied by A; opaque when there is no A) over a vertical gradient.
/// Atomic. Throws InputError: channel missing, file cannot be written.
void save_png(const std::filesystem::path& path, const Image& image, const PngOptions& options = {});

/// R, G, B, A averaged over factor x factor pixels, for antialiased previews. Other channels have no meaningful average
/// and are left out. Throws std::invalid_argument when the factor is not positive or does not divide the size.
Image downsample(const Image& image, int factor);

}  // namespace isoskin
