// Pictures like the papers' own: Nesme-Bouthors 2006 figures 1, 2, 9, 10 and 13, Bouthors-Nesme 2007 figures 11 and 12,
// Rumiano 2007 figures 9 to 12.
#include <algorithm>

#include "core/extract.h"
#include "core/field/skeleton_field.h"
#include "core/io/scene.h"
#include "core/topology/critical_points.h"
#include "kernels/opencl_backend.h"
#include "perf/papers/drawing.h"
#include "perf/papers/page.h"
#include "tests/morse_scenes.h"
#include "tests/test_meshes.h"

namespace isoskin::papers {
namespace {

/// A scene of tests/data, tracked.
struct Tracked {
  Scene scene;
  Tracker tracker;
  FrameReport report;
  std::string events;  // of all frames so far

  Tracked(const char* file, const TrackOptions& options, int first, const SequenceOptions& reading = {})
      : scene(load_scene(std::string(ISOSKIN_TEST_DATA "/") + file, reading)),
        tracker(make_opencl_backend(), resolved(options, *scene.source->load(first).field)) {
    follow(first, first);
  }
  void follow(int from, int to) {
    for (int frame = from; frame <= to; ++frame) {
      report = tracker.advance(scene.source->load(frame));
      for (const LedgerEntry& entry : tracker.ledger())
        events += fmt::format("{}{} in frame {}", events.empty() ? "" : ", ", entry.kind, frame);
    }
  }
};

/// Of what is drawn: a skeleton field's own bounds are wider.
Box box_of(const TriangleMesh& mesh) {
  Box box;
  for (const Vec3& p : mesh.vertices.position) box.add(DVec3(p));
  return box;
}

TriangleMesh colored(TriangleMesh mesh, const Vec3& color) {
  std::fill(mesh.vertices.rest.begin(), mesh.vertices.rest.end(), color);
  return mesh;
}

/// What lies behind the plane y = 0, an open mesh.
TriangleMesh far_half(const TriangleMesh& mesh) {
  TriangleMesh half;
  half.vertices = mesh.vertices;
  for (Index h = 0; h < mesh.vertex.size(); h += 3) {
    float y = 0.0f;
    for (Index k = h; k < h + 3; ++k) y += mesh.position(mesh.vertex[k]).y;
    if (y > 0.0f) half.vertex.insert(half.vertex.end(), &mesh.vertex[h], &mesh.vertex[h] + 3);
  }
  return half;
}

void add_crossing(Page& page) {
  constexpr int kFrames[] = {20, 30, 40, 64};
  const Box box{DVec3(-1.6, -0.8, -0.8), DVec3(1.6, 0.8, 0.8)};
  std::vector<Image> pictures;
  std::string events;
  for (const auto& [name, topology] : {std::pair("critical", Topology::critical), {"collision", Topology::collision}}) {
    TrackOptions options;
    options.topology = topology;
    options.edge_length = 0.06;
    Tracked run("two_points.toml", options, 1);
    int at = 1;
    for (const int frame : kFrames) {
      run.follow(at + 1, frame);
      at = frame;
      pictures.push_back(plain_picture(run.tracker.geometric().mesh, run.tracker.geometric().normal, box,
                                       {0.0, -1.0, 0.45}, 200, 110));
    }
    events += fmt::format(" `{}`: {}.", name, run.events);
  }
  page.add("### Figure 1: two skeleton elements cross each other\n\n");
  page.picture("figure1", contact_sheet(pictures, 4),
               "Frames 20, 30, 40 and 64 of tests/data/two_points.toml, by critical points and by collisions");
  page.add("`isoskin track tests/data/two_points.toml --edge-length 0.06 --topology critical|collision -o out`.{}\n\n",
           events);
}

void add_equilibrium(Page& page) {
  constexpr int kFrame = 30;
  TrackOptions options;
  options.edge_length = 0.16;
  const Tracked run("metaballs7.toml", options, kFrame);
  const std::shared_ptr<const Field> field = run.scene.source->load(kFrame).field;
  const std::unique_ptr<Backend> backend = make_opencl_backend();
  ExtractOptions extract;
  extract.track = run.tracker.options();
  const TriangleMesh cubes = extract_surface(field, *backend, extract).mesh;
  const TriangleMesh& skin = run.tracker.mechanical();
  const ShapeStatistics before = shape_statistics(cubes), after = shape_statistics(skin);
  page.add("### Figure 2: from marching cubes to equilibrium\n\n");
  page.picture("figure2",
               beside(wire_picture(cubes, box_of(skin), kThreeQuarters, 300, 240),
                      wire_picture(skin, box_of(skin), kThreeQuarters, 300, 240)),
               "Seven metaballs: marching cubes, and the mechanical mesh at rest");
  page.add(
      "Smallest angles (worst / 1 % / mean): {:.1f} / {:.1f} / {:.1f} degrees before, {:.1f} / {:.1f} / {:.1f} "
      "after.\n\n",
      before.min_angle, before.p1_angle, before.mean_angle, after.min_angle, after.p1_angle, after.mean_angle);
}

void add_refinements(Page& page) {
  constexpr float kAngles[] = {37.0f, 26.0f, 18.0f, 8.0f};
  std::vector<Image> pictures;
  std::string counts;
  struct Object {
    const char* file;
    int frame;
    double edge_length;
  };
  for (const Object& object : {Object{"two_points.toml", 30, 0.14}, {"norm_p4.toml", 1, 0.25}}) {
    counts += fmt::format("{} {}", counts.empty() ? "" : ";", object.file);
    for (const float angle : kAngles) {
      TrackOptions options;
      options.edge_length = object.edge_length;
      options.refine.angle = angle;
      options.sagitta = 0.0;
      const Tracked run(object.file, options, object.frame);
      pictures.push_back(
          wire_picture(run.tracker.geometric().mesh, box_of(run.tracker.mechanical()), kThreeQuarters, 200, 150));
      counts += fmt::format(" {}", run.report.geometric_triangles);
    }
  }
  page.add("### Figure 9: refinement at 37, 26, 18 and 8 degrees; the second row has the norm of exponent 4\n\n");
  page.picture("figure9", contact_sheet(pictures, 4), "The geometric mesh by alpha_r");
  page.add("Triangles: {}. `isoskin track SCENE --angle DEGREES --sagitta 0 -o out`.\n\n", counts);
}

/// Four mechanical triangles on a metaball.
void add_tetrahedron(Page& page) {
  SkeletonElement ball;
  const double iso = 0.2;
  ball.radius = 1.0 / std::sqrt(1.0 - std::cbrt(iso));  // whose surface has radius 1
  const auto field = std::make_shared<SkeletonField>(std::vector{ball}, iso);
  const TriangleMesh tetrahedron = test_meshes::tetrahedron();
  const Box sphere{DVec3(-1.0), DVec3(1.0)};
  const std::unique_ptr<Backend> backend = make_opencl_backend();
  backend->set_field(field);
  std::vector<Image> pictures{wire_picture(tetrahedron, sphere, kThreeQuarters, 200, 200)};
  std::string counts;
  for (const int passes : {1, 2, 3, 5}) {
    TrackOptions track;
    track.edge_length = shape_statistics(tetrahedron).mean_edge;
    track.refine.passes = passes;
    track = resolved(track, *field);
    const GeometricMesh made = refine(tetrahedron, *backend, track.refine, track.project);
    pictures.push_back(wire_picture(made.mesh, sphere, kThreeQuarters, 200, 200));
    counts += fmt::format(" {}", made.mesh.triangle_count());
  }
  page.add("### Figure 10: four mechanical triangles\n\n");
  page.picture("figure10", contact_sheet(pictures, 5), "The mechanical mesh, and 1, 2, 3 and 5 passes of refinement");
  page.add("Triangles: 4,{}.\n\n", counts);
}

/// A piece of a fluid, no matter where its pieces end.
Box detail_of(const Box& bounds) {
  const DVec3 size = bounds.size();
  return {bounds.low + DVec3(0.30, 0.20, 0.05) * size, bounds.low + DVec3(0.75, 0.8, 0.75) * size};
}

TriangleMesh within(const TriangleMesh& mesh, const Box& box) {
  TriangleMesh part;
  part.vertices = mesh.vertices;
  for (Index h = 0; h < mesh.vertex.size(); h += 3) {
    const DVec3 p(mesh.position(mesh.vertex[h]));
    if (glm::all(glm::greaterThan(p, box.low)) && glm::all(glm::lessThan(p, box.high)))
      part.vertex.insert(part.vertex.end(), &mesh.vertex[h], &mesh.vertex[h] + 3);
  }
  return part;
}

void add_creases(Page& page) {
  std::vector<Image> pictures;
  std::string counts;
  SequenceOptions reading;
  reading.grid.interpolation = Interpolation::linear;
  reading.first = reading.last = 34;
  const auto add = [&](const Tracked& run, const Box& box) {
    for (const TriangleMesh* mesh : {&run.tracker.mechanical(), &run.tracker.geometric().mesh})
      pictures.push_back(wire_picture(within(*mesh, box), box, kThreeQuarters, 200, 170));
    counts += fmt::format(" {}, {};", run.report.mechanical_triangles, run.report.geometric_triangles);
  };
  TrackOptions options;
  const Tracked fluid("dam_break.toml", options, 34, reading);
  add(fluid, detail_of(box_of(fluid.tracker.mechanical())));
  options.relax.sharp = true;
  for (const char* file : {"norm_p1.toml", "norm_p06.toml"}) {
    options.edge_length = 0.12;
    Tracked ball(file, options, 1);
    ball.follow(2, 8);
    add(ball, box_of(ball.tracker.geometric().mesh));
  }
  page.add("### Figure 13, and the other paper's 9: fields without second derivatives\n\n");
  page.picture("figure13-creases", contact_sheet(pictures, 6),
               "A fluid between whose voxels is interpolated linearly; balls of the norms with exponents 1 and 0.6");
  page.add(
      "Mechanical and geometric mesh of each;{} triangles. `isoskin track tests/data/dam_break.toml --interpolation "
      "linear -o out`, `isoskin track tests/data/norm_p1.toml --sharp --edge-length 0.12 -o out`.\n\n",
      counts);
}

/// Grey skin cut open, with its field's critical points: maxima red, 2-saddles blue.
void add_tracked_points(Page& page) {
  const Box box{DVec3(-1.5, -0.8, -0.8), DVec3(1.5, 0.8, 0.8)};
  TrackOptions options;
  options.edge_length = 0.06;
  Tracked run("two_points.toml", options, 24);
  std::vector<Image> pictures;
  std::string counts;
  for (int frame = 25; frame <= 41; ++frame) {
    run.follow(frame, frame);
    if (frame != 26 && frame != 34 && frame != 41) continue;
    const std::shared_ptr<const Field> field = run.scene.source->load(frame).field;
    TriangleMesh shown = far_half(colored(run.tracker.mechanical(), Vec3(0.25f)));
    int maxima = 0, saddles = 0;
    for (const DVec3& p : run.tracker.critical_points().value_or(std::vector<DVec3>{})) {
      const CriticalKind kind = describe_critical_point(*field, p, {}).kind;
      if (kind != CriticalKind::maximum && kind != CriticalKind::two_saddle) continue;
      const bool maximum = kind == CriticalKind::maximum;
      ++(maximum ? maxima : saddles);
      const Vec3 color = maximum ? Vec3(0.75f, 0.03f, 0.02f) : Vec3(0.02f, 0.08f, 0.7f);
      append(shown, colored(test_meshes::icosphere(2, 0.06f, Vec3(p)), color));
    }
    pictures.push_back(colored_picture(shown, box, {0.0, -1.0, 0.25}, 260, 170));
    counts += fmt::format("{} {} and {}", counts.empty() ? "" : ",", maxima, saddles);
  }
  page.add("### Figure 9: critical points that are followed\n\n");
  page.picture("rumiano9", contact_sheet(pictures, 3),
               "Frames 26, 34 and 41 of tests/data/two_points.toml, cut open: maxima red, 2-saddles blue");
  page.add("Maxima and 2-saddles:{}.\n\n", counts);
}

/// Each vertex goes on to its neighbour of the least gradient, until there is none lower.
TriangleMesh regions_of_least_gradient(TriangleMesh mesh, const Field& field) {
  const std::size_t count = mesh.vertex_count();
  std::vector<double> slope(count);
  for (std::size_t v = 0; v < count; ++v) slope[v] = glm::length(field.sample(DVec3(mesh.position(Index(v)))).gradient);
  std::vector<Index> lowest(count);
  for (Index v = 0; v < count; ++v) lowest[v] = v;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (slope[mesh.to(h)] < slope[lowest[mesh.from(h)]]) lowest[mesh.from(h)] = mesh.to(h);
  constexpr Vec3 kColors[] = {{0.7f, 0.08f, 0.05f}, {0.05f, 0.3f, 0.7f}, {0.1f, 0.5f, 0.1f}, {0.75f, 0.5f, 0.05f},
                              {0.4f, 0.1f, 0.6f},   {0.05f, 0.5f, 0.5f}, {0.6f, 0.3f, 0.3f}};
  for (Index v = 0; v < count; ++v) {
    Index root = v;
    while (lowest[root] != root) root = lowest[root];
    mesh.vertices.rest[v] = root == v ? Vec3(1.0f) : kColors[root % std::size(kColors)];
  }
  return mesh;
}

void add_least_gradients(Page& page) {
  std::vector<Image> pictures;
  for (const char* file : {"metaballs7.toml", "chain12.toml"}) {
    const Tracked run(file, {}, 1);
    const std::shared_ptr<const Field> field = run.scene.source->load(1).field;
    pictures.push_back(colored_picture(regions_of_least_gradient(run.tracker.mechanical(), *field),
                                       box_of(run.tracker.mechanical()), kThreeQuarters, 300, 220));
  }
  page.add("### Figure 10: where the search for critical points starts\n\n");
  page.picture("rumiano10", contact_sheet(pictures, 2),
               "Vertices whose gradient is the least about (white) and the regions that run down to them");
}

void add_eight_events(Page& page) {
  constexpr double kSpeed = 0.8;  // of the scenes' parameter, a frame
  constexpr int kLast = 3;        // the event is between frames 1 and 2
  std::vector<Image> pictures;
  std::string events;
  for (const test::MorseScene& scene : test::kMorseScenes)
    for (const bool rising : {true, false}) {
      const auto field = [&](int frame) {
        return std::make_shared<SkeletonField>(scene.elements((rising ? 1.0 : -1.0) * (frame - 0.5 * kLast) * kSpeed),
                                               scene.iso);
      };
      TrackOptions options;
      options.edge_length = scene.edge;
      Tracker tracker(make_opencl_backend(), resolved(options, *field(rising ? kLast : 0)));
      for (int frame = 0; frame <= kLast; ++frame) {
        tracker.advance({frame, 0.04 * frame, field(frame), nullptr});
        for (const LedgerEntry& entry : tracker.ledger())
          if (frame > 0) events += fmt::format(" {} (tier {}),", entry.kind, entry.tier);
        if (!rising || (frame > 0 && frame < kLast)) continue;
        const bool hollow = scene.rising == std::string("burst_bubble");
        const TriangleMesh& skin = tracker.geometric().mesh;
        pictures.push_back(plain_picture(hollow ? far_half(skin) : skin, {}, Box{DVec3(-1.1), DVec3(1.1)},
                                         {-0.3, -1.0, 0.6}, 130, 130));
      }
    }
  if (!events.empty()) events.back() = '.';
  page.add("### Figure 12: the eight operations\n\n");
  page.picture("rumiano12", contact_sheet(pictures, 8),
               "Create and destroy; connect and cut; spackle and pierce; burst and open a bubble (cut open)");
  page.add("The ledger, each there and back:{}\n\n", events);
}

}  // namespace

void add_skin_figures(Page& page) {
  add_crossing(page);
  add_equilibrium(page);
  add_refinements(page);
  add_tetrahedron(page);
  add_creases(page);
}

void add_fluid_figures(Page& page) {
  constexpr int kFirst = 32, kFrames[] = {34, 38, 42};
  SequenceOptions reading;
  reading.first = kFirst;
  Tracked run("dam_break.toml", {}, kFirst, reading);
  const DVec3 kFrom(-0.35, -0.9, 0.3);
  std::vector<Image> mechanical, geometric;
  const Box box = box_of(Tracked("dam_break.toml", {}, kFrames[2]).tracker.mechanical());
  int at = kFirst;
  std::string counts;
  for (const int frame : kFrames) {
    run.follow(at + 1, frame);
    at = frame;
    mechanical.push_back(wire_picture(run.tracker.mechanical(), box, kFrom, 300, 190));
    geometric.push_back(
        plain_picture(run.tracker.geometric().mesh, run.tracker.geometric().normal, box, kFrom, 300, 190));
    counts += fmt::format("{} {} and {}", counts.empty() ? "" : ",", run.report.mechanical_triangles,
                          run.report.geometric_triangles);
  }
  mechanical.insert(mechanical.end(), geometric.begin(), geometric.end());
  page.add("### Figures 11 and 12: a fluid on a grid (and Rumiano's figure 11)\n\n");
  page.picture("figure11", contact_sheet(mechanical, 3),
               "Mechanical and geometric meshes of tests/data/dam_break, frames 34, 38 and 42");
  page.add(
      "Triangles, mechanical and geometric:{}. `isoskin track tests/data/dam_break.toml --frames 32:42 -o out`.\n\n",
      counts);
}

void add_critical_figures(Page& page) {
  add_tracked_points(page);
  add_least_gradients(page);
  add_eight_events(page);
}

}  // namespace isoskin::papers
