#include "render/compare.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isoskin {
namespace {

constexpr double kPercentile = 0.99;

struct View {
  explicit View(const Image& image)
      : width(image.width), height(image.height), a(image.at("A")), z(image.at("Z")), n(image, "N") {}

  bool covers(int x, int y) const {
    return x >= 0 && y >= 0 && x < width && y < height && a[static_cast<std::size_t>(y) * width + x] > 0.5f;
  }

  /// Whether some covered pixel at most `reach` away satisfies the predicate.
  template <class Predicate>
  bool any_near(int x, int y, int reach, const Predicate& predicate) const {
    for (int j = y - reach; j <= y + reach; ++j) {
      for (int i = x - reach; i <= x + reach; ++i) {
        if (covers(i, j) && predicate(static_cast<std::size_t>(j) * width + i)) return true;
      }
    }
    return false;
  }

  int width, height;
  const std::vector<float>&a, &z;
  VectorChannels n;
};

double angle_between(const Vec3& a, const Vec3& b) {
  const DVec3 u(a), v(b);
  return std::atan2(glm::length(glm::cross(u, v)), glm::dot(u, v)) * 180.0 / std::numbers::pi;
}

ErrorStatistics statistics(std::vector<double> errors) {
  ErrorStatistics out;
  out.pixels = errors.size();
  if (errors.empty()) return out;
  for (double& e : errors) e = std::isnan(e) ? std::numeric_limits<double>::infinity() : e;
  std::sort(errors.begin(), errors.end());
  for (const double e : errors) out.mean += e;
  out.mean /= static_cast<double>(errors.size());
  out.p99 = errors[static_cast<std::size_t>(kPercentile * static_cast<double>(errors.size() - 1))];
  out.max = errors.back();
  return out;
}

enum class Kind : std::uint8_t { empty, inside, inner_silhouette, rim, beyond_rim };

Kind classify(const View& a, const View& b, int x, int y, const CompareOptions& options) {
  const bool in_a = a.covers(x, y), in_b = b.covers(x, y);
  if (!in_a && !in_b) return Kind::empty;
  if (in_a != in_b) {
    const View& bare = in_a ? b : a;
    return bare.any_near(x, y, options.rim, [](std::size_t) { return true; }) ? Kind::rim : Kind::beyond_rim;
  }
  const std::size_t here = static_cast<std::size_t>(y) * a.width + x;
  for (const View* view : {&a, &b}) {
    const auto far_from_here = [&](std::size_t there) {
      return std::abs(double{view->z[there]} - view->z[here]) > options.jump * options.unit;
    };
    if (view->any_near(x, y, options.rim, far_from_here)) return Kind::inner_silhouette;
  }
  return Kind::inside;
}

// Beyond the rim red, rim yellow, else from dark through blue to white as the depth error nears its tolerance.
Vec3 picture(Kind kind, double depth_error, const CompareOptions& options) {
  if (kind == Kind::empty) return {0.0f, 0.0f, 0.0f};
  if (kind == Kind::beyond_rim) return {1.0f, 0.0f, 0.0f};
  if (kind == Kind::rim) return {0.6f, 0.5f, 0.0f};
  const float share = static_cast<float>(std::min(1.0, std::abs(depth_error) / options.depth_p99));
  return {share * share, 0.02f + 0.98f * share * share, 0.06f + 0.94f * share};
}

void judge(CompareReport& report, const CompareOptions& options) {
  std::string faults;
  const auto fault = [&](const std::string& text) { faults += (faults.empty() ? "" : "; ") + text; };
  if (report.beyond_rim > options.most_beyond_rim) {
    fault(fmt::format("{} pixels beyond the {}-pixel rim (allowed {})", report.beyond_rim, options.rim,
                      options.most_beyond_rim));
  }
  if (!(report.depth_inside.p99 <= options.depth_p99)) {
    fault(fmt::format("depth error p99 {:.4g} units (allowed {:.4g})", report.depth_inside.p99, options.depth_p99));
  }
  if (!(report.normal.mean <= options.normal_mean)) {
    fault(fmt::format("mean normal error {:.3g} degrees (allowed {:.3g})", report.normal.mean, options.normal_mean));
  }
  report.passed = faults.empty();
  report.verdict = report.passed ? "passed" : faults;
}

}  // namespace

Comparison compare(const Image& image_a, const Image& image_b, const CompareOptions& options) {
  if (!(options.unit > 0.0)) throw std::invalid_argument("compare: the unit must be positive");
  if (image_a.width != image_b.width || image_a.height != image_b.height) {
    throw InputError(fmt::format("compare: images of {} x {} and {} x {} pixels; expected one size", image_a.width,
                                 image_a.height, image_b.width, image_b.height));
  }
  const View a(image_a), b(image_b);
  Comparison out{{}, {image_a.width, image_a.height, {}}};
  auto &coverage = out.difference.add("coverage"), &depth = out.difference.add("depth");
  auto &angle = out.difference.add("angle"), &red = out.difference.add("R"), &green = out.difference.add("G"),
       &blue = out.difference.add("B");
  std::vector<Kind> kind(image_a.pixels());
  tbb::parallel_for(0, a.height, [&](int y) {
    for (int x = 0; x < a.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * a.width + x;
      kind[pixel] = classify(a, b, x, y, options);
      coverage[pixel] = static_cast<float>(a.covers(x, y)) - static_cast<float>(b.covers(x, y));
      if (a.covers(x, y) && b.covers(x, y)) {
        depth[pixel] = static_cast<float>((double{a.z[pixel]} - b.z[pixel]) / options.unit);
        angle[pixel] = static_cast<float>(angle_between(a.n[pixel], b.n[pixel]));
      }
      const Vec3 color = picture(kind[pixel], depth[pixel], options);
      red[pixel] = color.x;
      green[pixel] = color.y;
      blue[pixel] = color.z;
    }
  });

  CompareReport& report = out.report;
  std::vector<double> depths, inside, angles;
  for (std::size_t pixel = 0; pixel < kind.size(); ++pixel) {
    report.covered_a += a.a[pixel] > 0.5f;
    report.covered_b += b.a[pixel] > 0.5f;
    report.coverage_mismatch += kind[pixel] == Kind::rim || kind[pixel] == Kind::beyond_rim;
    report.beyond_rim += kind[pixel] == Kind::beyond_rim;
    if (kind[pixel] != Kind::inside && kind[pixel] != Kind::inner_silhouette) continue;
    depths.push_back(std::abs(depth[pixel]));
    angles.push_back(angle[pixel]);
    if (kind[pixel] == Kind::inside) inside.push_back(std::abs(depth[pixel]));
  }
  report.depth = statistics(std::move(depths));
  report.depth_inside = statistics(std::move(inside));
  report.normal = statistics(std::move(angles));
  judge(report, options);
  return out;
}

}  // namespace isoskin
