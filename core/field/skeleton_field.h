// Skeleton implicit surfaces: F(p) = sum_i weight_i * potential_i(distance_i(p)) - iso (design 9).
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "core/field/element_grid.h"
#include "core/field/field.h"
#include "core/field/skeleton_element.h"

namespace isoskin {

class ChangeMask;

class SkeletonField final : public Field {
public:
  /// Throws InputError as check() does for each element, and for an iso that is not finite.
  SkeletonField(std::vector<SkeletonElement> elements, double iso);

  /// Inverse square is held constant (1e12 weight, gradient 0) nearer than 1e-6 R; in the derivatives of a p-norm, p !=
  /// 2, no |x_i| counts as less than 1e-6 d, which bounds what p < 2 does on the coordinate planes (x_i = 0 exactly:
  /// 0).
  FieldSample sample(const DVec3& p) const override;
  double value(const DVec3& p) const override;
  /// Analytic; where it jumps (see is_c2) the value of one side.
  DMat3 hessian(const DVec3& p) const override;
  /// Tight to about 1/64 of its size. A surface that has no bound (iso 0, weights of both signs) is cut off at 1000
  /// times the size of the skeleton.
  Box bounds() const override {
    std::call_once(bounds_->once, [&] { bounds_->box = find_bounds(); });
    return bounds_->box;
  }
  /// Makes bounds() cost what changes: from those of a field that is the same out of `changed`. The bounds are the
  /// same.
  void follow_bounds(const SkeletonField& before, const ChangeMask& changed) const;
  /// Every potential falls with distance, and distances over a box are bounded exactly for points and Euclidean
  /// segments, closely for the others.
  Interval range(const Box& box) const override;
  /// All elements are points, none is Wyvill's (its second derivative jumps at d = R), and norms are 2, or above 2 with
  /// the inverse square (whose centre, where a p-norm's Hessian has no limit, is singular anyway). Others are C1: the
  /// Hessian jumps where the nearest point becomes an end, an edge or a corner.
  bool is_c2() const override;

  const std::vector<SkeletonElement>& elements() const { return elements_; }
  /// Outside of this box element i's term is zero.
  const Box& support(std::size_t i) const { return support_[i]; }
  double iso() const { return iso_; }
  /// About the middle of the skeleton: where devices put the zero of their float32. Rounded, so that it seldom changes
  /// when elements move: fields with one origin have the same bits wherever they are the same.
  DVec3 origin() const;

private:
  /// Where a box was searched for the surface's end on one side, and a cell that may hold it.
  struct BoundsSide {
    Box searched, cell;
  };
  struct Bounds {
    std::once_flag once;
    Box box;
    std::vector<BoundsSide> side;  // in the order in which they were searched
  };
  Box find_bounds(const Bounds* before = nullptr, const ChangeMask* changed = nullptr) const;

  std::shared_ptr<Bounds> bounds_ = std::make_shared<Bounds>();  // found when first asked for; copies have the same
  std::vector<SkeletonElement> elements_;
  std::vector<double> size_;           // of each element: the farthest of it from the world's origin
  std::vector<Box> support_;           // of each element
  ElementGrid near_;                   // of the supports
  std::vector<std::uint8_t> is_ball_;  // of each element: a point with the norm 2
  double iso_ = 0.0;
};

}  // namespace isoskin
