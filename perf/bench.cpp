// isoskin-bench: isoskin and OpenVDB's volumeToMesh interleaved in one process on the same frames; prints Markdown.
//   isoskin-bench [--threads N] [--frames N] SEQUENCE...      (patterns, folders or scenes: what `isoskin track` takes)
// Times exclude reading files. Medians over frames after the first, which has nothing to track yet.
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/global_control.h>

#include "core/io/scene.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"

using namespace isoskin;
using perf::median;

namespace {

using Clock = std::chrono::steady_clock;

double cpu_ms() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto ms = [](const timeval& t) { return 1e3 * double(t.tv_sec) + 1e-3 * double(t.tv_usec); };
  return ms(usage.ru_utime) + ms(usage.ru_stime);
}

double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return double(usage.ru_maxrss) / 1024.0;
}

/// Wall and core time of a call, milliseconds.
struct Cost {
  double wall = 0, core = 0;
};

template <class Function>
Cost cost_of(Function&& function) {
  const double core = cpu_ms();
  const auto begin = Clock::now();
  function();
  return {std::chrono::duration<double, std::milli>(Clock::now() - begin).count(), cpu_ms() - core};
}

/// One column of figures, one entry a frame.
struct Series {
  std::vector<double> wall, core, triangles, mean_angle, p1_angle, vertex_error, centroid_error;

  void add(const Cost& cost, const TriangleMesh& mesh, const Field& field) {
    const ShapeStatistics shape = shape_statistics(mesh);
    wall.push_back(cost.wall);
    core.push_back(cost.core);
    triangles.push_back(double(mesh.triangle_count()));
    mean_angle.push_back(shape.mean_angle);
    p1_angle.push_back(shape.p1_angle);
    const double unit = field.resolution() > 0.0 ? field.resolution() : shape.mean_edge;
    double at_vertices = 0.0, at_centroids = 0.0;
    for (const Vec3& p : mesh.vertices.position) at_vertices += field.distance_estimate(DVec3(p), 0.1);
    for (Index h = 0; h < mesh.vertex.size(); h += 3)
      at_centroids +=
          field.distance_estimate((DVec3(mesh.position(mesh.vertex[h])) + DVec3(mesh.position(mesh.vertex[h + 1])) +
                                   DVec3(mesh.position(mesh.vertex[h + 2]))) /
                                      3.0,
                                  0.1);
    vertex_error.push_back(at_vertices / std::max<double>(1.0, double(mesh.vertex_count())) / unit);
    centroid_error.push_back(at_centroids / std::max<double>(1.0, double(mesh.triangle_count())) / unit);
  }

  std::string row(const std::string& input, const char* who) const {
    const double wall_median = median(wall);
    const auto [low, high] = std::minmax_element(wall.begin(), wall.end());
    return fmt::format(
        "| {} | {} | {:.1f} ({:.1f}-{:.1f}) | {:.1f} | {:.0f} | {:.3f} | {:.1f} | {:.1f} | {:.4f} | {:.4f} |", input,
        who, wall_median, *low, *high, median(core), median(triangles),
        1e3 * median(core) / std::max(1.0, median(triangles)), median(mean_angle), median(p1_angle),
        median(vertex_error), median(centroid_error));
  }
};

TriangleMesh mesh_by_openvdb(const openvdb::FloatGrid& grid, Cost& cost) {
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec3I> triangles;
  std::vector<openvdb::Vec4I> quads;
  cost = cost_of([&] { openvdb::tools::volumeToMesh(grid, points, triangles, quads, 0.0, 0.0); });
  TriangleMesh mesh;  // only positions and corners: what shape_statistics reads. OpenVDB winds clockwise.
  for (const auto& p : points) mesh.vertices.position.emplace_back(p.x(), p.y(), p.z());
  for (const auto& t : triangles) mesh.vertex.insert(mesh.vertex.end(), {t[2], t[1], t[0]});
  for (const auto& q : quads) mesh.vertex.insert(mesh.vertex.end(), {q[2], q[1], q[0], q[3], q[2], q[0]});
  return mesh;
}

openvdb::FloatGrid::Ptr read_float_grid(const std::string& path) {
  openvdb::io::File file(path);
  file.open();
  for (auto name = file.beginName(); name != file.endName(); ++name)
    if (auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid(*name))) return grid;
  return nullptr;
}

struct Run {
  Series geometric, openvdb;
  std::map<std::string, std::vector<double>> step;
  std::vector<std::string> step_order;
};

void run_sequence(const std::string& input, int frames) {
  Scene scene = open_input(input);
  std::unique_ptr<Tracker> tracker;
  Run run;
  const int first = scene.source->first_frame();
  const int last = std::min(scene.source->last_frame(), first + frames);
  for (int frame = first; frame <= last; ++frame) {
    const FieldFrame moment = scene.source->load(frame);
    if (!tracker) tracker = std::make_unique<Tracker>(make_opencl_backend(), resolved({}, *moment.field));
    FrameReport report;
    const Cost cost = cost_of([&] { report = tracker->advance(moment); });
    if (frame == first) continue;
    run.geometric.add(cost, tracker->geometric().mesh, *moment.field);
    for (const auto& [step, ms] : report.ms) {
      if (!run.step.count(step)) run.step_order.push_back(step);
      run.step[step].push_back(ms);
    }
    if (input.find('%') != std::string::npos) {
      char path[4096];
      std::snprintf(path, sizeof path, input.c_str(), frame);
      Cost peer;
      const TriangleMesh mesh = mesh_by_openvdb(*read_float_grid(path), peer);
      run.openvdb.add(peer, mesh, *moment.field);
    }
  }
  if (run.geometric.wall.empty()) return;
  const std::string name = scene.source->name();
  std::puts(run.geometric.row(name, "isoskin, geometric").c_str());
  if (!run.openvdb.wall.empty()) {
    std::puts(run.openvdb.row(name, "volumeToMesh").c_str());
    std::puts(fmt::format("| {} | ratio | {:.2f} | {:.2f} | | | | | | |", name,
                          median(run.geometric.wall) / median(run.openvdb.wall),
                          median(run.geometric.core) / median(run.openvdb.core))
                  .c_str());
  }
  std::string steps;
  for (const std::string& step : run.step_order) steps += fmt::format(" {} {:.1f}", step, median(run.step[step]));
  std::fprintf(stderr, "%s: median ms by step:%s; peak %.0f MiB so far\n", name.c_str(), steps.c_str(), peak_mib());
}

}  // namespace

int main(int argc, char** argv) {
  int threads = 4, frames = 20;
  std::vector<std::string> inputs;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if ((word == "--threads" || word == "--frames") && i + 1 < argc)
      (word == "--threads" ? threads : frames) = std::atoi(argv[++i]);
    else
      inputs.push_back(word);
  }
  if (inputs.empty() || threads < 1 || frames < 1) {
    std::fprintf(stderr, "isoskin-bench: expected [--threads N] [--frames N] SEQUENCE...\n");
    return 2;
  }
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
  openvdb::initialize();
  std::printf("%d threads; medians over frames, milliseconds; errors in voxels (grids) or mean edges (skeletons)\n\n",
              threads);
  std::puts(
      "| input | who | wall (least-most) | core | triangles | core-us a triangle | angle mean | angle p1 | vertex "
      "error | centroid error |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|");
  try {
    for (const std::string& input : inputs) run_sequence(input, frames);
  } catch (const InputError& error) {
    std::fprintf(stderr, "isoskin-bench: %s\n", error.what());
    return 2;
  }
}
