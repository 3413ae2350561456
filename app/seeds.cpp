// isoskin seeds: the seeds of a scene as scales or pieces. isoskin collide: do two scenes penetrate each other?
#include <chrono>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/options.h"
#include "core/io/ply.h"
#include "core/seeds/seeds.h"

namespace isoskin {
namespace {

constexpr double kSpacingsPerDiagonal = 60.0;

struct SeedsCommand {
  InputOptions input;
  BackendOptions backend;
  std::string output, as = "scales";
  std::optional<double> spacing;
  std::optional<int> frame;
};

struct CollideCommand {
  std::string first, second;
  BackendOptions backend;
  std::optional<double> spacing;
  std::optional<int> frame;
  bool all = false;
};

/// A scene's frame with its seeds.
struct Sown {
  std::shared_ptr<const Field> field;
  std::unique_ptr<Backend> backend;
  Seeds seeds;
  SeedReport report;
  FieldFrame frame;

  Sown(const InputOptions& input, std::optional<int> number, std::optional<double> spacing,
       const BackendOptions& options)
      : seeds(SeedOptions{}) {
    const Scene scene = open_frames(input, {number, number});
    frame = scene.source->load(number.value_or(scene.source->first_frame()));
    field = frame.field;
    const SkeletonParts parts = skeleton_parts(*field, input.input);
    const double diagonal = field->bounds().diagonal();
    SeedOptions seed_options;
    if (spacing) {
      require_range("--spacing", *spacing, diagonal / 4096.0, std::max(diagonal, 1e-300));
      seed_options.spacing = *spacing;
    } else if (diagonal > 0.0) {
      seed_options.spacing = diagonal / kSpacingsPerDiagonal;
    }
    backend = make_backend(options);
    backend->set_field(field);
    seeds = Seeds(seed_options);
    report = seeds.move_to(parts, *backend);
  }
};

int run(const SeedsCommand& command) {
  const auto threads = limit_threads(command.backend.threads);
  const Sown sown(command.input, command.frame, command.spacing, command.backend);
  const TriangleMesh mesh = command.as == "scales" ? sown.seeds.scales(*sown.backend) : sown.seeds.pieces();
  write_ply(command.output, mesh, {}, {sown.frame.frame, sown.frame.time});
  fmt::print("{}: {} triangles\n{} seeds, {} valid, {} without surface, {} evaluations of the field\n", command.output,
             mesh.triangle_count(), sown.report.seeds, sown.report.valid, sown.report.lost, sown.report.evaluations);
  return kOk;
}

int run(const CollideCommand& command) {
  const auto threads = limit_threads(command.backend.threads);
  InputOptions first, second;
  first.input = command.first;
  second.input = command.second;
  const Sown a(first, command.frame, command.spacing, command.backend);
  const Sown b(second, command.frame, command.spacing, command.backend);
  const Penetration found = find_penetration(a.seeds, *a.backend, b.seeds, *b.backend, command.all);
  const auto print = [&](const std::string& name, const Sown& object, const std::vector<Index>& seeds) {
    if (seeds.empty()) return;
    const Vec3& p = object.seeds.position()[seeds.front()];
    fmt::print("{}: {} seeds inside the other, the first at {:.6g} {:.6g} {:.6g}\n", name, seeds.size(), p.x, p.y, p.z);
  };
  print(command.first, a, found.of_first);
  print(command.second, b, found.of_second);
  fmt::print("{}, {} evaluations, {} without boxes\n", found.any() ? "penetrating" : "apart", found.evaluations,
             found.without_boxes);
  return found.any() ? kNo : kOk;
}

}  // namespace

void add_seeds(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("seeds", "Samples a scene's surface by seeds of its skeleton elements");
  const auto o = std::make_shared<SeedsCommand>();
  command->add_option("input", o->input.input, "A scene.toml of skeleton elements")->required();
  command->add_option("-o,--output", o->output, "The .ply to write")->required();
  command->add_option("--as", o->as, "Discs on the surface, or the closed grid of each element")
      ->check(CLI::IsMember({"scales", "pieces"}))
      ->capture_default_str();
  command->add_option("--spacing", o->spacing, "Of seeds, world units (default: 1/60 of the scene's diagonal)");
  command->add_option("--frame", o->frame, "Frame to sample (default: the first)");
  add_backend_options(*command, o->backend);
  command->footer(
      "Example:\n  isoskin seeds string.toml --as pieces -o pieces.ply && isoskin render pieces.ply -o pieces.exr");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

void add_collide(CLI::App& app, Action& action) {
  CLI::App* command =
      app.add_subcommand("collide", "Finds seeds of one scene inside another; exit status 1: there are some");
  const auto o = std::make_shared<CollideCommand>();
  command->add_option("first", o->first, "A scene.toml of skeleton elements")->required();
  command->add_option("second", o->second, "Another")->required();
  command->add_flag("--all", o->all, "Find all penetrating seeds, not only those of the first element that has some");
  command->add_option("--spacing", o->spacing, "Of seeds, world units (default: 1/60 of each scene's diagonal)");
  command->add_option("--frame", o->frame, "Frame of both (default: the first of each)");
  add_backend_options(*command, o->backend);
  command->footer("Example:\n  isoskin collide chain12.toml metaballs7.toml --all");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
