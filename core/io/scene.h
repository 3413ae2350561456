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
  std::optional<double> sagitta;      // of the geometric mesh, world units; 0: by angle alone
  std::optional<bool> sharp;
};

struct Scene {
  std::unique_ptr<FieldSource> source;
  SceneMeshing meshing;
};

/// Reads a scene. Format (every key is checked; this is the reference):
///   name = "seven"              default: the file's stem
///   frames = [1, 200]           default: [1, 1], or all files of a sequence;  dt = 0.04  seconds a frame, default 1/24
///   iso = 0.2                   of skeletons; required
///   blend = [[1, 2], [2, 3]]    pairs of elements, numbered from 1, that blend; default: all blend with each other
///   [meshing]  edge_length = 0.1  angle = 18  passes = 4  sagitta = 0.001  sharp = false
///   [[element]]  kind = "point" (default) | "segment" | "triangle" | "box" (solid)
///     potential = "metaball" (default) | "inverse_square" | "cauchy" | "blinn" | "wyvill"   norm = 2.0
///     position = [x, y, z]   (segment: a, b; triangle: a, b, c)   radius = 1.0   weight = 1.0
///     (box: position of its middle, size = [x, y, z], and rotation = [x, y, z], default 0: about the direction of this
///     vector by its length in degrees)
///     or any of these key-framed: keys = [ { frame = 1, position = [..], radius = .. }, { frame = 100, .. } ]
///     motion = "linear" (default) | "smooth": see KeyTrack; before the first and after the last key nothing moves
///   [sequence] instead of elements: files = "dam_break.%04d.vdb" (from the scene's folder; also a folder, glob or
///   file),
///     grid, iso, smooth, interpolation = "cubic" | "linear", velocity: see GridOptions
/// What is set in `overrides` wins (a linear interpolation counts as set). Throws InputError "FILE:LINE: ..." for
/// syntax errors, unknown or missing keys, wrong types, non-finite numbers, missing files.
Scene load_scene(const std::filesystem::path& file, const SequenceOptions& overrides = {});

/// One .vdb file, folder, pattern, glob or .toml scene: what `isoskin track INPUT` takes.
Scene open_input(const std::string& input, const SequenceOptions& options = {});

}  // namespace isoskin
