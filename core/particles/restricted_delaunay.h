// The Delaunay triangles whose dual Voronoi edge crosses the surface: the polygonization of samples (Figueiredo et al.
// 1992, 3.2; restricted Delaunay of Edelsbrunner and Shah 1994).
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/field/field.h"

namespace isoskin {

/// A triangle of the polygonization, and where its dual Voronoi edge crosses the surface.
struct DualTriangle {
  std::array<Index, 3> corner{};    // samples, counter-clockwise seen from outside; the smallest first
  DVec3 inside{0.0}, outside{0.0};  // the ends of the dual edge
};

struct RestrictedOptions {
  double spacing = 1.0;       // of the samples, world units
  double clear = 1.3;         // no helper nearer to a sample than this times the spacing
  double shell = 2.0;         // helpers lie about so far apart, in spacings
  int layers = 2;             // of helpers on each side of the surface
  std::uint64_t seed = 1992;  // of the helpers' places
};

struct RestrictedDelaunay {
  std::vector<DualTriangle> triangle;  // sorted by corners
  std::vector<DualTriangle> starved;   // triangles with a helper for a corner (an index beyond the samples)
  std::vector<Index> no_disc;          // samples, ascending, about which the triangles are not one closed fan
  bool closed_manifold() const { return starved.empty() && no_disc.empty(); }
};

/// A Delaunay tetrahedron is inside when F > 0 at its circumcentre; the triangles between inside and outside are kept.
/// They bound a solid, so every edge has an even number of them, whatever the samples. Samples of a sphere all lie on
/// one empty sphere, those of a cylinder on few: *helpers*, random points on both sides of the surface and off it by
/// more than the samples are apart, cut such cells. A triangle whose dual edge meets the surface nearer to its corners
/// than the helpers are is the same with and without them; triangles that have a helper for a corner mean that samples
/// are missing there, and are kept apart. No sample is moved; samples that stay on a
/// common empty sphere have one circumcentre and are on one side.
RestrictedDelaunay restricted_delaunay(std::span<const Vec3> samples, std::span<const Vec3> normals, const Field& field,
                                       const RestrictedOptions& options);

/// Where F changes sign on the dual edge, by bisection.
DVec3 dual_crossing(const DualTriangle& triangle, const Field& field);

}  // namespace isoskin
