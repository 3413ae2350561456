// Lines, discs and bars on white paper, for the figures of perf/papers.md.
#pragma once

#include <span>

#include <glm/vec2.hpp>

#include "render/image.h"

namespace isoskin::papers {

using glm::dvec2;

/// A picture of the rectangle low..high, y up; colours are linear.
class Drawing {
public:
  Drawing(const dvec2& low, const dvec2& high, int width);

  /// `width` in pixels. Antialiased; `share` of the colour covers what is there.
  void line(const dvec2& a, const dvec2& b, double width, const Vec3& color, double share = 1.0);
  void disc(const dvec2& center, double radius_pixels, const Vec3& color);
  void bar(const dvec2& low, const dvec2& high, const Vec3& color);

  Image image() const { return image_; }

private:
  dvec2 pixel(const dvec2& p) const;
  /// Covers each pixel of the box a..b (pixels) by distance(pixel), 1 inside to 0 outside.
  template <class Coverage>
  void cover(const dvec2& low, const dvec2& high, const Vec3& color, const Coverage& coverage);

  dvec2 low_;
  double scale_;  // pixels a unit
  Image image_;
};

/// Pictures of one size in rows of `columns`, on white where they cover nothing.
Image contact_sheet(std::span<const Image> pictures, int columns);
inline Image beside(const Image& a, const Image& b) {
  const Image both[] = {a, b};
  return contact_sheet(both, 2);
}

}  // namespace isoskin::papers
