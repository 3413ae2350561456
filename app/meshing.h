// The meshing parameters that `track` and `render` share.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/extract.h"
#include "core/io/scene.h"
#include "core/tracker.h"

namespace CLI {
class App;
}

namespace isoskin {

struct MeshingOptions {
  std::optional<double> edge_length, angle, sagitta;
  std::optional<int> passes;
  std::string mechanics = "fem";  // or springs
  std::string topology = "auto";  // or critical, collision
  bool sharp = false;
};
void add_meshing_options(CLI::App& command, MeshingOptions& options);

/// The command line's parameters, else the scene's, else the defaults, resolved() for the first frame's field. Throws
/// InputError for a number out of range, and for an edge length so short that the mesh would not fit in memory.
TrackOptions track_options(const MeshingOptions& options, const SceneMeshing& scene, const Field& first);

/// What `extract --method` and `track --start` take.
std::vector<std::string> extract_method_names();
/// Nothing when it is not one of them.
std::optional<ExtractMethod> extract_method(const std::string& name);

}  // namespace isoskin
