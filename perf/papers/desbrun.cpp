// Desbrun, Tsingos and Gascuel 1995: figures 3, 4, 7 and 8, with how many evaluations the boxes save.
#include <chrono>
#include <cmath>

#include "core/io/scene.h"
#include "core/seeds/seeds.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"
#include "perf/papers/drawing.h"
#include "perf/papers/page.h"
#include "render/raytrace.h"

namespace isoskin::papers {
namespace {

struct Speed {
  std::size_t seeds = 0, valid = 0;
  double first_ms = 0.0, ms = 0.0;                    // of the first frame; median of the others
  double first_evaluations = 0.0, evaluations = 0.0;  // a valid seed
};

/// Seeds kept on an animated scene.
Speed follow(const char* file, double spacing, int frames) {
  const Scene scene = load_scene(std::string(ISOSKIN_TEST_DATA "/") + file);
  SeedOptions options;
  options.spacing = spacing;
  Seeds seeds(options);
  const std::unique_ptr<Backend> backend = make_opencl_backend();
  Speed speed;
  std::vector<double> ms, evaluations;
  for (int frame = 1; frame <= frames; ++frame) {
    const std::shared_ptr<const Field> field = scene.source->load(frame).field;
    backend->set_field(field);
    const auto begin = std::chrono::steady_clock::now();
    const SeedReport report = seeds.move_to(skeleton_parts(*field), *backend);
    const double took = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    const double each = double(report.evaluations) / double(std::max<std::size_t>(1, report.valid));
    if (frame == 1) {
      speed.first_ms = took;
      speed.first_evaluations = each;
      continue;
    }
    ms.push_back(took);
    evaluations.push_back(each);
    speed.seeds = report.seeds;
    speed.valid = report.valid;
  }
  speed.ms = perf::median(ms);
  speed.evaluations = perf::median(evaluations);
  return speed;
}

void add_collision(Page& page, const char* first, const char* second, int frame) {
  struct Side {
    std::shared_ptr<const Field> field;
    std::unique_ptr<Backend> backend = make_opencl_backend();
    Seeds seeds{SeedOptions{}};
    explicit Side(const char* file, int at) {
      field = load_scene(std::string(ISOSKIN_TEST_DATA "/") + file).source->load(at).field;
      backend->set_field(field);
      SeedOptions options;
      options.spacing = 0.05;
      seeds = Seeds(options);
      seeds.move_to(skeleton_parts(*field), *backend);
    }
  };
  const Side a(first, frame), b(second, frame);
  for (const bool all : {false, true}) {
    const Penetration p = find_penetration(a.seeds, *a.backend, b.seeds, *b.backend, all);
    page.add("| {} and {}, frame {} | {} | {} | {} | {} |\n", first, second, frame, all ? "all" : "the first element's",
             p.of_first.size() + p.of_second.size(), p.evaluations, p.without_boxes);
  }
}

Seeds sown(const std::shared_ptr<const Field>& field, double spacing) {
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(field);
  SeedOptions options;
  options.spacing = spacing;
  Seeds seeds(options);
  seeds.move_to(skeleton_parts(*field), *backend);
  return seeds;
}

/// Figure 4's object: a point and a box.
void add_box_and_point(Page& page) {
  SkeletonElement point, box;
  point.a = point.b = DVec3(0.0, 0.1, 0.55);
  point.radius = 0.9;
  box.shape = Shape::box;
  box.a = DVec3(-0.8, -0.4, -0.25);
  box.b = box.a + DVec3(1.6, 0.0, 0.0);
  box.c = box.a + DVec3(0.0, 0.8, 0.0);
  box.d = box.a + DVec3(0.0, 0.0, 0.3);
  box.radius = 0.5;
  const auto field = std::make_shared<SkeletonField>(std::vector{point, box}, 0.3);
  const DVec3 from(0.4, -0.8, 0.6);
  page.add("### Figure 4: two densities for a point and a box\n\n");
  page.picture("desbrun4",
               beside(wire_picture(sown(field, 0.12).pieces(), field->bounds(), from, 300, 220),
                      wire_picture(sown(field, 0.05).pieces(), field->bounds(), from, 300, 220)),
               "The piecewise polygonization at spacings 0.12 and 0.05: each element's own closed grid");
  const std::shared_ptr<const Field> solids = load_scene(ISOSKIN_TEST_DATA "/solids.toml").source->load(30).field;
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(solids);
  const Seeds seeds = sown(solids, 0.07);
  page.picture("solids",
               beside(wire_picture(seeds.scales(*backend), solids->bounds(), from, 300, 220),
                      wire_picture(seeds.pieces(), solids->bounds(), from, 300, 220)),
               "Scales and pieces of a triangle, a turned box and a ball: tests/data/solids.toml, frame 30");
}

void add_rays(Page& page) {
  page.add(
      "### Figure 8 again: the same boxes bound rays\n\n`isoskin render SCENE --what field --bounds "
      "main|seeds|bisected "
      "--count -o field.exr`, 256 x 256. The paper gives no figures. \"Elements asked\" sums over evaluations of F (at "
      "points, and of bounds over pieces of rays) the elements that each asks: all of them in the main box, those "
      "felt there in a seeds' box. Local boxes overlap, so there are more evaluations, each cheaper by the length of "
      "its "
      "list; where nearly all elements are felt everywhere (solids.toml) that is a loss. isoskin's own reference "
      "pictures bisect space further, and hold the surface for certain; pixels that the "
      "others see differently are counted.\n\n"
      "| scene, elements | boxes | pixels hit | evaluations | of bounds | elements asked | share of the main box's | "
      "pixels that differ |\n|---|---|---|---|---|---|---|---|\n");
  for (const char* file : {"chain12.toml", "string.toml", "solids.toml", "metaballs60.toml"}) {
    const std::shared_ptr<const Field> field =
        load_scene(std::string(ISOSKIN_TEST_DATA "/") + file).source->load(1).field;
    const Camera camera = frame_box(field->bounds(), 256, 256);
    const Raytraced bisected = raytrace(*field, camera), main = raytrace(*field, main_box(*field), camera);
    const Seeds seeds = sown(field, field->bounds().diagonal() / 60.0);
    const Raytraced local = raytrace(*field, seed_boxes(*field, seeds), camera);
    const auto row = [&](const char* name, const Raytraced& traced) {
      std::size_t differ = 0;
      for (std::size_t pixel = 0; pixel < traced.image.pixels(); ++pixel) {
        const float z = traced.image.at("Z")[pixel], other = bisected.image.at("Z")[pixel];
        differ += std::isfinite(z) != std::isfinite(other) || (std::isfinite(z) && std::abs(z - other) > 1e-4f * z);
      }
      const RaytraceReport& r = traced.report;
      page.add("| {}, {} | {}: {} | {} | {} | {} | {} | {:.2f} | {} |\n", file, element_count(*field), name, r.boxes,
               r.hits, r.evaluations, r.bounds, r.elements, double(r.elements) / double(main.report.elements), differ);
    };
    row("main", main);
    row("seeds", local);
    row("bisected", bisected);
  }
  page.add("\n");
}

}  // namespace

void add_seeds(Page& page) {
  page.add(
      "## Desbrun, Tsingos and Gascuel 1995\n\n### Figures 3, 4 and 7: scales and pieces of a string whose ends do not "
      "blend\n\n");
  const std::unique_ptr<Backend> backend = make_opencl_backend();
  const std::shared_ptr<const Field> field = load_scene(ISOSKIN_TEST_DATA "/string.toml").source->load(24).field;
  backend->set_field(field);
  Seeds seeds{SeedOptions{}};
  seeds.move_to(skeleton_parts(*field), *backend);
  const Box box = field->bounds();
  const DVec3 from(0.3, -0.6, 0.8);
  page.picture("seeds",
               beside(wire_picture(seeds.scales(*backend), box, from, 300, 300),
                      wire_picture(seeds.pieces(), box, from, 300, 300)),
               "Scales on the valid seeds (backs are red), and the closed grids of the twelve elements");
  page.add(
      "`isoskin seeds tests/data/string.toml --frame 24`, `--as pieces`. Seeds kept from frame to frame (the paper: "
      "\"interactive "
      "rates\"); medians over frames after the first:\n\n"
      "| scene | spacing | seeds | valid | ms, first frame | ms a frame | evaluations of the field a valid seed, first "
      "| a frame |\n"
      "|---|---|---|---|---|---|---|---|\n");
  struct Case {
    const char* file;
    double spacing;
  };
  for (const Case& c : {Case{"chain12.toml", 0.05}, Case{"chain12.toml", 0.0165}, Case{"metaballs60.toml", 0.05}}) {
    const Speed s = follow(c.file, c.spacing, 12);
    page.add("| {} | {} | {} | {} | {:.0f} | {:.0f} | {:.1f} | {:.1f} |\n", c.file, c.spacing, s.seeds, s.valid,
             s.first_ms, s.ms, s.first_evaluations, s.evaluations);
  }
  page.add("\n");
  add_box_and_point(page);
  page.add(
      "### Figure 8: boxes of valid seeds save evaluations in collision detection\n\n`isoskin collide A B`, "
      "`--all`:\n\n"
      "| objects | wanted | seeds found | evaluations | without boxes |\n|---|---|---|---|---|\n");
  add_collision(page, "chain12.toml", "metaballs7.toml", 1);
  add_collision(page, "chain12.toml", "two_points.toml", 1);
  add_collision(page, "string.toml", "norm_p4.toml", 1);
  page.add("\n");
  add_rays(page);
}

}  // namespace isoskin::papers
