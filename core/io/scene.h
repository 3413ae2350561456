// Scenes in TOML: skeleton elements with key-framed parameters, or a grid sequence; meshing parameters (design 10).
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "core/field/field.h"
#include "core/io/sequence.h"

namespace isoskin {

/// Meshing parameters a scene may set; the command line overrides them.
struct SceneMeshing {
  std::optional<double> edge_length;  // e, world units
  std::optional<double> angle;        // alpha_r, degrees
  std::optional<int> passes;          // N_p
  std::optional<bool> sharp;
};

struct Scene {
  std::unique_ptr<FieldSource> source;
  SceneMeshing meshing;
};

/// Reads a scene. Format (all keys checked; README and docs in this header are the reference):
///   name = "seven"            frames = [1, 200]        dt = 0.04         iso = 0.2        seed-free and deterministic
///   [meshing]  edge_length = 0.1  angle = 18  passes = 4  sharp = false
///   [[element]]  kind = "point" | "segment"   potential = "metaball"   norm = 2.0   motion = "smooth" | "linear"
///     position = [x,y,z]  (segment: a = .., b = ..)   radius = 1.0   weight = 1.0
///     or key-framed: keys = [ { frame = 1, position = [..], radius = .. }, { frame = 100, .. } ]
///   [sequence] files = "dam_break.%04d.vdb" (relative to the scene file), grid, iso, smooth, interpolation, velocity
/// Throws InputError "FILE:LINE: ..." for syntax errors, unknown keys, wrong types, non-finite numbers, missing files.
Scene load_scene(const std::filesystem::path& file, const SequenceOptions& overrides = {});

/// One file, folder, pattern, glob or .toml scene: what `isoskin track INPUT` takes.
Scene open_input(const std::string& input, const SequenceOptions& options = {});

}  // namespace isoskin
