#include "app/report.h"

#include <sys/resource.h>

namespace isoskin {
namespace {

Json angles(const ShapeStatistics& shape) {
  return {{"min", shape.min_angle}, {"p1", shape.p1_angle}, {"mean", shape.mean_angle}};
}

Json point(const DVec3& p) {
  return Json::array({p.x, p.y, p.z});
}

Json or_null(const std::optional<std::size_t>& count) {
  return count ? Json(*count) : Json();
}

/// The most memory this process has held so far.
std::size_t peak_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return std::size_t(usage.ru_maxrss) * 1024;  // Linux counts in kilobytes
}

}  // namespace

Json to_json(const FrameReport& report, const Box& bounds) {
  Json ms = Json::object();
  for (const auto& [step, value] : report.ms) ms[step] = value;
  return {{"frame", report.frame},
          {"time", report.time},
          {"mechanical_triangles", report.mechanical_triangles},
          {"geometric_triangles", report.geometric_triangles},
          {"survived", report.survived},
          {"inherited", report.inherited},
          {"reextracted", report.reextracted},
          {"events", report.events},
          {"repairs", report.repairs},
          {"certified", report.certified},
          {"certificate", report.certificate},
          {"inverted", report.inverted},
          {"quasi_critical", report.quasi_critical},
          {"self_intersections", report.geometric_intersections},
          {"mechanical_self_intersections", or_null(report.mechanical_intersections)},
          {"angles", angles(report.mechanical)},
          {"geometric_angles", angles(report.geometric)},
          {"bounds", bounds.empty() ? Json() : Json{point(bounds.low), point(bounds.high)}},
          {"peak_bytes", peak_bytes()},
          {"ms", ms}};
}

Json to_json(const LedgerEntry& entry) {
  return {{"frame", entry.frame},
          {"time", entry.time},
          {"kind", entry.kind},
          {"tier", entry.tier},
          {"position", point(entry.position)},
          {"vertices", entry.vertices},
          {"ms", entry.ms}};
}

}  // namespace isoskin
