// isoskin-bench: isoskin and OpenVDB's volumeToMesh interleaved in one process on the same frames; prints Markdown.
//   isoskin-bench [--threads N] [--frames N] [--repeat N] SEQUENCE...
// A sequence is a pattern, a folder or a scene (what `isoskin track` takes), or made:NAME (perf/made_inputs.h). Times
// exclude reading files; the column "with reading" does not. Medians over frames after the first, which has nothing to
// track yet; with --repeat every frame is done so many times from the same state, in turns, and its median counts.
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
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
#include "perf/made_inputs.h"
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
  std::vector<double> wall, core, with_reading, triangles, mean_angle, p1_angle, vertex_error, centroid_error;

  /// Costs of one frame, all repetitions; `reading` in wall milliseconds.
  void add(const std::vector<Cost>& costs, double reading, const TriangleMesh& mesh, const Field& field) {
    const ShapeStatistics shape = shape_statistics(mesh);
    std::vector<double> walls, cores;
    for (const Cost& cost : costs) {
      walls.push_back(cost.wall);
      cores.push_back(cost.core);
    }
    wall.push_back(median(walls));
    core.push_back(median(cores));
    with_reading.push_back(wall.back() + reading);
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
        "| {} | {} | {:.1f} ({:.1f}-{:.1f}) | {:.1f} | {:.1f} | {:.0f} | {:.3f} | {:.1f} | {:.1f} | {:.4f} | {:.4f} |",
        input, who, wall_median, *low, *high, median(core), median(with_reading), median(triangles),
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

/// One frame, again and again from the state before it, isoskin and OpenVDB in turns; the tracker goes on from the
/// last.
void run_frame(const std::string& input, Scene& scene, int frame, int repeat, FieldFrame& last, Tracker& tracker,
               Run& run) {
  const TriangleMesh before = tracker.mechanical();
  const auto critical_points = tracker.critical_points();
  std::vector<Cost> own, peer;
  double reading = 0.0, peer_reading = 0.0;
  TriangleMesh mesh;
  FieldFrame moment;
  for (int i = 0; i < repeat; ++i) {
    if (i > 0) tracker.resume(before, last, critical_points);
    reading = cost_of([&] { moment = scene.source->load(frame); }).wall;
    FrameReport report;
    own.push_back(cost_of([&] { report = tracker.advance(moment); }));
    for (const auto& [step, ms] : report.ms) {
      if (!run.step.count(step)) run.step_order.push_back(step);
      run.step[step].push_back(ms);
    }
    if (input.find('%') == std::string::npos) continue;
    char path[4096];
    std::snprintf(path, sizeof path, input.c_str(), frame);
    openvdb::FloatGrid::Ptr grid;
    peer_reading = cost_of([&] { grid = read_float_grid(path); }).wall;
    mesh = mesh_by_openvdb(*grid, peer.emplace_back());
  }
  run.geometric.add(own, reading, tracker.geometric().mesh, *moment.field);
  if (!peer.empty()) run.openvdb.add(peer, peer_reading, mesh, *moment.field);
  last = moment;
}

void run_sequence(const std::string& input, int frames, int repeat) {
  Scene scene = open_input(input);
  Run run;
  const int first = scene.source->first_frame();
  const int end = std::min(scene.source->last_frame(), first + frames);
  FieldFrame last = scene.source->load(first);
  TrackOptions options;
  if (scene.meshing.edge_length) options.edge_length = *scene.meshing.edge_length;
  options.sagitta = scene.meshing.sagitta;
  Tracker tracker(make_opencl_backend(), resolved(options, *last.field));
  tracker.advance(last);
  for (int frame = first + 1; frame <= end; ++frame) run_frame(input, scene, frame, repeat, last, tracker, run);
  if (run.geometric.wall.empty()) return;
  const std::string name = scene.source->name();
  std::puts(run.geometric.row(name, "isoskin, geometric").c_str());
  if (!run.openvdb.wall.empty()) {
    std::puts(run.openvdb.row(name, "volumeToMesh").c_str());
    std::puts(fmt::format("| {} | ratio | {:.2f} | {:.2f} | {:.2f} | | | | | | |", name,
                          median(run.geometric.wall) / median(run.openvdb.wall),
                          median(run.geometric.core) / median(run.openvdb.core),
                          median(run.geometric.with_reading) / median(run.openvdb.with_reading))
                  .c_str());
  }
  std::string steps;
  for (const std::string& step : run.step_order) steps += fmt::format(" {} {:.1f}", step, median(run.step[step]));
  std::fprintf(stderr, "%s: median ms by step:%s; peak %.0f MiB so far\n", name.c_str(), steps.c_str(), peak_mib());
}

/// Frames of made:NAME live in a folder of their own until the run is over.
class MadeFolder {
public:
  MadeFolder() : path_(std::filesystem::temp_directory_path() / fmt::format("isoskin-bench-{}", getpid())) {}
  ~MadeFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  MadeFolder(const MadeFolder&) = delete;
  MadeFolder& operator=(const MadeFolder&) = delete;

  std::string make(const std::string& name, int frames) {
    std::filesystem::create_directories(path_);
    return perf::make_input(name, path_, frames);
  }

private:
  std::filesystem::path path_;
};

int usage() {
  std::string names;
  for (const std::string& name : perf::made_inputs()) names += " made:" + name;
  std::fprintf(
      stderr,
      "isoskin-bench: expected [--threads N] [--frames N] [--repeat N] SEQUENCE...; a sequence may be one of%s\n",
      names.c_str());
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  int threads = 4, frames = 20, repeat = 1;
  const std::map<std::string, int*> numbers{{"--threads", &threads}, {"--frames", &frames}, {"--repeat", &repeat}};
  std::vector<std::string> inputs;
  for (int i = 1; i < argc; ++i) {
    const auto number = numbers.find(argv[i]);
    if (number != numbers.end() && i + 1 < argc)
      *number->second = std::atoi(argv[++i]);
    else
      inputs.emplace_back(argv[i]);
  }
  if (inputs.empty() || threads < 1 || frames < 1 || repeat < 1) return usage();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
  openvdb::initialize();
  std::printf(
      "%d threads, %d repetitions of a frame; medians over frames, milliseconds; errors in voxels (grids) or mean "
      "edges "
      "(skeletons)\n\n",
      threads, repeat);
  std::puts(
      "| input | who | wall (least-most) | core | wall with reading | triangles | core-us a triangle | angle mean | "
      "angle p1 | vertex error | centroid error |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|---|");
  MadeFolder made;
  constexpr std::string_view kMade = "made:";
  try {
    for (const std::string& input : inputs)
      run_sequence(input.starts_with(kMade) ? made.make(input.substr(kMade.size()), frames) : input, frames, repeat);
  } catch (const InputError& error) {
    std::fprintf(stderr, "isoskin-bench: %s\n", error.what());
    return 2;
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "isoskin-bench: %s\n", error.what());
    return usage();
  }
}
