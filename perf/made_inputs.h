// Inputs that isoskin-bench makes on the fly: surfaces of which all moves, or little.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace isoskin::perf {

/// The names that make_input() knows.
const std::vector<std::string>& made_inputs();

/// Writes `frames` + 1 frames of the input to `folder`, and returns what to open: a pattern or a scene.
///   still      a level set of a ball 200 voxels wide on which a small ball rolls: 1 % of the surface changes
///   moving     the same, all of it moving a third of a voxel a frame
///   wide       a level set of a ring 1024 voxels wide, moving: 0.25 million mechanical triangles; wide2048 and
///              wide4096: 1 and 10 million
///   metaballs1000  a slab of 1,000 metaballs of which one moves
/// Throws std::invalid_argument for another name.
std::string make_input(const std::string& name, const std::filesystem::path& folder, int frames);

}  // namespace isoskin::perf
