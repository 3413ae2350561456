// isoskin-bench: isoskin and other meshers (perf/peers.h) interleaved in one process on the same frames; prints
// Markdown.
//   isoskin-bench [--threads N] [--frames N] [--repeat N] [--edge-length E] [--angle D] [--sagitta S] [--only WHO]
//       SEQUENCE...
// --edge-length, --angle and --sagitta are those of `isoskin track`. A sequence is a pattern, a folder or a scene (what
// `isoskin track` takes), or made:NAME (perf/made_inputs.h). Times exclude reading and writing files; "end to end" is
// wall time with both. Medians over frames after the first, which has nothing to track yet; every frame is done
// --repeat times from the same state, in turns, and its median counts. Going back to that state loses what isoskin
// keeps of the frame before, as --resume does: --repeat 1 measures frames that follow each other. Peak memory is of
// further processes that run one mesher alone (--only).
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <tbb/global_control.h>

#include "core/io/frame_files.h"
#include "core/io/ply.h"
#include "core/io/scene.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "perf/made_inputs.h"
#include "perf/median.h"
#include "perf/peers.h"

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

/// What one mesher's frames came to, one entry a frame.
struct Series {
  std::vector<double> wall, core, end_to_end, triangles, mean_angle, p1_angle, vertex_error, centroid_error;

  /// Costs of one frame, all repetitions; `files`: wall milliseconds of reading and writing.
  void add(const std::vector<Cost>& costs, double files) {
    std::vector<double> walls, cores;
    for (const Cost& cost : costs) {
      walls.push_back(cost.wall);
      cores.push_back(cost.core);
    }
    wall.push_back(median(walls));
    core.push_back(median(cores));
    end_to_end.push_back(wall.back() + files);
  }

  void add(const TriangleMesh& mesh, const Field& field) {
    const ShapeStatistics shape = shape_statistics(mesh);
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

  std::string row(const std::string& input, const std::string& who) const {
    std::string times = "| | ";
    if (!wall.empty()) {
      const auto [low, high] = std::minmax_element(wall.begin(), wall.end());
      times = fmt::format("{:.1f} ({:.1f}-{:.1f}) | {:.1f} | {:.1f}", median(wall), *low, *high, median(core),
                          median(end_to_end));
    }
    const double each = core.empty() ? 0.0 : 1e3 * median(core) / std::max(1.0, median(triangles));
    return fmt::format("| {} | {} | {} | {:.0f} | {} | {:.1f} ({:.1f}) | {:.1f} ({:.1f}) | {:.4f} | {:.4f} |", input,
                       who, times, median(triangles), core.empty() ? "" : fmt::format("{:.3f}", each),
                       median(mean_angle), *std::min_element(mean_angle.begin(), mean_angle.end()), median(p1_angle),
                       *std::min_element(p1_angle.begin(), p1_angle.end()), median(vertex_error),
                       median(centroid_error));
  }
};

constexpr const char* kIsoskin = "isoskin";

struct Options {
  int threads = 4, frames = 20, repeat = 9;
  std::optional<double> edge_length;     // of isoskin's mechanical mesh
  std::optional<double> angle, sagitta;  // of its geometric mesh
  std::string only;                      // one mesher's name; empty: all
};

/// A sequence and its meshers, with what they came to.
class Bench {
public:
  Bench(const std::string& input, const Options& options, std::filesystem::path folder)
      : options_(options), folder_(std::move(folder)), scene_(open_input(input)) {
    if (std::filesystem::path(input).extension() == ".toml") return;  // no grid for others to mesh
    file_ = find_frames(input, ".vdb").file;
    for (perf::Peer& peer : perf::peers())
      if (options.only.empty() || options.only == peer.name) peers_.push_back({.peer = std::move(peer)});
  }

  void run() {
    const int first = scene_.source->first_frame();
    const int end = std::min(scene_.source->last_frame(), first + options_.frames);
    if (!options_.only.empty() && options_.only != kIsoskin) {  // no field in memory but theirs
      for (int frame = first + 1; frame <= end; ++frame)
        for (Contender& peer : peers_) peer_frame(peer, frame);
      return;
    }
    last_ = scene_.source->load(first);
    TrackOptions options;
    if (const auto e = options_.edge_length ? options_.edge_length : scene_.meshing.edge_length)
      options.edge_length = *e;
    if (options_.angle) options.refine.angle = float(*options_.angle);
    options.sagitta = options_.sagitta ? options_.sagitta : scene_.meshing.sagitta;
    Tracker tracker(make_opencl_backend(), resolved(options, *last_.field));
    tracker.advance(last_);
    if (options_.repeat == 1) last_ = {};
    for (int frame = first + 1; frame <= end; ++frame) run_frame(frame, tracker);
  }

  void print() const {
    const std::string name = scene_.source->name();
    if (!geometric_.wall.empty()) {
      std::puts(geometric_.row(name, "isoskin, geometric").c_str());
      std::puts(mechanical_.row(name, "isoskin, mechanical").c_str());
    }
    for (const auto& peer : peers_) {
      if (peer.series.wall.empty()) continue;
      std::puts(peer.series.row(name, peer.peer.name).c_str());
      if (!geometric_.wall.empty())
        std::puts(fmt::format("| {} | isoskin's share of it | {:.2f} | {:.2f} | {:.2f} | | | | | | |", name,
                              median(geometric_.wall) / median(peer.series.wall),
                              median(geometric_.core) / median(peer.series.core),
                              median(geometric_.end_to_end) / median(peer.series.end_to_end))
                      .c_str());
    }
    std::fflush(stdout);
    std::string steps;
    for (const std::string& step : step_order_) steps += fmt::format(" {} {:.1f}", step, median(step_.at(step)));
    if (!steps.empty()) std::fprintf(stderr, "%s: median ms by step:%s\n", name.c_str(), steps.c_str());
  }

  std::string name() const { return scene_.source->name(); }
  std::vector<std::string> meshers() const {
    std::vector<std::string> names{kIsoskin};
    for (const auto& peer : peers_) names.push_back(peer.peer.name);
    return names;
  }

private:
  struct Contender {
    perf::Peer peer;
    Series series{};
    std::vector<Cost> costs{};
    double files = 0.0;
    TriangleMesh mesh{};
  };

  /// One frame, again and again from the state before it, everyone in turns; the tracker goes on from the last.
  void run_frame(int frame, Tracker& tracker) {
    const bool repeats = options_.repeat > 1;  // else nothing is kept to go back to
    before_ = repeats ? tracker.mechanical() : TriangleMesh{};
    critical_points_ = tracker.critical_points();
    std::vector<Cost> costs;
    for (Contender& peer : peers_) peer.costs.clear();
    double files = 0.0;
    FieldFrame moment;
    for (int i = 0; i < options_.repeat; ++i) {
      files = own_frame(frame, i, tracker, moment, costs);
      for (Contender& peer : peers_) peer_frame(peer, frame);
    }
    geometric_.add(costs, files);
    geometric_.add(tracker.geometric().mesh, *moment.field);
    mechanical_.add(tracker.mechanical(), *moment.field);
    for (Contender& peer : peers_) {
      peer.series.add(peer.costs, peer.files);
      peer.series.add(peer.mesh, *moment.field);
    }
    if (repeats) last_ = moment;
  }

  /// One frame from the state before it; what its files took.
  double own_frame(int frame, int repetition, Tracker& tracker, FieldFrame& moment, std::vector<Cost>& costs) {
    if (repetition > 0) tracker.resume(before_, last_, critical_points_);
    const double reading = cost_of([&] { moment = scene_.source->load(frame); }).wall;
    FrameReport report;
    costs.push_back(cost_of([&] { report = tracker.advance(moment); }));
    for (const auto& [step, ms] : report.ms) {
      if (!step_.count(step)) step_order_.push_back(step);
      step_[step].push_back(ms);
    }
    const double writing = cost_of([&] {
                             write_ply(folder_ / "mechanical.ply", tracker.mechanical(), tracker.mechanical_normals());
                             write_ply(folder_ / "geometric.ply", tracker.geometric().mesh, tracker.geometric().normal);
                           }).wall;
    return reading + writing;
  }

  void peer_frame(Contender& contender, int frame) const {
    std::shared_ptr<const perf::PeerGrid> grid;
    const double reading = cost_of([&] { grid = perf::read_peer_grid(file_.at(frame).string()); }).wall;
    Cost total;
    contender.mesh = contender.peer.mesh(*grid, [&](const std::function<void()>& work) {
      const Cost cost = cost_of(work);
      total.wall += cost.wall;
      total.core += cost.core;
    });
    contender.costs.push_back(total);
    const double writing = cost_of([&] { write_ply(folder_ / "peer.ply", contender.mesh, {}); }).wall;
    contender.files = reading + writing;
  }

  std::map<int, std::filesystem::path> file_;  // by frame, for the others
  Options options_;
  std::filesystem::path folder_;
  Scene scene_;
  std::vector<Contender> peers_;
  Series geometric_, mechanical_;
  FieldFrame last_;
  TriangleMesh before_;
  std::optional<std::vector<DVec3>> critical_points_;
  std::map<std::string, std::vector<double>> step_;
  std::vector<std::string> step_order_;
};

/// MiB this process had in memory at most: its own, where getrusage() would tell its parent's.
double peak_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == "VmHWM:" && status >> word) return std::stod(word) / 1024.0;
  return 0.0;
}

/// What peak_mib() is of a process that runs this mesher alone, once a frame.
double peak_alone(const std::string& input, const Options& options, const std::string& who) {
  const std::string program = std::filesystem::read_symlink("/proc/self/exe").string();
  std::string refining;
  if (options.edge_length) refining += fmt::format(" --edge-length {}", *options.edge_length);
  if (options.angle) refining += fmt::format(" --angle {}", *options.angle);
  if (options.sagitta) refining += fmt::format(" --sagitta {}", *options.sagitta);
  const std::string command = fmt::format("'{}' --threads {} --frames {} --repeat 1{} --only '{}' '{}' 2>/dev/null",
                                          program, options.threads, options.frames, refining, who, input);
  FILE* output = popen(command.c_str(), "r");
  double peak = 0.0;
  char line[4096];
  while (output && std::fgets(line, sizeof line, output)) std::sscanf(line, "peak %lf MiB", &peak);
  if (!output || pclose(output) != 0)
    throw InputError("isoskin-bench --only " + who + ": failed; expected it to run as it did beside the others");
  return peak;
}

/// Files live in a folder of their own until the run is over.
class WorkFolder {
public:
  WorkFolder() : path_(std::filesystem::temp_directory_path() / fmt::format("isoskin-bench-{}", getpid())) {
    std::filesystem::create_directories(path_);
  }
  ~WorkFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;

  std::string make(const std::string& name, int frames) const { return perf::make_input(name, path_, frames); }
  const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
};

std::string usage() {
  std::string names, meshers = kIsoskin;
  for (const std::string& name : perf::made_inputs()) names += " made:" + name;
  for (const perf::Peer& peer : perf::peers()) meshers += ", " + peer.name;
  return fmt::format(
      "[--threads N] [--frames N] [--repeat N] [--edge-length E] [--angle D] [--sagitta S] [--only WHO] SEQUENCE...; "
      "a sequence may be one of{}; who: {}",
      names, meshers);
}

int unusable() {
  std::fprintf(stderr, "isoskin-bench: expected %s\n", usage().c_str());
  return 2;
}

void run(const std::vector<std::string>& inputs, const Options& options) {
  std::printf(
      "%d threads, %d repetitions of a frame; medians over frames (angles: least), milliseconds; errors in voxels "
      "(grids) or mean edges (skeletons)\n\n",
      options.threads, options.repeat);
  std::puts(
      "| input | who | wall (least-most) | core | end to end | triangles | core-us a triangle | angle mean (least) | "
      "angle p1 (least) | vertex error | centroid error |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|---|");
  const WorkFolder folder;
  constexpr std::string_view kMade = "made:";
  std::vector<std::string> peaks;
  for (const std::string& input : inputs) {
    const std::string opened =
        input.starts_with(kMade) ? folder.make(input.substr(kMade.size()), options.frames) : input;
    Bench bench(opened, options, folder.path());
    bench.run();
    bench.print();
    if (!options.only.empty()) {
      std::puts(fmt::format("peak {:.0f} MiB", peak_mib()).c_str());
      continue;
    }
    for (const std::string& who : bench.meshers())
      peaks.push_back(fmt::format("| {} | {} | {:.0f} |", bench.name(), who, peak_alone(opened, options, who)));
  }
  if (peaks.empty()) return;
  std::puts("\n| input | who, alone | peak MiB |\n|---|---|---|");
  for (const std::string& line : peaks) std::puts(line.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  const std::map<std::string, int*> numbers{
      {"--threads", &options.threads}, {"--frames", &options.frames}, {"--repeat", &options.repeat}};
  const std::map<std::string, std::optional<double>*> lengths{
      {"--edge-length", &options.edge_length}, {"--angle", &options.angle}, {"--sagitta", &options.sagitta}};
  std::vector<std::string> inputs;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--help") {
      std::printf("isoskin-bench %s\n", usage().c_str());
      return 0;
    }
    const auto number = numbers.find(word);
    if (number != numbers.end() && i + 1 < argc)
      *number->second = std::atoi(argv[++i]);
    else if (const auto length = lengths.find(word); length != lengths.end() && i + 1 < argc)
      *length->second = std::atof(argv[++i]);
    else if (word == "--only" && i + 1 < argc)
      options.only = argv[++i];
    else
      inputs.push_back(word);
  }
  if (inputs.empty() || options.threads < 1 || options.frames < 1 || options.repeat < 1) return unusable();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, std::size_t(options.threads));
  try {
    run(inputs, options);
  } catch (const InputError& error) {
    std::fprintf(stderr, "isoskin-bench: %s\n", error.what());
    return 2;
  } catch (const std::invalid_argument& error) {
    std::fprintf(stderr, "isoskin-bench: %s\n", error.what());
    return unusable();
  }
}
