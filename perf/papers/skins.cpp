// Nesme-Bouthors 2006 tables 2 and 3 and Bouthors-Nesme 2007 table 2: finite elements beside mass-springs, and the
// geometric mesh by angle, on scenes like theirs.
#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/counter_random.h"
#include "core/field/skeleton_field.h"
#include "core/mesh/validate.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"
#include "perf/papers/drawing.h"
#include "perf/papers/page.h"
#include "render/rasterize.h"

namespace isoskin::papers {
namespace {

using perf::median;

constexpr double kDt = 0.04;      // seconds, theirs
constexpr double kSeconds = 4.0;  // of every animation

/// A blob of inverse-square points on wandering paths. The papers give the number of skeleton elements and of
/// particles, not their places.
struct Example {
  const char* name;
  int elements;
  std::size_t particles;

  std::shared_ptr<const Field> field(double time) const {
    std::vector<SkeletonElement> skeleton;
    const bool few = elements <= 3;  // a blob of few, an arc of many: nothing splits or joins
    const double ring = few ? 0.6 : 1.0, radius = few ? 0.5 : 0.22, reach = few ? 0.25 : 0.12;
    for (int i = 0; i < elements; ++i) {
      const double turn = few ? 2.0 * M_PI * i / elements : 2.6 * i / (elements - 1);
      const DVec3 u = counter_point(2006, std::uint64_t(i)), phase = 2.0 * M_PI * counter_point(2007, std::uint64_t(i));
      SkeletonElement e;
      e.a = ring * DVec3(std::cos(turn), std::sin(turn), few ? u.z - 0.5 : 0.0) +
            reach * glm::sin((1.0 + u) * 2.0 * time + phase);
      e.b = e.a;
      e.radius = radius;
      e.potential = Potential::inverse_square;
      skeleton.push_back(e);
    }
    return std::make_shared<SkeletonField>(std::move(skeleton), 1.0);
  }
};

constexpr Example kExamples[] = {
    {"example 1", 3, 350}, {"example 2", 3, 180}, {"example 3", 12, 530}, {"example 4", 12, 5000}};

/// The edge length at which the first frame has about as many vertices as wanted.
TrackOptions options_for(const Example& example) {
  TrackOptions options;
  const std::shared_ptr<const Field> field = example.field(0.0);
  double e = field->bounds().diagonal() / 20.0;
  for (int round = 0; round < 4; ++round) {
    options = {};
    options.edge_length = e;
    options = resolved(options, *field);
    options.refine.passes = 0;
    Tracker tracker(make_opencl_backend(), options);
    tracker.advance({0, 0.0, field, nullptr});
    e *= std::sqrt(double(tracker.mechanical().vertex_count()) / double(example.particles));
  }
  options = {};
  options.edge_length = e;
  options = resolved(options, *field);
  options.refine.sagitta = 0.0f;  // theirs refine by angle alone
  return options;
}

/// Topology events and repairs of a tracked run: there should be none, for the skins below have no means against them.
std::size_t count_events(const Example& example, const TrackOptions& track) {
  Tracker tracker(make_opencl_backend(), track);
  std::size_t events = 0;
  for (int frame = 0; kDt * frame <= kSeconds; ++frame) {
    tracker.advance({frame, kDt * frame, example.field(kDt * frame), nullptr});
    events += tracker.ledger().size();
  }
  return events;
}

struct Settings {
  Mechanics mechanics = Mechanics::fem;
  int iterations = 10;
  double dt = kDt;
  bool theirs = false;  // the papers' constants
  double speed = 1.0;   // of the animation
  bool bounded = true, altering = true;
  float stiffness = 100.0f;  // k of springs
};

/// A mechanical mesh and what moves it.
struct Skin {
  TriangleMesh mesh;
  std::unique_ptr<Backend> backend = make_opencl_backend();
  AlterOptions alter;
  RelaxOptions relax;
  ProjectOptions project;
  std::vector<std::uint8_t> inverted;

  Skin(const Example& example, const TrackOptions& track, Mechanics mechanics, int iterations, double dt, bool theirs)
      : alter(track.alter), relax(track.relax), project(track.project) {
    Tracker first(make_opencl_backend(), track);
    first.advance({0, 0.0, example.field(0.0), nullptr});
    mesh = first.mechanical();
    relax.mechanics = mechanics;
    relax.steps = 1;
    relax.cg_iterations = iterations;
    relax.cg_tolerance = 0.0f;
    relax.dt = float(dt);
    alter.dt = float(dt);
    if (theirs) {  // table 1: edges between 1 and 2 times the desired length; so about as many vertices remain
      alter.shortest = 1.0f;
      alter.longest = 2.0f;
      alter.flip = false;
      alter.edge_length = relax.edge_length = float(track.edge_length / 1.35);
    }
  }

  /// ALTERMESH and QUASI-STATIC. Returns milliseconds.
  double step(const std::shared_ptr<const Field>& field, bool altering) {
    backend->set_field(field);
    for (Index& age : mesh.vertices.age) ++age;
    const auto begin = std::chrono::steady_clock::now();
    if (altering) isoskin::alter(mesh, alter, inverted);
    const std::vector<Vec3> before = mesh.vertices.position;
    backend->set_mesh(mesh);
    backend->relax(relax, project);
    const auto positions = backend->positions();
    mesh.vertices.position.assign(positions.begin(), positions.end());
    inverted.resize(mesh.triangle_count());
    backend->inverted_triangles(inverted);
    const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    for (std::size_t v = 0; v < before.size(); ++v)
      mesh.vertices.velocity[v] = (mesh.vertices.position[v] - before[v]) / alter.dt;
    return ms;
  }
  std::size_t count_inverted() const { return std::size_t(std::count(inverted.begin(), inverted.end(), 1)); }
};

struct Run {
  double ms = 0.0, angle = 0.0, p1 = 0.0;
  double compressed = 0.0;  // share of edges shorter than at rest, median
  std::size_t most_inverted = 0, frames_inverted = 0, frames = 0, inverted_at_end = 0;
  bool stable = true;
};

double share_shorter(const TriangleMesh& mesh, float length) {
  std::size_t shorter = 0;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    shorter += glm::distance(mesh.position(mesh.from(h)), mesh.position(mesh.to(h))) < length;
  return double(shorter) / double(mesh.vertex.size());
}

/// Unstable: a vertex is not finite, or a tenth of the triangles is inverted at once, or the mesh is no manifold at the
/// end.
Run animate(const Example& example, const TrackOptions& track, const Settings& settings) {
  constexpr double kTooMany = 0.1;
  constexpr float kFarther = 1e6f;  // than any move
  const double dt = settings.dt;
  Skin skin(example, track, settings.mechanics, settings.iterations, dt, settings.theirs);
  skin.relax.spring = settings.stiffness;
  if (!settings.bounded) skin.relax.max_move = kFarther;
  Run run;
  std::vector<double> ms, angle, p1, compressed;
  for (double time = dt; time <= kSeconds && run.stable; time += dt) {
    ms.push_back(skin.step(example.field(settings.speed * time), settings.altering));
    const std::size_t inverted = skin.count_inverted();
    run.most_inverted = std::max(run.most_inverted, inverted);
    run.frames_inverted += inverted > 0;
    run.inverted_at_end = inverted;
    ++run.frames;
    const ShapeStatistics shape = shape_statistics(skin.mesh);
    angle.push_back(shape.mean_angle);
    p1.push_back(shape.p1_angle);
    compressed.push_back(share_shorter(skin.mesh, skin.relax.edge_length));
    for (const Vec3& p : skin.mesh.vertices.position) run.stable = run.stable && std::isfinite(p.x + p.y + p.z);
    run.stable = run.stable && double(inverted) < kTooMany * double(skin.mesh.triangle_count());
  }
  run.stable = run.stable && validate(skin.mesh);
  run.ms = median(ms);
  run.angle = median(angle);
  run.p1 = median(p1);
  run.compressed = median(compressed);
  return run;
}

struct Column {
  Mechanics mechanics;
  int iterations;
};
constexpr Column kColumns[] = {
    {Mechanics::fem, 2}, {Mechanics::fem, 10}, {Mechanics::springs, 2}, {Mechanics::springs, 10}};

struct TableRow {
  int example;
  double dt;
  const char* theirs[4];
};
constexpr TableRow kTable[] = {{0, 0.04, {"9", "16", "10", "20"}},
                               {1, 0.04, {"15", "16", "12", "14"}},
                               {2, 0.04, {"197", "215", "148", "183"}},
                               {3, 0.04, {"90", "130", "not stable", "not stable"}},
                               {3, 0.01, {"90", "130", "110", "190"}}};

void add_table(Page& page, const TrackOptions (&track)[4], bool theirs) {
  page.add(
      "| ms a step: theirs, ours | FEM, 2 it. | FEM, 10 it. | springs, 2 it. | springs, 10 it. "
      "|\n|---|---|---|---|---|\n");
  Page quality{page.folder, {}};
  int unstable[2] = {0, 0};  // FEM, springs
  for (const TableRow& row : kTable) {
    const Example& example = kExamples[row.example];
    const std::string name =
        fmt::format("{}, {} particles, dt = {:.0f} ms", example.name, example.particles, 1e3 * row.dt);
    page.add("| {} |", name);
    quality.add("| {} |", name);
    for (int c = 0; c < 4; ++c) {
      const Run run =
          animate(example, track[row.example], {kColumns[c].mechanics, kColumns[c].iterations, row.dt, theirs});
      page.add(" {}, **{:.1f}**{} |", row.theirs[c], run.ms, run.stable ? "" : " not stable");
      unstable[c / 2] += !run.stable;
      quality.add(" {:.1f} / {:.1f}; {}, {} of {}, {} |", run.p1, run.angle, run.most_inverted, run.frames_inverted,
                  run.frames, run.inverted_at_end);
    }
    page.add("\n");
    quality.add("\n");
  }
  page.add(
      "\nNot stable: {} of the runs with finite elements, {} of those with springs. isoskin moves no vertex by more "
      "than half an edge in a step, whatever its elements.\n",
      unstable[0], unstable[1]);
  page.add(
      "\nSmallest angles (1 % / mean, degrees, medians over frames); inverted triangles at most at once, in how many "
      "of the frames "
      "any, at the end:\n\n| | FEM, 2 it. | FEM, 10 it. | springs, 2 it. | springs, 10 it. "
      "|\n|---|---|---|---|---|\n{}\n",
      quality.text);
}

/// Every 20th vertex is thrown over an opposite edge; how many of the triangles that turns are left after some steps.
void add_thrown(Page& page, const Example& example, const TrackOptions& track) {
  page.add(
      "Inversions survived: in the mesh of {} at rest every 20th vertex is thrown over the edge opposite to it; "
      "inverted triangles "
      "left after steps of 40 ms, 10 iterations, no edge altered:\n\n"
      "| | thrown | 1 | 2 | 5 | 10 | 30 |\n|---|---|---|---|---|---|---|\n",
      example.name);
  for (const Mechanics mechanics : {Mechanics::fem, Mechanics::springs}) {
    Skin skin(example, track, mechanics, 10, kDt, false);
    const std::shared_ptr<const Field> field = example.field(0.0);
    for (int settle = 0; settle < 20; ++settle) skin.step(field, false);
    const std::vector<Index> out = outgoing_halfedges(skin.mesh);
    for (Index v = 0; v < skin.mesh.vertex_count(); v += 20) {
      const Index h = TriangleMesh::next(out[v]);  // the edge opposite to it
      const Vec3 middle = 0.5f * (skin.mesh.position(skin.mesh.from(h)) + skin.mesh.position(skin.mesh.to(h)));
      skin.mesh.vertices.position[v] += 1.6f * (middle - skin.mesh.position(v));
    }
    skin.backend->set_mesh(skin.mesh);
    skin.backend->inverted_triangles(skin.inverted);
    page.add("| {} | {} |", mechanics == Mechanics::fem ? "FEM" : "springs", skin.count_inverted());
    for (int step = 1; step <= 30; ++step) {
      skin.step(field, false);
      if (step == 1 || step == 2 || step == 5 || step == 10 || step == 30) page.add(" {} |", skin.count_inverted());
    }
    page.add("\n");
  }
  page.add("\n");
}

/// The same animation played faster and faster.
void add_speeds(Page& page, const Example& example, const TrackOptions& track) {
  page.add(
      "How fast may it be? {} played faster, dt = 40 ms, 10 iterations, isoskin's constants: inverted triangles at "
      "most at once, "
      "frames with any of how many.\n\n| speed | FEM | springs |\n|---|---|---|\n",
      example.name);
  for (const double speed : {1.0, 4.0, 8.0, 16.0, 32.0}) {
    page.add("| {:.0f} |", speed);
    for (const Mechanics mechanics : {Mechanics::fem, Mechanics::springs}) {
      const Run run = animate(example, track, {mechanics, 10, kDt, false, speed});
      page.add(" {}, {} of {}{} |", run.most_inverted, run.frames_inverted, run.frames,
               run.stable ? "" : ", not stable");
    }
    page.add("\n");
  }
  page.add("\n");
}

/// What may keep springs from becoming unstable: the bound of a step's moves, altered edges, stretched springs.
void add_bounds(Page& page, const Example& example, const TrackOptions& track) {
  page.add(
      "Why are ours never \"not stable\", where the paper's springs were on example 4 at 40 ms? Not for the "
      "bound of moves (half an edge), nor for softness, as the table shows: {}, springs, 10 iterations, "
      "each remedy taken away in turn; inverted triangles at most at once, frames with any. (I + dt K) dx = "
      "dt f is stable at any step when K has no negative eigenvalue. Only a spring shorter than at rest "
      "could give it some, and isoskin leaves those out (core/mechanics/element.h; the paper does not say "
      "what it does). With the papers' constants edges are from 1 to 2 times as long as at rest, so there "
      "is none. With isoskin's there are many, and springs do invert triangles where edges are not altered, "
      "which finite elements do not. The paper's example 4 is not known; ours may be tamer.\n\n"
      "| constants | dt, ms | k | springs | without the bound | without altered edges | without both | FEM without "
      "both "
      "| springs shorter than at rest, % |\n|---|---|---|---|---|---|---|---|---|\n",
      example.name);
  struct Row {
    bool theirs;
    double dt;
    float stiffness;
  };
  for (const Row& row : {Row{true, 0.04, 100.0f},
                         {true, 0.01, 100.0f},
                         {true, 0.04, 10000.0f},
                         {false, 0.04, 100.0f},
                         {false, 0.04, 10000.0f}}) {
    page.add("| {} | {:.0f} | {:.0f} |", row.theirs ? "the papers'" : "isoskin's", 1e3 * row.dt, row.stiffness);
    double compressed = 0.0;
    const auto cell = [&](Mechanics mechanics, bool bounded, bool altering) {
      Settings s{mechanics, 10, row.dt, row.theirs};
      s.stiffness = row.stiffness;
      s.bounded = bounded;
      s.altering = altering;
      const Run run = animate(example, track, s);
      page.add(" {}, {} of {}{} |", run.most_inverted, run.frames_inverted, run.frames,
               run.stable ? "" : fmt::format(", not stable after {} frames", run.frames));
      if (bounded && altering) compressed = run.compressed;
    };
    cell(Mechanics::springs, true, true);
    cell(Mechanics::springs, false, true);
    cell(Mechanics::springs, true, false);
    cell(Mechanics::springs, false, false);
    cell(Mechanics::fem, false, false);
    page.add(" {:.0f} |\n", 100.0 * compressed);
  }
  page.add("\n");
}

struct AngleRow {
  double angle;
  int triangles, frames_per_second;  // theirs
};

/// Whole frames of the tracker, and pictures of 512 x 512 by the software rasterizer.
void add_angles(Page& page, const Example& example, TrackOptions track, std::span<const AngleRow> rows) {
  page.add(
      "| alpha_r | triangles: theirs, ours | frames a second: theirs, ours | ours without the picture | mechanics, ms "
      "| "
      "certificate, ms | refinement, ms | picture, ms |\n|---|---|---|---|---|---|---|---|\n");
  for (const AngleRow& row : rows) {
    track.refine.angle = float(row.angle);
    Tracker tracker(make_opencl_backend(), track);
    std::vector<double> mechanics, certify, refine, picture, triangles, frame_ms;
    constexpr int kFrames = 40;
    for (int frame = 0; frame <= kFrames; ++frame) {
      const FieldFrame given{frame, kDt * frame, example.field(kDt * frame), nullptr};
      const FrameReport report = tracker.advance(given);
      if (frame == 0) continue;
      double other = 0.0, certificate = 0.0, refinement = 0.0;
      for (const auto& [name, ms] : report.ms)
        (name == "certify" ? certificate : name == "refine" ? refinement : other) += ms;
      const Camera camera = frame_box(given.field->bounds(), 512, 512);
      const auto begin = std::chrono::steady_clock::now();
      rasterize(tracker.geometric().mesh, tracker.geometric().normal, camera);
      picture.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
      mechanics.push_back(other);
      certify.push_back(certificate);
      refine.push_back(refinement);
      triangles.push_back(double(report.geometric_triangles));
      frame_ms.push_back(other + certificate + refinement);
    }
    page.add("| {:.0f} | {}, **{:.0f}** | {}, **{:.0f}** | {:.0f} | {:.1f} | {:.1f} | {:.1f} | {:.1f} |\n", row.angle,
             row.triangles, median(triangles), row.frames_per_second, 1e3 / (median(frame_ms) + median(picture)),
             1e3 / median(frame_ms), median(mechanics), median(certify), median(refine), median(picture));
  }
  page.add("\n");
}

/// Mechanical mesh, geometric mesh with its edges, geometric mesh.
void add_figure14(Page& page, const TrackOptions (&track)[4]) {
  constexpr int kFrame = 40, kWidth = 200, kHeight = 150;
  std::vector<Image> pictures;
  for (int i = 0; i < 4; ++i) {
    TrackOptions options = track[i];
    options.refine.angle = 8.0f;
    Tracker tracker(make_opencl_backend(), options);
    for (int frame = 0; frame <= kFrame; ++frame)
      tracker.advance({frame, kDt * frame, kExamples[i].field(kDt * frame), nullptr});
    const Box box = kExamples[i].field(kDt * kFrame)->bounds();
    const GeometricMesh& skin = tracker.geometric();
    pictures.push_back(wire_picture(tracker.mechanical(), box, kThreeQuarters, kWidth, kHeight));
    pictures.push_back(wire_picture(skin.mesh, box, kThreeQuarters, kWidth, kHeight));
    pictures.push_back(plain_picture(skin.mesh, skin.normal, box, kThreeQuarters, kWidth, kHeight));
  }
  page.add("### Figure 14: the examples of tables 2 and 3, at 8 degrees\n\n");
  page.picture("figure14", contact_sheet(pictures, 3),
               "Examples 1 to 4, a second and a half in: mechanical mesh, geometric mesh, the same without edges");
}

}  // namespace

void add_skins(Page& page) {
  TrackOptions track[4];
  std::size_t events = 0;
  for (int i = 0; i < 4; ++i) {
    track[i] = options_for(kExamples[i]);
    events += count_events(kExamples[i], track[i]);
  }
  page.add("## Nesme and Bouthors 2006\n\n");
  add_skin_figures(page);
  add_figure14(page, track);
  page.add(
      "### Table 2: milliseconds a step, finite elements beside mass-springs\n\n"
      "Theirs on a Pentium M of 2 GHz in 2006, ours on the OpenCL device ({}). Scenes with as many skeleton elements "
      "(1/d^2) and "
      "particles as theirs, on paths of ours; of example 4 the paper tells neither, so here it has 12 and 5,000. "
      "Topology events and repairs that `track` counts in these animations: {}. A "
      "step is "
      "ALTERMESH and QUASI-STATIC. \"Not stable\" is: not finite, or a tenth of the triangles inverted at once. First "
      "the papers' "
      "constants (edges from 1 to 2 times the desired length, no flips, k = 100, E = 1000):\n\n",
      make_opencl_backend()->name(), events);
  add_table(page, track, true);
  page.add("With isoskin's own (0.8 to 1.33, flips; `isoskin track --mechanics fem` or `springs`):\n\n");
  add_table(page, track, false);
  add_bounds(page, kExamples[3], track[3]);
  add_thrown(page, kExamples[3], track[3]);
  add_speeds(page, kExamples[3], track[3]);
  page.add(
      "### Table 3: frames a second by angle of refinement, {}\n\nTheirs drawn by an nVidia Quadro FX Go1400, ours by "
      "llvmpipe on the CPU, 512 x 512. Our frame holds the certificate of topology, which theirs has not.\n\n",
      kExamples[0].name);
  constexpr AngleRow kTable3[] = {{37, 832, 58}, {26, 1847, 38}, {18, 3111, 25}, {8, 12475, 7}};
  add_angles(page, kExamples[0], track[0], kTable3);
  page.add(
      "## Bouthors and Nesme 2007\n\nIts figures 1, 6, 8, 9 and 10 are the report's 2, 9, 10, 13 and 14, above.\n\n");
  add_fluid_figures(page);
  page.add(
      "### Table 2: the same for the model of their first figure\n\nThe paper does not "
      "say what the "
      "model is; by its triangles it is as small as {}, which stands for it here.\n\n",
      kExamples[1].name);
  constexpr AngleRow kTable2[] = {{37, 326, 52}, {26, 1378, 22}, {18, 2130, 18}, {8, 12054, 7}};
  add_angles(page, kExamples[1], track[1], kTable2);
}

}  // namespace isoskin::papers
