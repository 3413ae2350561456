// Desbrun, Tsingos and Gascuel 1995: figures 3, 4, 7 and 8.
#include <chrono>

#include "core/io/scene.h"
#include "core/seeds/seeds.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"
#include "perf/papers/drawing.h"
#include "perf/papers/page.h"

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
  page.add(
      "\n### Figure 8: boxes of valid seeds save evaluations in collision detection\n\n`isoskin collide A B`, "
      "`--all`:\n\n"
      "| objects | wanted | seeds found | evaluations | without boxes |\n|---|---|---|---|---|\n");
  add_collision(page, "chain12.toml", "metaballs7.toml", 1);
  add_collision(page, "chain12.toml", "two_points.toml", 1);
  add_collision(page, "string.toml", "norm_p4.toml", 1);
  page.add("\n");
}

}  // namespace isoskin::papers
