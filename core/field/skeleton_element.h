// What a skeleton is made of: points, segments, triangles and boxes, and how far they are (design 9).
#pragma once

#include <array>

#include "core/types.h"

namespace isoskin {

/// Potentials of the distance d to the element, with its radius R:
///   inverse_square R^2/d^2;  cauchy R/(1+d^2);  metaball (1-d^2/R^2)^3 for d<R else 0;  blinn exp(-d^2/R^2) ;
///   wyvill 1 - 4/9 q^3 + 17/9 q^2 - 22/9 q with q = d^2/R^2, for d<R else 0.
enum class Potential : std::uint8_t { inverse_square, cauchy, metaball, blinn, wyvill };

enum class Shape : std::uint8_t {
  segment,   // from a to b; a point where they are the same
  triangle,  // a b c with what is between; may be flat
  box,       // solid, of any orientation: a is a corner, b, c and d those next to it (a rectangle when d == a)
};

/// An element of a skeleton. The distance of p is 0 on and in it, else the p-norm `norm` of p minus the
/// Euclidean-nearest point of the element.
struct SkeletonElement {
  DVec3 a{0.0}, b{0.0};
  double radius = 1.0;
  double weight = 1.0;
  double norm = 2.0;  // any p > 0
  Potential potential = Potential::metaball;
  Shape shape = Shape::segment;
  DVec3 c{0.0}, d{0.0};  // of triangles and boxes

  bool operator==(const SkeletonElement&) const = default;
};

/// The potential ends at d = R.
bool is_compact(const SkeletonElement& element);

bool is_point(const SkeletonElement& element);

/// The corners of the element: 1 of a point, 2 of a segment, 3 of a triangle, 8 of a box.
struct Corners8 {
  std::array<DVec3, 8> at{};
  int count = 0;
};
Corners8 corners_of(const SkeletonElement& element);

/// The box around the element itself, without its radius.
Box extent(const SkeletonElement& element);

DVec3 center(const SkeletonElement& element);

/// p minus the element's nearest point, and the orthonormal directions in which that point follows p: none at a corner,
/// one on an edge, two on a face, three inside a box.
struct ElementOffset {
  DVec3 x{0.0};
  std::array<DVec3, 3> slide{};
  int slides = 0;
};
ElementOffset offset_from(const SkeletonElement& element, const DVec3& p);

/// Bounds of the Euclidean distance between the element and the points of the box, whose sides may be infinite: exact
/// but for rounding from points, segments and above; from below to within a few per cent of the box for the others.
Interval euclidean_distance(const SkeletonElement& element, const Box& box);

/// Throws InputError "skeleton element INDEX: ..." for non-finite numbers, radius <= 0, norm <= 0, and a box whose
/// edges are not perpendicular to within 1e-6.
void check(const SkeletonElement& element, std::size_t index);

}  // namespace isoskin
