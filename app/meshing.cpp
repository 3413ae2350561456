#include "app/meshing.h"

#include <cmath>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/options.h"

namespace isoskin {
namespace {

constexpr double kLeastAngle = 0.5, kMostAngle = 180.0;  // degrees
constexpr int kMostPasses = 10;
constexpr double kMostSagitta = 1e30;  // world units

constexpr std::pair<const char*, ExtractMethod> kMethods[] = {{"marching-cubes", ExtractMethod::marching_cubes},
                                                              {"particles", ExtractMethod::particles},
                                                              {"spring-lattice", ExtractMethod::spring_lattice}};

}  // namespace

void add_meshing_options(CLI::App& command, MeshingOptions& options) {
  command.add_option("--edge-length", options.edge_length,
                     "Wanted mechanical edge, world units (default: 1.5 voxels, or 1/60 of the scene's diagonal)");
  command.add_option("--angle", options.angle, "Refine where normals differ by more, degrees (default: 18)");
  command.add_option("--passes", options.passes, "Refinement passes, at most (default: 4)");
  command.add_option("--sagitta", options.sagitta,
                     "Refine what lies farther beside the surface, world units, 0: by angle alone (default: 0.04 "
                     "voxels or 0.0027 edge lengths at 18 degrees, else as the angle's square)");
  command.add_option("--mechanics", options.mechanics, "Elements of the skin")
      ->check(CLI::IsMember({"fem", "springs"}))
      ->capture_default_str();
  command
      .add_option("--topology", options.topology,
                  "What splits and joins the skin: critical points of the field, collisions of the skin with itself, "
                  "or auto (critical points where the field has them, else collisions; neither on grids, where local "
                  "re-skins do as well)")
      ->check(CLI::IsMember({"critical", "collision", "auto"}))
      ->capture_default_str();
  command.add_flag("--sharp", options.sharp, "Pull vertices onto sharp features");
}

TrackOptions track_options(const MeshingOptions& given, const SceneMeshing& scene, const Field& first) {
  TrackOptions options;
  const std::optional<double> e = given.edge_length ? given.edge_length : scene.edge_length;
  if (e && !(std::isfinite(*e) && *e > 0.0))
    throw InputError(fmt::format("edge length {}: expected a positive, finite length", *e));
  options.edge_length = e.value_or(0.0);
  if (const auto angle = given.angle ? given.angle : scene.angle) {
    require_range("--angle", *angle, kLeastAngle, kMostAngle);
    options.refine.angle = float(*angle);
  }
  if (const auto passes = given.passes ? given.passes : scene.passes) {
    require_range("--passes", *passes, 0, kMostPasses);
    options.refine.passes = *passes;
  }
  if (const auto sagitta = given.sagitta ? given.sagitta : scene.sagitta) {
    require_range("--sagitta", *sagitta, 0.0, kMostSagitta);
    options.sagitta = *sagitta;
  }
  options.relax.mechanics = given.mechanics == "springs" ? Mechanics::springs : Mechanics::fem;
  options.topology = given.topology == "critical"    ? Topology::critical
                     : given.topology == "collision" ? Topology::collision
                                                     : Topology::automatic;
  options.relax.sharp = given.sharp || scene.sharp.value_or(false);
  return resolved(options, first);
}

std::vector<std::string> extract_method_names() {
  std::vector<std::string> names;
  for (const auto& [name, method] : kMethods) names.emplace_back(name);
  return names;
}

std::optional<ExtractMethod> extract_method(const std::string& name) {
  for (const auto& [known, method] : kMethods)
    if (name == known) return method;
  return std::nullopt;
}

}  // namespace isoskin
