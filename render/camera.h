// The pinhole camera that the rasterizer and the ray tracer share, and its TOML file.
#pragma once

#include <filesystem>

#include "core/types.h"

namespace isoskin {

/// Looks from `eye` to `target`; pixel (0, 0) is the top left one.
struct Camera {
  DVec3 eye{0.0, -5.0, 0.0};
  DVec3 target{0.0};
  DVec3 up{0.0, 0.0, 1.0};  // need not be perpendicular to the view axis
  double fov = 30.0;        // vertical field of view, degrees
  int width = 1024, height = 768;
};

inline constexpr int kMaxImageSide = 4096;  // pixels

/// The camera as rays: orthonormal axes and the picture's half extents at depth 1.
struct CameraRays {
  DVec3 eye;
  DVec3 right, up, forward;
  double half_width, half_height;
  int width, height;
  double near_depth;  // surfaces nearer than this along the view axis are not seen

  /// Direction through the centre of pixel (x, y), scaled so that dot(direction, forward) = 1: the point at depth Z is
  /// eye + Z * direction.
  DVec3 direction(double x, double y) const {
    return forward + (((2.0 * x + 1.0) / width - 1.0) * half_width) * right +
           ((1.0 - (2.0 * y + 1.0) / height) * half_height) * up;
  }
  double depth(const DVec3& point) const { return glm::dot(point - eye, forward); }
  /// Pixel coordinates (fractional, centres at integers) of a point with positive depth.
  glm::dvec2 pixel(const DVec3& point) const;
};

/// Throws InputError saying which value is wrong: not finite, eye at target, up along the view axis, field of view
/// outside (0, 180), size outside 1..kMaxImageSide.
CameraRays camera_rays(const Camera& camera);

struct FramingOptions {
  DVec3 from{-0.52, -0.80, 0.42};  // direction from the box to the eye: a three-quarter view, z up
  DVec3 up{0.0, 0.0, 1.0};
  double fov = 30.0;     // degrees
  double margin = 0.06;  // of the picture's half side, left free around the box
};

/// The nearest camera from that direction whose picture holds the whole box. A box is widened to a millionth of its
/// distance from the origin where it has no extent. Throws InputError when the box is empty or not finite.
Camera frame_box(const Box& box, int width, int height, const FramingOptions& options = {});

/// Reads  eye = [x, y, z]  target = [..]  up = [..]  fov = degrees  size = [width, height]; only eye and target must be
/// there. Throws InputError "FILE:LINE: ..." for syntax errors, unknown keys, wrong types and values.
Camera load_camera(const std::filesystem::path& path);

/// Writes the same, every digit kept, atomically. Throws InputError when the file cannot be written.
void save_camera(const std::filesystem::path& path, const Camera& camera);

}  // namespace isoskin
