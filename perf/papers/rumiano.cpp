// Rumiano 2007: figures 9 to 13 and what swapping edges is worth.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "core/field/skeleton_field.h"
#include "core/io/scene.h"
#include "core/mesh/edit.h"
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
  ShadeOptions options;
  options.pattern = Pattern::noise;
  Image image = rasterize(skin.mesh, skin.normal, camera, {.noise_size = pattern_size(options, camera)});
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
  page.add("### Figure 13: two components split, Perlin noise by rest position\n\n");
  page.picture("figure13", contact_sheet(pictures, 3), "Frames 40, 56 and 64 of tests/data/two_points.toml");
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

double angle_between(const DVec3& a, const DVec3& b) {
  const double lengths = glm::length(a) * glm::length(b);
  return lengths > 0.0 ? std::acos(std::clamp(glm::dot(a, b) / lengths, -1.0, 1.0)) : 0.0;
}

/// How much more the normals of two triangles, a b c and b a d, differ than the gradients at their barycentres.
double excess_turn(const Field& field, const DVec3& a, const DVec3& b, const DVec3& c, const DVec3& d) {
  const auto gradient = [&](const DVec3& e) { return field.sample((a + b + e) / 3.0).gradient; };
  return angle_between(glm::cross(b - a, c - a), glm::cross(d - a, b - a)) - angle_between(gradient(c), gradient(d));
}

/// Rumiano 4.2: where that excess is beyond a threshold the common edge is swapped; with `only_better`, if that lessens
/// it. Edges in the order of their halfedges, one swap a triangle and call.
std::size_t swap_turned_edges(TriangleMesh& mesh, const Field& field, double threshold, bool only_better) {
  std::vector<std::uint8_t> used(mesh.triangle_count());
  std::size_t swaps = 0;
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    const Index g = mesh.twin[h];
    if (h > g || used[h / 3] || used[g / 3]) continue;
    const DVec3 a(mesh.position(mesh.from(h))), b(mesh.position(mesh.to(h))), c(mesh.position(mesh.from(mesh.prev(h)))),
        d(mesh.position(mesh.from(mesh.prev(g))));
    const double excess = excess_turn(field, a, b, c, d);
    if (excess <= threshold || !can_flip(mesh, h)) continue;
    if (only_better && excess_turn(field, d, c, a, b) >= excess) continue;
    flip_edge(mesh, h);
    used[h / 3] = used[g / 3] = 1;
    ++swaps;
  }
  return swaps;
}

struct Swapping {
  double degrees;
  bool only_better;
};

/// "When the mechanical computations are off": vertices are only projected, on a mesh that is never altered.
void add_projected_row(Page& page, const char* file, int frames, std::optional<Swapping> swapping) {
  const Scene scene = load_scene(std::string(ISOSKIN_TEST_DATA "/") + file);
  const FieldFrame first = scene.source->load(1);
  const TrackOptions options = resolved({}, *first.field);
  Tracker tracker(make_opencl_backend(), options);
  tracker.advance(first);
  TriangleMesh mesh = tracker.mechanical();
  const std::unique_ptr<Backend> backend = make_opencl_backend();
  std::vector<double> p1, mean;
  std::size_t swaps = 0, most = 0, last = 0, ever = 0;
  for (int frame = 2; frame <= frames; ++frame) {
    const std::shared_ptr<const Field> field = scene.source->load(frame).field;
    backend->set_field(field);
    backend->set_mesh(mesh);
    backend->project_mesh(options.project);
    const std::span<const Vec3> positions = backend->positions();
    mesh.vertices.position.assign(positions.begin(), positions.end());
    if (swapping) swaps += swap_turned_edges(mesh, *field, glm::radians(swapping->degrees), swapping->only_better);
    std::vector<std::uint8_t> inverted(mesh.triangle_count());
    backend->set_mesh(mesh);
    backend->inverted_triangles(inverted);
    last = std::size_t(std::count(inverted.begin(), inverted.end(), 1));
    most = std::max(most, last);
    ever += last > 0;
    const ShapeStatistics shape = shape_statistics(mesh);
    p1.push_back(shape.p1_angle);
    mean.push_back(shape.mean_angle);
  }
  page.add("| {}, {} frames | {} | {} | {} | {} | {} | {:.1f} / {:.1f} |\n", file, frames,
           swapping ? fmt::format("beyond {:.0f} degrees{}", swapping->degrees,
                                  swapping->only_better ? ", where it helps" : "")
                    : "none",
           swaps, most, last, ever, p1.back(), mean.back());
}

void add_projected(Page& page) {
  page.add(
      "### Rumiano's own swaps, \"when the mechanical computations are off\"\n\nHis section 4.2: an edge is swapped "
      "where "
      "the normals of its two triangles differ by more than the gradients at their barycentres, beyond a threshold (he "
      "gives none); it \"significantly increases the stability\", without figures. As it is told, and only where the "
      "swap "
      "lessens that difference. Vertices are projected from frame to frame, on a mesh that is not altered "
      "otherwise:\n\n"
      "| scene | swaps | how many | inverted triangles at most | in the last frame | frames with any | smallest angles "
      "in the last frame: 1 % / mean |\n|---|---|---|---|---|---|---|\n");
  for (const auto& [file, frames] : {std::pair("metaballs7.toml", 100), {"chain12.toml", 60}}) {
    add_projected_row(page, file, frames, std::nullopt);
    for (const bool only_better : {false, true})
      for (const double degrees : {5.0, 15.0, 30.0})
        add_projected_row(page, file, frames, Swapping{degrees, only_better});
  }
  page.add("\n");
}

}  // namespace

void add_rumiano(Page& page) {
  page.add("## Rumiano 2007\n\n");
  add_critical_figures(page);
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
  page.add("\nThese swaps are isoskin's own, by shape and valence, with mechanics on.\n\n");
  add_projected(page);
}

}  // namespace isoskin::papers
