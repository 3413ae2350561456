// Grid sequences from OpenVDB files (design 9, 10). The only header through which the rest of isoskin meets OpenVDB; it
// does not include it.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/field/field.h"
#include "core/field/grid_field.h"

namespace isoskin {

struct GridOptions {
  std::string grid;        // grid name; empty: the first scalar grid
  double iso = 0.0;        // in the grid's own values
  bool iso_given = false;  // fog volumes without one use 0.5
  Interpolation interpolation = Interpolation::cubic;
  int smooth = 0;        // iterations of OpenVDB's own mean-curvature level-set filter on load
  std::string velocity;  // velocity grid name; empty: none
};

struct SequenceOptions {
  GridOptions grid;
  std::optional<int> first, last;  // frame range; default: all that exist
  std::optional<double> dt;        // seconds a frame; default: what the first file says, else 1/24
  int ahead = 2;                   // frames loaded ahead of need by a background thread
};

/// Loads one grid: float, double, or saved as half. F = iso - value for a level set, value - iso for any other class,
/// to within a millionth of a voxel (or of the outside value): values nearer to zero than that are moved to it, keeping
/// their side, so that splines of float taps have the file's signs at voxel centres (exactly zero counts as outside).
/// A grid whose values have one sign only is a field without surface. Throws InputError: missing or truncated file, no
/// such grid (names those present), not scalar, empty, not finite (says where), a transform that is more than uniform
/// scale and translation.
std::shared_ptr<const GridField> load_grid(const std::filesystem::path& file, const GridOptions& options);

/// What a .vdb file holds, for `isoskin info`.
struct GridInfo {
  std::string name, type, grid_class;
  double voxel_size = 0.0;
  std::size_t active_voxels = 0;
  IVec3 low{0}, high{0};
};
std::vector<GridInfo> grid_info(const std::filesystem::path& file);

/// `input`: a printf pattern (dam_break.%04d.vdb), a folder, a glob, or one file (a sequence of one; frame 1 when it
/// has no number). Time is zero at the first frame there is. dt: the option, else the metadata `frame_dt` or
/// `dt_seconds` of the first file's grid. The velocity grid is read only when it is named; it may be staggered, float
/// or half. Throws InputError: nothing there, a frame missing between the first and the last; what is wrong inside a
/// file is thrown by load() of its frame.
std::unique_ptr<FieldSource> open_sequence(const std::string& input, const SequenceOptions& options);

}  // namespace isoskin
