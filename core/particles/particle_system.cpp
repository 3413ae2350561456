#include "core/particles/particle_system.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/parallel.h"

namespace isoskin {
namespace {

/// The median of the positive entries, 0 when there are none.
float positive_median(std::vector<float> values) {
  std::erase_if(values, [](float v) { return !(v > 0.0f) || !std::isfinite(v); });
  if (values.empty()) return 0.0f;
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// F and grad F at every particle.
struct Samples {
  std::vector<float> value;
  std::vector<Vec3> gradient;

  explicit Samples(std::size_t n) : value(n), gradient(n) {}
  void take(std::span<const Vec3> points, Backend& backend) { backend.evaluate(points, value, gradient); }
  float slope(std::size_t i) const { return glm::length(gradient[i]); }
  float distance(std::size_t i) const { return std::abs(value[i]) / slope(i); }
};

/// The typical distance L and gradient of design "Units" above.
struct Units {
  float length, slope;

  explicit Units(const Samples& samples) {
    std::vector<float> distances(samples.value.size()), slopes(samples.value.size());
    for_each_index(slopes.size(), [&](std::size_t i) {
      slopes[i] = samples.slope(i);
      distances[i] = slopes[i] > 0.0f ? samples.distance(i) : 0.0f;
    });
    length = positive_median(std::move(distances));
    slope = positive_median(std::move(slopes));
  }
};

}  // namespace

ParticleReport fall_to_surface(std::span<Vec3> points, std::span<std::uint8_t> arrived, Backend& backend,
                               const ParticleOptions& options, const ParticleObserver& observe) {
  if (arrived.size() != points.size()) throw std::invalid_argument("fall_to_surface: arrived has another size");
  ParticleReport report;
  Samples samples(points.size());
  samples.take(points, backend);
  const Units units(samples);
  std::vector<Vec3> velocity(points.size(), Vec3(0.0f));  // L / T
  std::vector<std::uint8_t> slow(points.size()), inside(points.size());
  const auto close = [&](std::size_t i) {
    return samples.value[i] == 0.0f ||
           (samples.slope(i) > 0.0f && samples.distance(i) <= float(options.at_rest) * units.length);
  };
  std::vector<std::uint8_t> lost(points.size());  // nothing pulls it back
  for_each_index(points.size(), [&](std::size_t i) {
    arrived[i] = close(i);
    lost[i] = !arrived[i] && !(samples.slope(i) > 0.0f);
  });
  if (observe) observe(points);

  const auto settled = [&] {
    return std::count(arrived.begin(), arrived.end(), 1) + std::count(lost.begin(), lost.end(), 1);
  };
  const float dt = float(options.step), friction = float(options.friction), longest = float(options.longest_move);
  for (; report.steps < options.most_steps && std::size_t(settled()) < points.size(); ++report.steps) {
    for_each_index(points.size(), [&](std::size_t i) {
      if (arrived[i] || lost[i]) return;
      const Vec3 force = (samples.value[i] > 0.0f ? -1.0f : 1.0f) / units.slope * samples.gradient[i];
      velocity[i] += dt * (force - friction * velocity[i]);
      Vec3 move = dt * velocity[i];
      if (const float size = glm::length(move); size > longest) move *= longest / size;
      points[i] += units.length * move;
      slow[i] = glm::length(velocity[i]) <= 2.0f * dt * glm::length(force);
      inside[i] = samples.value[i] > 0.0f;
    });
    samples.take(points, backend);
    for_each_index(points.size(), [&](std::size_t i) {
      const bool crossed = inside[i] != (samples.value[i] > 0.0f);
      arrived[i] = arrived[i] || (!lost[i] && (close(i) || (crossed && slow[i])));
      lost[i] = !arrived[i] && !(samples.slope(i) > 0.0f);
    });
    if (observe) observe(points);
  }
  report.arrived = std::size_t(std::count(arrived.begin(), arrived.end(), 1));
  report.stranded = points.size() - report.arrived;
  return report;
}

}  // namespace isoskin
