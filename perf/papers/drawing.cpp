#include "perf/papers/drawing.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <glm/geometric.hpp>

namespace isoskin::papers {
namespace {

constexpr const char* kChannels[] = {"R", "G", "B"};

}  // namespace

Drawing::Drawing(const dvec2& low, const dvec2& high, int width) : low_(low), scale_(width / (high.x - low.x)) {
  image_.width = width;
  image_.height = int(std::lround((high.y - low.y) * scale_));
  for (const char* name : kChannels) image_.add(name, 1.0f);
}

dvec2 Drawing::pixel(const dvec2& p) const {
  return {(p.x - low_.x) * scale_ - 0.5, image_.height - 0.5 - (p.y - low_.y) * scale_};
}

template <class Coverage>
void Drawing::cover(const dvec2& low, const dvec2& high, const Vec3& color, const Coverage& coverage) {
  const int x0 = std::max(0, int(std::floor(low.x))), x1 = std::min(image_.width - 1, int(std::ceil(high.x)));
  const int y0 = std::max(0, int(std::floor(low.y))), y1 = std::min(image_.height - 1, int(std::ceil(high.y)));
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const float part = float(std::clamp(coverage(dvec2(x, y)), 0.0, 1.0));
      for (int c = 0; c < 3; ++c) {
        float& v = image_.at(kChannels[c])[std::size_t(y) * image_.width + x];
        v += part * (color[c] - v);
      }
    }
}

void Drawing::line(const dvec2& a, const dvec2& b, double width, const Vec3& color, double share) {
  const dvec2 p = pixel(a), q = pixel(b), d = q - p;
  const double square = glm::dot(d, d), reach = 0.5 * width + 1.0;
  cover(glm::min(p, q) - reach, glm::max(p, q) + reach, color, [&](const dvec2& x) {
    const double t = square > 0.0 ? std::clamp(glm::dot(x - p, d) / square, 0.0, 1.0) : 0.0;
    return share * std::min(1.0, width) * (0.5 + 0.5 * std::max(1.0, width) - glm::distance(x, p + t * d));
  });
}

void Drawing::disc(const dvec2& center, double radius_pixels, const Vec3& color) {
  const dvec2 p = pixel(center);
  cover(p - radius_pixels - 1.0, p + radius_pixels + 1.0, color,
        [&](const dvec2& x) { return 0.5 + radius_pixels - glm::distance(x, p); });
}

void Drawing::bar(const dvec2& low, const dvec2& high, const Vec3& color) {
  const dvec2 p = pixel({low.x, high.y}), q = pixel({high.x, low.y});
  cover(p, q, color, [&](const dvec2& x) { return std::min({x.x - p.x, q.x - x.x, x.y - p.y, q.y - x.y}) + 0.5; });
}

Image contact_sheet(std::span<const Image> pictures, int columns) {
  const int width = pictures.front().width, height = pictures.front().height;
  const int rows = (int(pictures.size()) + columns - 1) / columns;
  Image sheet;
  sheet.width = columns * width;
  sheet.height = rows * height;
  for (const char* name : kChannels) {
    std::vector<float>& to = sheet.add(name, 1.0f);
    for (std::size_t p = 0; p < pictures.size(); ++p) {
      const Image& part = pictures[p];
      if (part.width != width || part.height != height)
        throw std::invalid_argument("contact_sheet: pictures of different sizes");
      const std::vector<float>& from = part.at(name);
      const std::size_t corner = p / columns * height * std::size_t(sheet.width) + p % columns * std::size_t(width);
      for (std::size_t i = 0; i < from.size(); ++i) {
        const float paper = part.has("A") ? 1.0f - part.at("A")[i] : 0.0f;
        to[corner + i / width * sheet.width + i % width] = from[i] + paper;
      }
    }
  }
  return sheet;
}

}  // namespace isoskin::papers
