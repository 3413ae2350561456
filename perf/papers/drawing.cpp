#include "perf/papers/drawing.h"

#include <algorithm>
#include <cmath>

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

Image beside(const Image& a, const Image& b) {
  Image both;
  both.width = a.width + b.width;
  both.height = std::max(a.height, b.height);
  for (const char* name : kChannels) {
    std::vector<float>& to = both.add(name, 1.0f);
    int left = 0;
    for (const Image* part : {&a, &b}) {
      const std::vector<float>& from = part->at(name);
      for (int y = 0; y < part->height; ++y)
        for (int x = 0; x < part->width; ++x) {
          const std::size_t i = std::size_t(y) * part->width + x;
          const float paper = part->has("A") ? 1.0f - part->at("A")[i] : 0.0f;
          to[std::size_t(y) * both.width + left + x] = from[i] + paper;
        }
      left += part->width;
    }
  }
  return both;
}

}  // namespace isoskin::papers
