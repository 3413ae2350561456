// Skeleton implicit surfaces: F(p) = sum_i weight_i * potential_i(distance_i(p)) - iso (design 9).
#pragma once

#include <memory>
#include <vector>

#include "core/field/field.h"

namespace isoskin {

/// Potentials of the distance d to the element, with its radius R:
///   inverse_square R^2/d^2;  cauchy R/(1+d^2);  metaball (1-d^2/R^2)^3 for d<R else 0;  blinn exp(-d^2/R^2) ;
///   wyvill 1 - 4/9 q^3 + 17/9 q^2 - 22/9 q with q = d^2/R^2, for d<R else 0.
enum class Potential : std::uint8_t { inverse_square, cauchy, metaball, blinn, wyvill };

/// A point (a == b) or a segment a-b; distance is that of p to the element in the p-norm `norm`
/// (segment: the Euclidean-nearest point of the segment, then the p-norm of the difference).
struct SkeletonElement {
  DVec3 a{0.0}, b{0.0};
  double radius = 1.0;
  double weight = 1.0;
  double norm = 2.0;  // any p > 0
  Potential potential = Potential::metaball;
};

class SkeletonField final : public Field {
public:
  /// Throws InputError for non-finite numbers, radius <= 0, norm <= 0.
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
  Box bounds() const override;
  /// Every potential falls with distance, and distances over a box are bounded exactly for points and Euclidean
  /// segments.
  Interval range(const Box& box) const override;
  /// All elements are points, none is Wyvill's (its second derivative jumps at d = R), and norms are 2, or above 2 with
  /// the inverse square (whose centre, where a p-norm's Hessian has no limit, is singular anyway). Segments are C1: the
  /// Hessian jumps where the nearest point becomes an end.
  bool is_c2() const override;

  const std::vector<SkeletonElement>& elements() const { return elements_; }
  /// Outside of this box element i's term is zero.
  const Box& support(std::size_t i) const { return support_[i]; }
  double iso() const { return iso_; }

private:
  std::vector<SkeletonElement> elements_;
  std::vector<Box> support_;  // of each element
  double iso_ = 0.0;
};

}  // namespace isoskin
