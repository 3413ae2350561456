// Rumiano 2007: figure 13, a texture that sticks through a split, and what swapping edges is worth.
#include <algorithm>

#include "core/io/scene.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"
#include "perf/papers/drawing.h"
#include "perf/papers/page.h"
#include "render/rasterize.h"
#include "render/shade.h"

namespace isoskin::papers {
namespace {

Image noise_picture(const GeometricMesh& skin, const Box& box) {
  constexpr int kAntialias = 2, kWidth = 260, kHeight = 200;
  const Camera camera = frame_box(box, kAntialias * kWidth, kAntialias * kHeight);
  Image image = rasterize(skin.mesh, skin.normal, camera);
  ShadeOptions options;
  options.pattern = Pattern::noise;
  shade(image, camera, options);
  return downsample(image, kAntialias);
}

void add_split(Page& page) {
  const Scene scene = load_scene(ISOSKIN_TEST_DATA "/two_points.toml");
  const FieldFrame first = scene.source->load(40);
  TrackOptions options;
  options.edge_length = 0.06;
  Tracker tracker(make_opencl_backend(), resolved(options, *first.field));
  Box box{DVec3(-1.5, -0.8, -0.7), DVec3(1.5, 0.8, 0.7)};
  std::vector<Image> pictures;
  std::string kinds;
  for (int frame = 40; frame <= 64; ++frame) {
    tracker.advance(scene.source->load(frame));
    for (const LedgerEntry& entry : tracker.ledger()) kinds += fmt::format(" {} (frame {})", entry.kind, frame);
    if (frame == 40 || frame == 56 || frame == 64) pictures.push_back(noise_picture(tracker.geometric(), box));
  }
  page.add("## Rumiano 2007\n\n### Figure 13: two components split, Perlin noise by rest position\n\n");
  page.picture("figure13", beside(beside(pictures[0], pictures[1]), pictures[2]),
               "Frames 40, 56 and 64 of tests/data/two_points.toml");
  page.add(
      "`isoskin track tests/data/two_points.toml --frames 40:64 --edge-length 0.06 -o out`, then `isoskin render out "
      "--frame 64 "
      "--shading noise -o noise.exr`. The ledger:{}.\n\n",
      kinds);
}

/// Medians over the frames after the first.
void add_swap_row(Page& page, const char* file, int frames, double edge_length, bool flip) {
  const Scene scene = load_scene(std::string(ISOSKIN_TEST_DATA "/") + file);
  TrackOptions options;
  options.edge_length = edge_length;
  options.alter.flip = flip;
  options = resolved(options, *scene.source->load(1).field);
  Tracker tracker(make_opencl_backend(), options);
  std::vector<double> least, p1, mean, survived;
  std::size_t inverted = 0, repairs = 0;
  for (int frame = 1; frame <= frames; ++frame) {
    const FrameReport report = tracker.advance(scene.source->load(frame));
    if (frame == 1) continue;
    least.push_back(report.mechanical.min_angle);
    p1.push_back(report.mechanical.p1_angle);
    mean.push_back(report.mechanical.mean_angle);
    survived.push_back(report.survived);
    inverted = std::max(inverted, report.inverted);
    repairs += report.repairs;
  }
  page.add("| {}, {} frames | {} | {:.1f} / {:.1f} / {:.1f} | {:.1f} | {} | {} | {:.4f} |\n", file, frames,
           flip ? "yes" : "no", perf::median(least), perf::median(p1), perf::median(mean),
           *std::min_element(least.begin(), least.end()), inverted, repairs, perf::median(survived));
}

}  // namespace

void add_rumiano(Page& page) {
  add_split(page);
  page.add(
      "### Edge swaps as stabilisation, measured against none\n\n"
      "| scene | swaps | smallest angles: worst / 1 % / mean, medians | worst of all frames | inverted at most | "
      "repairs | vertices "
      "that survive a frame |\n|---|---|---|---|---|---|---|\n");
  for (const bool flip : {false, true}) {
    add_swap_row(page, "two_points.toml", 80, 0.06, flip);
    add_swap_row(page, "metaballs7.toml", 60, 0.0, flip);
    add_swap_row(page, "chain12.toml", 60, 0.0, flip);
  }
  page.add(
      "\nThe swaps are isoskin's own, by shape; Rumiano swaps where the normals of two triangles turn otherwise than "
      "the gradients. "
      "A local change, one of 60 or 1,000 metaballs moving, is measured by `isoskin-bench`.\n\n");
}

}  // namespace isoskin::papers
