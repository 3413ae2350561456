// Rumiano 2007, the last remark of section 4.2: what a frame takes in which only some of a skeleton moves.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "core/field/skeleton_field.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"
#include "perf/papers/page.h"

namespace isoskin::papers {
namespace {

constexpr double kApart = 0.8, kRadius = 0.6, kDrift = 0.01;
constexpr int kMeasured = 13, kAsleep = 5;  // by then what stands still has been asleep for a frame

DVec3 center_of(int ball, int count, int moving, int frame) {
  const int across = int(std::ceil(std::cbrt(double(count))));
  const DVec3 at = kApart * DVec3(ball % across, ball / across % across, ball / (across * across));
  return ball < moving ? at - DVec3(kDrift * frame, 0.0, 0.0) : at;
}

/// Metaballs on a lattice, each of which touches its neighbours; the first `moving` drift.
std::shared_ptr<const Field> lattice_of_balls(int count, int moving, int frame) {
  std::vector<SkeletonElement> balls{std::size_t(count)};
  for (int i = 0; i < count; ++i) {
    SkeletonElement& ball = balls[std::size_t(i)];
    ball.a = ball.b = center_of(i, count, moving, frame);
    ball.radius = kRadius;
  }
  return std::make_shared<SkeletonField>(std::move(balls), 0.2);
}

/// The share of the triangles with a vertex that a moving ball reaches from where it is or was.
double share_influenced(const TriangleMesh& mesh, int count, int moving, int frame) {
  std::vector<std::uint8_t> reached(mesh.vertex_count(), 0);
  for (int ball = 0; ball < moving; ++ball)
    for (const int when : {frame - 1, frame}) {
      const DVec3 center = center_of(ball, count, moving, when);
      for (Index v = 0; v < reached.size(); ++v) {
        const DVec3 d = DVec3(mesh.position(v)) - center;
        reached[v] |= glm::dot(d, d) < kRadius * kRadius;
      }
    }
  std::size_t triangles = 0;
  for (Index h = 0; h < mesh.vertex.size(); h += 3)
    triangles += reached[mesh.vertex[h]] || reached[mesh.vertex[h + 1]] || reached[mesh.vertex[h + 2]];
  return double(triangles) / double(mesh.triangle_count());
}

struct LocalRow {
  int count = 0, moving = 0;
  std::size_t triangles = 0;
  double influenced = 0.0, awake = 0.0, refined = 0.0;  // percent
  double ms = 0.0, slowest = 0.0;                       // a frame
  std::map<std::string, double> step;                   // ms
  bool certified = true;
};

LocalRow measure(int count, int moving) {
  LocalRow row;
  row.count = count;
  row.moving = moving;
  TrackOptions options;
  options.edge_length = 0.12;
  options.sagitta = 0.0;
  options = resolved(options, *lattice_of_balls(count, moving, 0));
  Tracker tracker(make_opencl_backend(), options);
  std::map<std::string, std::vector<double>> steps;
  std::vector<double> total, awake, refined;
  for (int frame = 0; frame <= kAsleep + kMeasured; ++frame) {
    const std::shared_ptr<const Field> field = lattice_of_balls(count, moving, frame);
    const auto begin = std::chrono::steady_clock::now();
    const FrameReport report = tracker.advance({frame, 0.04 * frame, field, nullptr});
    const std::chrono::duration<double, std::milli> ms = std::chrono::steady_clock::now() - begin;
    row.certified = row.certified && report.certified;
    if (frame <= kAsleep) continue;
    total.push_back(ms.count());
    for (const auto& [name, step] : report.ms) steps[name].push_back(step);
    const TriangleMesh& mesh = tracker.mechanical();
    const std::vector<std::uint8_t> asleep = sleeping(mesh.vertices, options.sleep);  // none: empty
    awake.push_back(100.0 * (1.0 - double(std::ranges::count(asleep, 1)) / double(mesh.vertex_count())));
    refined.push_back(100.0 * double(tracker.refined_triangles()) / double(mesh.triangle_count()));
  }
  row.triangles = tracker.mechanical().triangle_count();
  row.influenced = 100.0 * share_influenced(tracker.mechanical(), count, moving, kAsleep + kMeasured);
  row.awake = perf::median(awake);
  row.refined = perf::median(refined);
  row.ms = perf::median(total);
  row.slowest = *std::max_element(total.begin(), total.end());
  for (const auto& [name, ms] : steps) row.step[name] = perf::median(ms);
  return row;
}

void add_row(Page& page, const LocalRow& row, double rest) {
  const auto step = [&](const char* name) { return row.step.contains(name) ? row.step.at(name) : 0.0; };
  const double more = row.moving > 0 ? (row.ms - rest) / row.awake : 0.0;
  page.add("| {} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {:.1f} / {:.1f} | {:.1f} | {:.1f} | {:.1f} | {:.1f} | {} |\n",
           row.count, row.moving, row.triangles, row.influenced, row.awake, row.refined, row.ms, row.slowest, more,
           step("alter") + step("relax") + step("predict"), step("certify"), step("refine"),
           row.certified ? "all" : "not all");
}

/// The line ms = fixed + rate * awake with the least relative errors; of rows in which some move and some sleep.
void add_fit(Page& page, const std::vector<LocalRow>& rows) {
  double w = 0.0, x = 0.0, xx = 0.0, y = 0.0, xy = 0.0;
  const auto is_part = [](const LocalRow& row) { return row.moving > 0 && row.moving < row.count; };
  for (const LocalRow& row : rows) {
    if (!is_part(row)) continue;
    const double weight = 1.0 / (row.ms * row.ms);
    w += weight, x += weight * row.awake, xx += weight * row.awake * row.awake;
    y += weight * row.ms, xy += weight * row.awake * row.ms;
  }
  const double rate = (w * xy - x * y) / (w * xx - x * x), fixed = (y - rate * x) / w;
  double worst = 0.0;
  for (const LocalRow& row : rows)
    if (is_part(row)) worst = std::max(worst, std::abs(fixed + rate * row.awake - row.ms) / row.ms);
  page.add(
      "{} metaballs, where some move and some do not: {:.1f} ms + {:.1f} ms for each percent that is awake, within "
      "{:.0f} %; "
      "{:.1f} ms where none moves.\n\n",
      rows.front().count, fixed, rate, 100.0 * worst, rows.front().ms);
}

}  // namespace

void add_local(Page& page) {
  page.add(
      "### Section 4.2's last remark: update only what the moving element influences\n\n"
      "Metaballs on a lattice, a row or sheet of which drifts. Each reaches {:.2f}, {} edges; *inside* is the share of "
      "the triangles with a vertex that a moving ball reaches from where it is or was. Skin nearer than three edges to "
      "that is *awake*: it moves; all else stays, bit for bit. *Refined* is what refinement makes again, some rings "
      "beyond. Skin falls asleep after {} frames at rest, so the medians (and the slowest) are of the {} frames after "
      "that; in some of them a thin neck is filled, and one ball comes off the others. *More* is by how much a frame "
      "takes longer than one at rest, for each percent that is awake. ms:\n\n"
      "| metaballs | moving | triangles | inside, % | awake, % | refined, % | frame / slowest | more, ms / % | "
      "predict, "
      "alter, relax | certify | refine | certified |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|\n",
      kRadius, int(std::round(kRadius / 0.12)), SleepOptions{}.rest_frames, kMeasured);
  std::vector<std::vector<LocalRow>> tables;
  for (const auto& [count, movings] : {std::pair(60, std::vector{0, 1, 3, 6, 20, 60}),
                                       std::pair(1000, std::vector{0, 1, 3, 10, 30, 100, 300, 1000})}) {
    std::vector<LocalRow>& rows = tables.emplace_back();
    for (const int moving : movings) {
      rows.push_back(measure(count, moving));
      add_row(page, rows.back(), rows.front().ms);
    }
  }
  page.add("\n");
  for (const std::vector<LocalRow>& rows : tables) add_fit(page, rows);
  page.add(
      "What a line begins with, beyond a frame at rest, are looks over the whole skin for what has changed, and steps "
      "too "
      "small for all threads.\n\n");
}

}  // namespace isoskin::papers
