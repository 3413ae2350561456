// Scalar grids as fields: padded bricks of spline coefficients behind an index table (design 9, pocl.md).
#pragma once

#include <memory>
#include <vector>

#include "core/field/field.h"

namespace isoskin {

enum class Interpolation : std::uint8_t { linear, cubic };

/// A sparse scalar grid in index space: 8^3-voxel bricks. World position of voxel (i,j,k) is origin + h * (i,j,k).
/// Each brick stores taps -1..9 on each axis: 11^3 floats, index (x * 11 + y) * 11 + z. With cubic interpolation taps
/// are B-spline coefficients solved so that the spline passes through the voxel values; with linear they are the
/// values.
struct BrickGrid {
  static constexpr int kBrick = 8;
  static constexpr int kTaps = 11;
  static constexpr int kTapValues = kTaps * kTaps * kTaps;

  DVec3 origin{0.0};
  double h = 1.0;
  Interpolation interpolation = Interpolation::cubic;
  IVec3 table_low{0};  // brick coordinate (voxel / 8, rounded down) of table entry 0
  IVec3 table_size{0};
  std::vector<std::int32_t> table;      // >= 0: brick; < 0: constant[-1 - entry]; z fastest
  std::vector<float> constant;          // F in blocks that hold one value (outside, inside)
  float outside = 0.0f;                 // F beyond the table
  std::vector<IVec3> brick_coordinate;  // one a brick
  std::vector<float> tap;               // kTapValues a brick
};

/// F on a BrickGrid; `positive inside` has been arranged by the loader (F = iso - value for level sets, value - iso
/// else).
class GridField final : public Field {
public:
  explicit GridField(std::shared_ptr<const BrickGrid> grid);

  /// In a constant block and beyond the table the gradient is zero.
  FieldSample sample(const DVec3& p) const override;
  double value(const DVec3& p) const override;
  void values(const DVec3& origin, double spacing, const IVec3& count, std::span<double> out) const override;
  DMat3 hessian(const DVec3& p) const override;
  /// The box of those cells whose Bernstein coefficients (linear: taps) differ in sign: the surface lies nowhere else.
  Box bounds() const override { return bounds_; }
  /// Least and greatest tap that the box's cells see: splines lie in the convex hull of their taps. Under a microsecond
  /// for a box of a few cells.
  Interval range(const Box& box) const override;
  double resolution() const override { return grid_->h; }
  std::size_t bytes() const override { return grid_->tap.size() * sizeof(float); }
  bool is_c2() const override { return grid_->interpolation == Interpolation::cubic; }

  const std::shared_ptr<const BrickGrid>& grid() const { return grid_; }

private:
  struct RangeTree;
  void add_to_bounds(std::size_t brick);

  std::shared_ptr<const BrickGrid> grid_;
  std::shared_ptr<const RangeTree> tree_;
  Box bounds_;
};

}  // namespace isoskin
