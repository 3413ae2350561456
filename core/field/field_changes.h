// Where a field differs from the one before: what lies elsewhere need not be looked at again (design 9).
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "core/field/field.h"

namespace isoskin {

/// Outside of the boxes (and on their sides) values and derivatives of both fields are the same, bit for bit.
struct FieldChanges {
  bool everywhere = false;
  std::vector<Box> box;
  // Devices count from elsewhere: where the fields are the same, what is computed on them may be rounded otherwise.
  bool rounded_anew = false;

  bool none() const { return !everywhere && !rounded_anew && box.empty(); }
};

/// Compares two moments of a field. Grids of one placement and interpolation: cubes of four voxels whose taps differ.
/// Skeletons of as many elements: the supports of those that differ, before and after; everywhere where one has no
/// bound. The same object: nothing. All else: everywhere.
FieldChanges changes_between(const Field& before, const Field& after);

/// The boxes, grown, as cells to be asked for points and boxes. Never says no where a box is; may say yes a cell beside
/// one, but for boxes that are cells of one raster.
class ChangeMask {
public:
  /// `margin` (world units, >= 0): by how much the boxes are grown.
  ChangeMask(const FieldChanges& changes, double margin);

  bool everywhere() const { return everywhere_; }
  /// Nothing has changed.
  bool empty() const { return !everywhere_ && cell_.empty(); }
  bool contains(const DVec3& p) const { return !beyond(p, p) && (everywhere_ || any_cell({p, p})); }
  /// Does a box reach into the open box `b`?
  bool overlaps(const Box& b) const { return !beyond(b.low, b.high) && (everywhere_ || any_cell(b)); }

private:
  /// Most of what is asked for.
  bool beyond(const DVec3& low, const DVec3& high) const {
    return high.x < low_.x || high.y < low_.y || high.z < low_.z || low.x > high_.x || low.y > high_.y ||
           low.z > high_.z;
  }
  bool any_cell(const Box& b) const;
  IVec3 cell_of(const DVec3& p) const;

  bool everywhere_ = false;
  DVec3 low_{std::numeric_limits<double>::infinity()}, high_{-std::numeric_limits<double>::infinity()};  // of all cells
  DVec3 origin_{0.0};
  double side_ = 1.0;  // of a cell
  IVec3 size_{0};
  std::vector<std::uint8_t> cell_;  // z fastest
};

}  // namespace isoskin
