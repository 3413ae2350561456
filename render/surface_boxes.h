// Small boxes that together hold the whole surface of a field: what the ray tracer bounds its rays with.
#pragma once

#include <memory>
#include <vector>

#include "core/field/field.h"
#include "core/seeds/seeds.h"

namespace isoskin {

struct SurfaceBoxOptions {
  double size = 0.0;                             // wanted side, world units; 0: 2 h, or 1/128 of the bounds' diagonal
  std::size_t max_boxes = std::size_t{1} << 22;  // boxes stay larger rather than become more than this
};

/// Part of space and a field that equals F there: for compact skeletons, the one made of the elements within reach.
struct SurfaceBox {
  Box box;
  const Field* field = nullptr;
};

struct SurfaceBoxes {
  std::vector<SurfaceBox> boxes;
  int degree =
      0;  // F along a ray inside one box is a polynomial of this degree (9: tricubic cell, 3: trilinear); 0: not one
  double side = 0.0;  // that stands for the side of each box where pieces of ray are judged; 0: each box's own
  std::vector<std::shared_ptr<const Field>> owned;  // the fields that boxes point to, other than the one given
};

/// Boxes outside of which F has no zero. A GridField yields its voxel cells whose spline coefficients differ in sign
/// (the spline lies in their convex hull); other fields are bisected from bounds() with range(). `field` must outlive
/// the result.
SurfaceBoxes surface_boxes(const Field& field, const SurfaceBoxOptions& options = {});

/// The local boxes of the valid seeds of each element (Desbrun, Tsingos and Gascuel 1995, section 5), each with the
/// elements felt there; Embree's hierarchy over them is the main box. They hold the surface as well as seeds cover it:
/// a sliver between two may be missed, so reference pictures take surface_boxes(). `field` must be that of the seeds,
/// and outlive the result.
SurfaceBoxes seed_boxes(const Field& field, const Seeds& seeds);

/// How many skeleton elements an evaluation asks; 0 for other fields.
std::size_t element_count(const Field& field);

/// bounds() alone.
SurfaceBoxes main_box(const Field& field);

/// The box around all of them: at most one box larger than the surface. Empty when there is no surface.
Box bounding_box(const SurfaceBoxes& boxes);

}  // namespace isoskin
