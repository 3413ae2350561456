// isoskin compare: how far apart two pictures of the same surface are.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/options.h"
#include "app/report.h"
#include "render/compare.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

constexpr double kMostUnits = 1e30;
constexpr int kMostRim = 100;  // pixels

struct CompareCommand {
  std::string a, b, difference;
  std::optional<double> unit, depth;
  CompareOptions options;
  bool json = false;
};

/// Unit and tolerance that the pictures bring along, unless the command line has its own.
CompareOptions resolved_options(const CompareCommand& command, const Image& a, const Image& b) {
  CompareOptions options = command.options;
  const Image& knowing = a.unit > 0.0f ? a : b;
  options.unit = command.unit.value_or(knowing.unit);
  options.depth_p99 =
      command.depth.value_or(knowing.depth_tolerance > 0.0f ? knowing.depth_tolerance : options.depth_p99);
  if (options.unit == 0.0)
    throw InputError(
        fmt::format("{}: does not say its unit of depth; expected --unit, the voxel or edge length", command.a));
  return options;
}

Json to_json(const ErrorStatistics& s) {
  return {{"pixels", s.pixels}, {"mean", s.mean}, {"p99", s.p99}, {"max", s.max}};
}

Json to_json(const CompareReport& report, const CompareOptions& options) {
  return {{"passed", report.passed},
          {"verdict", report.verdict},
          {"unit", options.unit},
          {"covered", {report.covered_a, report.covered_b}},
          {"coverage_mismatch", report.coverage_mismatch},
          {"beyond_rim", report.beyond_rim},
          {"depth", to_json(report.depth)},
          {"depth_inside", to_json(report.depth_inside)},
          {"normal", to_json(report.normal)},
          {"tolerance",
           {{"beyond_rim", options.most_beyond_rim},
            {"depth_p99", options.depth_p99},
            {"normal_mean", options.normal_mean}}}};
}

void print(const CompareReport& report, const CompareOptions& options) {
  const auto line = [](const char* name, const ErrorStatistics& s, const char* unit) {
    fmt::print("{:<16} mean {:.4f}, 99th percentile {:.4f}, largest {:.4f} {}; {} pixels\n", name, s.mean, s.p99, s.max,
               unit, s.pixels);
  };
  fmt::print("{:<16} {} and {} pixels, {} differ, {} of them farther than {} from the other's silhouette\n", "coverage",
             report.covered_a, report.covered_b, report.coverage_mismatch, report.beyond_rim, options.rim);
  fmt::print("{:<16} {:.6g}\n", "unit of depth", options.unit);
  line("depth", report.depth, "units");
  line("depth inside", report.depth_inside, "units");
  line("normal", report.normal, "degrees");
  fmt::print("{:<16} {}\n", "verdict", report.verdict);
}

int run(const CompareCommand& command) {
  if (command.unit) require_range("--unit", *command.unit, 1.0 / kMostUnits, kMostUnits);
  if (command.depth) require_range("--depth", *command.depth, 0.0, kMostUnits);
  require_range("--normal", command.options.normal_mean, 0.0, 180.0);
  require_range("--rim", command.options.rim, 0, kMostRim);
  const Image a = load_exr(command.a), b = load_exr(command.b);
  const CompareOptions options = resolved_options(command, a, b);
  const Comparison comparison = compare(a, b, options);
  if (!command.difference.empty()) {
    save_exr(command.difference, comparison.difference, fmt::format("isoskin compare {} {}", command.a, command.b));
    save_png(fs::path(command.difference).replace_extension(".png"), comparison.difference);
  }
  if (command.json)
    fmt::print("{}\n", to_json(comparison.report, options).dump());
  else
    print(comparison.report, options);
  return comparison.report.passed ? kOk : kNo;
}

}  // namespace

void add_compare(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("compare", "Compares two EXR pictures: silhouettes, depth, normals");
  const auto o = std::make_shared<CompareCommand>();
  command->add_option("a", o->a, "An .exr that `render` wrote")->required();
  command->add_option("b", o->b, "Another of the same size and camera")->required();
  command->add_option("-o,--output", o->difference, "Write the difference as .exr, and a .png beside it");
  command->add_option("--unit", o->unit,
                      "Length that depth is told in (default: the pictures' own: voxel or edge length)");
  command->add_option("--depth", o->depth,
                      "Tolerance of the depth's 99th percentile, units (default: the pictures' own)");
  command->add_option("--normal", o->options.normal_mean, "Tolerance of the mean normal angle, degrees")
      ->capture_default_str();
  command->add_option("--rim", o->options.rim, "Pixels by which silhouettes may be off")->capture_default_str();
  command->add_flag("--json", o->json, "Print the figures as JSON");
  command->footer(
      "Example:\n  isoskin compare mesh.exr field.exr -o difference.exr\nExit status 1 when beyond tolerance.");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
