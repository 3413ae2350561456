// The first change of sign of F along a piece of a ray, isolated with bounds: thin parts are not stepped over.
#pragma once

#include <array>
#include <optional>

#include "core/field/field.h"

namespace isoskin {

/// Points origin + t * direction for t in [begin, end].
struct RayPiece {
  DVec3 origin, direction;
  double begin = 0.0, end = 0.0;

  DVec3 at(double t) const { return origin + t * direction; }
};

/// First t where F turns from <= 0 to > 0 or back, when F along the piece is a polynomial of `degree` 3 or 9: nine
/// (three) halvings of Bernstein coefficients at worst isolate it, by Descartes' rule of signs; exact up to rounding
/// (about 1e-12 of the largest |F| on the piece) and to 1e-9 of the piece.
std::optional<double> first_polynomial_root(const Field& field, const RayPiece& piece, int degree);

/// The same for any field: pieces are bisected, nearest first, and passed over where range() of their box rules a zero
/// out. Pieces shorter than `shortest` (in t) are judged by the signs at their ends, so only two sign changes closer
/// than that can be missed. The root is exact to 1e-9 of `shortest` or rounding.
std::optional<double> first_root(const Field& field, const RayPiece& piece, double shortest);

}  // namespace isoskin
