#include "core/sampling/segment_roots.h"

#include "core/parallel.h"

namespace isoskin {
namespace {

/// The part of a segment that still holds a crossing. Values of the Illinois rule: an end kept twice counts half.
struct Bracket {
  double low = 0.0, high = 1.0;
  double at_low = 0.0, at_high = 0.0;
  int kept = 0;  // -1: the lower end was kept last time, 1: the upper one

  bool crosses() const { return (at_low > 0.0) != (at_high > 0.0); }
  double guess() const {
    const double t = low + (high - low) * at_low / (at_low - at_high);
    return t > low && t < high ? t : 0.5 * (low + high);
  }
  void narrow(double t, double value) {
    if ((value > 0.0) == (at_low > 0.0)) {
      low = t, at_low = value;
      if (kept == 1) at_high *= 0.5;
      kept = 1;
    } else {
      high = t, at_high = value;
      if (kept == -1) at_low *= 0.5;
      kept = -1;
    }
  }
};

}  // namespace

void find_roots(std::span<SegmentRoot> segments, Backend& backend, int rounds) {
  std::vector<Vec3> points(segments.size());
  std::vector<float> values(segments.size());
  std::vector<Bracket> brackets(segments.size());
  const auto evaluate = [&](const auto& point_of, const auto& take) {
    for_each_index(segments.size(), [&](std::size_t i) { points[i] = point_of(segments[i]); });
    backend.evaluate(points, values, {});
    for_each_index(segments.size(), [&](std::size_t i) { take(i, double(values[i])); });
  };
  evaluate([](const SegmentRoot& s) { return s.from; }, [&](std::size_t i, double v) { brackets[i].at_low = v; });
  evaluate([](const SegmentRoot& s) { return s.to; },
           [&](std::size_t i, double v) {
             brackets[i].at_high = v;
             segments[i].found = brackets[i].crosses();
           });
  const auto guess = [&](std::size_t i) {
    if (segments[i].found) segments[i].t = float(brackets[i].guess());
  };
  for (int round = 0; round < rounds; ++round)
    evaluate([](const SegmentRoot& s) { return s.point(); },
             [&](std::size_t i, double v) {
               const Bracket before = brackets[i];
               const double t = segments[i].t;
               if (t > before.low && t < before.high) brackets[i].narrow(t, v);
               guess(i);
             });
}

}  // namespace isoskin
