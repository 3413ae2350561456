#include "core/topology/growing_filling.h"

#include <cmath>

#include "core/parallel.h"
#include "core/topology/holes.h"
#include "core/trace.h"

namespace isoskin {

void GrowingFilling::extend(const std::vector<Vec3>& points, float least, float reach) {
  const std::vector<std::uint8_t> needed = bricks_about(points, least);
  bool covered = near_.has_value();
  for (std::size_t b = 0; b < needed.size() && covered; ++b) covered = needed[b] <= wanted_[b];
  if (covered) return;
  const Span span("filling");
  const std::vector<std::uint8_t> more = bricks_about(points, reach);
  for (std::size_t b = 0; b < more.size(); ++b) wanted_[b] |= more[b];
  near_.reset();
  filling_ = make_filling(marching_cubes_open(lattice_, topology_, wanted_), backend_);
  near_.emplace(filling_.surface.position, seam_reach(lattice_.spacing));
}

std::vector<std::uint8_t> GrowingFilling::bricks_about(const std::vector<Vec3>& points, float reach) const {
  const float half_brick = 0.5f * BrickLattice::kCells * float(lattice_.spacing);
  const PointGrid coarse(points, reach + std::sqrt(3.0f) * half_brick);
  std::vector<std::uint8_t> bricks(lattice_.brick_count());
  for_each_index(bricks.size(), [&](std::size_t b) {
    const DVec3 corner = lattice_.point(BrickLattice::kCells * lattice_.coordinate[b]);
    bricks[b] = coarse.any_near(Vec3(corner) + half_brick);
  });
  return bricks;
}

}  // namespace isoskin
