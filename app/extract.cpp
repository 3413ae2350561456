// isoskin extract: one mesh of one frame, by the method that is asked for.
#include <chrono>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/json_lines.h"
#include "app/meshing.h"
#include "app/options.h"
#include "core/io/ply.h"

namespace isoskin {
namespace {

struct ExtractCommand {
  InputOptions input;
  BackendOptions backend;
  std::optional<double> edge_length;
  std::string method = "marching-cubes", output;
  std::uint64_t seed = ExtractOptions{}.seed;
  std::optional<int> frame;
  bool json = false;
};

void print(const ExtractCommand& command, const Extraction& made, double edge_length, double ms) {
  const ShapeStatistics shape = shape_statistics(made.mesh);
  const MeshPieces pieces = mesh_pieces(made.mesh);
  int euler = 0;
  for (const int piece : pieces.euler) euler += piece;
  if (command.json) {
    const Json line{{"output", command.output},
                    {"method", command.method},
                    {"story", made.story},
                    {"triangles", made.mesh.triangle_count()},
                    {"vertices", made.mesh.vertex_count()},
                    {"pieces", pieces.count()},
                    {"euler", euler},
                    {"certified", made.certificate.passed},
                    {"faults", made.certificate.summary()},
                    {"angles", {{"min", shape.min_angle}, {"p1", shape.p1_angle}, {"mean", shape.mean_angle}}},
                    {"mean_edge", shape.mean_edge},
                    {"edge_length", edge_length},
                    {"ms", ms}};
    fmt::print("{}\n", line.dump());
    return;
  }
  fmt::print("{}: {} triangles, {} vertices, {:.0f} ms\n", command.output, made.mesh.triangle_count(),
             made.mesh.vertex_count(), ms);
  fmt::print("{:<16}{}\n", command.method, made.story);
  fmt::print("{:<16}{} of Euler characteristic {} in all; certificate {}\n", "pieces", pieces.count(), euler,
             made.certificate.summary());
  fmt::print("{:<16}least of a triangle {:.1f} at worst, {:.1f} for 1 %, {:.1f} on average, degrees\n", "angles",
             shape.min_angle, shape.p1_angle, shape.mean_angle);
  fmt::print("{:<16}{:.4g} on average, {:.4g} were asked for\n", "edges", shape.mean_edge, edge_length);
}

int run(const ExtractCommand& command) {
  const auto threads = limit_threads(command.backend.threads);
  const Scene scene = open_frames(command.input, {command.frame, command.frame});
  const FieldFrame frame = scene.source->load(command.frame.value_or(scene.source->first_frame()));
  MeshingOptions meshing;
  meshing.edge_length = command.edge_length;
  ExtractOptions options;
  options.method = *extract_method(command.method);
  options.seed = command.seed;
  options.track = track_options(meshing, scene.meshing, *frame.field);
  const std::unique_ptr<Backend> backend = make_backend(command.backend);
  const auto begin = std::chrono::steady_clock::now();
  const Extraction made = extract_surface(frame.field, *backend, options);
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  write_ply(command.output, made.mesh, made.normals, {frame.frame, frame.time});
  print(command, made, options.track.edge_length, ms);
  return made.certificate.passed ? kOk : kNo;
}

}  // namespace

void add_extract(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("extract", "Makes the mesh of one frame; exit status 1: it is not certified");
  const auto o = std::make_shared<ExtractCommand>();
  command->add_option("input", o->input.input, "A .vdb file, a sequence (see `track`) or a scene.toml")->required();
  command->add_option("-o,--output", o->output, "The .ply to write")->required();
  command
      ->add_option("--method", o->method,
                   "Marching cubes, particles joined by Delaunay triangles, or tetrahedra on springs")
      ->check(CLI::IsMember(extract_method_names()))
      ->capture_default_str();
  command->add_option("--frame", o->frame, "Frame to mesh (default: the first)");
  command->add_option("--edge-length", o->edge_length,
                      "Wanted edge, world units (default: 1.5 voxels, or 1/60 of the scene's diagonal)");
  command->add_flag("--json", o->json, "Print a line of JSON");
  command->add_option("--seed", o->seed, "Of the particles' random starts")->capture_default_str();
  add_input_options(*command, o->input);
  add_backend_options(*command, o->backend);
  command->footer(
      "Example:\n  isoskin extract eight.toml --method particles -o eight.ply\n"
      "  isoskin track eight.toml --start eight.ply -o out      (or --start particles)");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
