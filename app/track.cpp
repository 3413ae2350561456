// isoskin track: a mesh for every frame, kept on the surface by the Tracker.
#include <chrono>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/cold_start.h"
#include "app/command.h"
#include "app/interrupt.h"
#include "app/meshing.h"
#include "app/options.h"
#include "app/progress.h"
#include "app/run_folder.h"
#include "core/trace.h"

namespace isoskin {
namespace {

using Clock = std::chrono::steady_clock;

struct TrackCommand {
  InputOptions input;
  BackendOptions backend;
  MeshingOptions meshing;
  std::string folder, trace, start;
  std::optional<std::string> frames;
  bool self_intersections = false, validate = false, resume = false, json = false, quiet = false;
  bool no_mechanical = false, no_geometric = false;
};

/// Everything that decides the meshes; --resume goes on only with the same.
Json deciding_options(const TrackCommand& command, const TrackOptions& options, const FieldSource& source,
                      const Field& first, const std::string& device) {
  const InputOptions& input = command.input;
  return {{"program", "isoskin"},
          {"version", ISOSKIN_VERSION},
          {"input", input.input},
          {"name", source.name()},
          {"frames", {source.first_frame(), source.last_frame()}},
          {"edge-length", options.edge_length},
          {"voxel", first.resolution()},
          {"angle", options.refine.angle},
          {"passes", options.refine.passes},
          {"sagitta", options.refine.sagitta},
          {"interpolation", input.interpolation},
          {"grid", input.grid},
          {"iso", input.iso ? Json(*input.iso) : Json()},
          {"smooth", input.smooth.value_or(0)},
          {"velocity", input.velocity},
          {"dt", source.frame_duration()},
          {"sharp", options.relax.sharp},
          {"mechanics", command.meshing.mechanics},
          {"topology", command.meshing.topology},
          {"start", command.start},
          {"mechanical", !command.no_mechanical},
          {"geometric", !command.no_geometric},
          {"device", device}};
}

void check(const TrackCommand& command) {
  if (command.resume && command.no_mechanical)
    throw InputError("--resume with --no-mechanical: expected the mechanical meshes, from which a run goes on");
  if (command.no_mechanical && command.no_geometric)
    throw InputError("--no-mechanical with --no-geometric: expected at least one mesh to write");
  if (!command.trace.empty()) {
    const std::filesystem::path folder = std::filesystem::absolute(command.trace).parent_path();
    if (!std::filesystem::is_directory(folder) || std::filesystem::is_directory(command.trace))
      throw InputError(fmt::format("--trace {}: expected a file in a folder that exists", command.trace));
  }
}

/// Of the grids that are about to be loaded; a scene may hold a skeleton, which loads at once.
std::optional<Interpolation> grid_interpolation(const InputOptions& input) {
  if (std::filesystem::path(input.input).extension() == ".toml") return std::nullopt;
  return input.interpolation == "linear" ? Interpolation::linear : Interpolation::cubic;
}

/// The mesh of the file that a run begins with; nothing when --start names none.
std::optional<TriangleMesh> start_file(const std::string& start) {
  if (start.empty() || extract_method(start)) return std::nullopt;
  PlyMesh file = read_ply(start);
  if (!file.closed) throw InputError(fmt::format("--start {}: {}; expected a closed mesh", start, file.open_reason));
  return std::move(file.mesh);
}

double milliseconds(Clock::time_point since) {
  return std::chrono::duration<double, std::milli>(Clock::now() - since).count();
}

struct Loader {
  FieldSource& source;

  FieldFrame load(int frame) {
    const Span span("load");
    const auto begin = Clock::now();
    FieldFrame loaded = source.load(frame);
    ms = milliseconds(begin);
    return loaded;
  }
  double ms = 0.0;  // of the last call
};

void print_summary(const TrackCommand& command, const RunFolder& folder, int first, int last, double seconds) {
  const auto range = [&](const std::filesystem::path& a, const std::filesystem::path& b) {
    return first == last ? a.string() : fmt::format("{} .. {}", a.string(), b.filename().string());
  };
  fmt::print("{} frames in {}\n", last - first + 1, readable_time(seconds));
  if (!command.no_mechanical)
    fmt::print("mechanical meshes  {}\n", range(folder.mechanical_path(first), folder.mechanical_path(last)));
  if (!command.no_geometric)
    fmt::print("geometric meshes   {}\n", range(folder.geometric_path(first), folder.geometric_path(last)));
  fmt::print("report             {}\nledger             {}\n", folder.report_path().string(),
             folder.ledger_path().string());
}

int run(const TrackCommand& command) {
  check(command);
  const FrameRange range = command.frames ? parse_frame_range(*command.frames) : FrameRange{};
  const auto threads = limit_threads(command.backend.threads);
  trace::enable(!command.trace.empty());
  const auto begin = Clock::now();

  const Scene scene = open_frames(command.input, range);
  ColdStart cold_start(command.backend, grid_interpolation(command.input));
  Loader loader{*scene.source};
  const int first = scene.source->first_frame(), last = scene.source->last_frame();
  FieldFrame frame = loader.load(first);
  TrackOptions options = track_options(command.meshing, scene.meshing, *frame.field);
  options.validate = command.validate;
  options.self_intersections = command.self_intersections;
  std::optional<TriangleMesh> start;
  if (!command.resume) start = start_file(command.start);
  cold_start.wait(command.quiet || command.json);
  std::unique_ptr<Backend> backend = make_backend(command.backend, trace::enabled());
  if (const auto method = extract_method(command.start); method && !command.resume)
    start = extract_surface(frame.field, *backend, {*method, options}).mesh;
  RunFolder folder(command.folder, scene.source->name(), {!command.no_mechanical, !command.no_geometric},
                   deciding_options(command, options, *scene.source, *frame.field, backend->name()));
  Tracker tracker(std::move(backend), options);
  if (start) tracker.start(std::move(*start));

  std::optional<FieldFrame> following;  // the second frame tells the first how it moves
  int next = first;
  if (!command.resume) {
    folder.start();
  } else if (const std::optional<int> done = folder.resume(first, last)) {
    if (frame.frame != *done) frame = loader.load(*done);
    PlyMesh skin = read_ply(folder.mechanical_path(*done));
    tracker.resume(std::move(skin.mesh), frame, skin.header.critical_points);
    next = *done + 1;
  }
  catch_interrupts();
  {
    Progress progress(next - first, last - first + 1, command.quiet);
    for (; next <= last && !interrupted(); ++next) {
      if (frame.frame != next) frame = following ? *std::exchange(following, {}) : loader.load(next);
      if (next == first && next < last) following = loader.load(next + 1);
      const auto frame_begin = Clock::now();
      FrameReport report = tracker.advance(frame, following ? &*following : nullptr);
      cold_start.note_first_frame();
      report.ms.emplace(report.ms.begin(), "load", loader.ms);
      folder.write_frame(frame, std::move(report), tracker, loader.ms + milliseconds(frame_begin),
                         [&](const Json& line) {
                           if (!command.json) return;
                           fmt::print("{}\n", line.dump());
                           std::fflush(stdout);  // whoever reads the lines wants them as frames finish
                         });
      progress.step();
    }
    folder.finish();
  }
  if (trace::enabled()) trace::write(command.trace);
  if (next <= last) {
    fmt::print(stderr, "isoskin: interrupted after {} of {} frames; --resume goes on\n", next - first,
               last - first + 1);
    return kInterrupted;
  }
  if (!command.json && !command.quiet) print_summary(command, folder, first, last, 1e-3 * milliseconds(begin));
  return kOk;
}

}  // namespace

void add_track(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("track", "Writes a mechanical and a geometric mesh for every frame");
  const auto o = std::make_shared<TrackCommand>();
  command
      ->add_option("input", o->input.input, "A .vdb file, a pattern (dam.%04d.vdb), a folder, a glob or a scene.toml")
      ->required();
  command->add_option("-o,--output", o->folder, "Folder for meshes and reports")->required();
  command->add_option("--frames", o->frames, "A:B, first and last frame (default: all)");
  add_meshing_options(*command, o->meshing);
  add_input_options(*command, o->input);
  add_backend_options(*command, o->backend);
  command->add_flag("--no-mechanical", o->no_mechanical, "Do not write mechanical meshes");
  command->add_flag("--no-geometric", o->no_geometric, "Do not write geometric meshes");
  command->add_option("--start", o->start,
                      "The first frame's mesh: a closed .ply, or how to make one: marching-cubes, particles, "
                      "spring-lattice "
                      "(default: marching cubes on the fine lattice, coarsened)");
  command->add_flag("--resume", o->resume, "Go on with a run that was stopped");
  command->add_flag("--validate", o->validate, "Check both meshes after every frame");
  command->add_flag("--self-intersections", o->self_intersections,
                    "Count the pairs of triangles that overlap in the mechanical mesh too");
  command->add_option("--trace", o->trace, "Write a Chrome trace of host steps and kernels");
  command->add_flag("--json", o->json, "Print the report's lines on standard output");
  command->add_flag("--quiet", o->quiet, "No progress, no summary");
  command->footer(
      "Example:\n  isoskin track 'dam_break/dam_break.%04d.vdb' -o out --frames 1:24 --angle 18\n"
      "  isoskin track 'dam_break/dam_break.%04d.vdb' -o out --frames 1:24 --angle 18 --resume");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
