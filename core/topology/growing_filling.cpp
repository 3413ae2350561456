#include "core/topology/growing_filling.h"

#include <cmath>

#include "core/parallel.h"
#include "core/topology/holes.h"
#include "core/trace.h"

namespace isoskin {

GrowingFilling::GrowingFilling(const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend)
    : lattice_(lattice),
      topology_(topology),
      backend_(backend),
      built_(lattice.brick_count(), 0),
      near_(seam_reach(lattice.spacing)),
      paths_([this] { return PathFinder(filling_); }) {}

void GrowingFilling::extend(const std::vector<Vec3>& points, float least, float reach) {
  const std::vector<std::uint8_t> needed = bricks_about(points, least);
  bool covered = true;
  for (std::size_t b = 0; b < needed.size() && covered; ++b) covered = needed[b] <= built_[b];
  if (covered) return;
  const Span span("filling");
  std::vector<std::uint8_t> more = bricks_about(points, reach);
  for (std::size_t b = 0; b < more.size(); ++b) {
    more[b] &= !built_[b];
    built_[b] |= more[b];
  }
  const std::size_t before = filling_.surface.position.size();
  add_bricks(lattice_, topology_, more, filling_.surface);
  filling_.catch_up(backend_);
  near_.add({filling_.surface.position.begin() + std::ptrdiff_t(before), filling_.surface.position.end()});
}

std::vector<std::uint8_t> GrowingFilling::bricks_about(const std::vector<Vec3>& points, float reach) const {
  const float half_brick = 0.5f * BrickLattice::kCells * float(lattice_.spacing);
  const PointGrid coarse(points, reach + std::sqrt(3.0f) * half_brick);
  std::vector<std::uint8_t> bricks(lattice_.brick_count());
  for_each_heavy(bricks.size(), [&](std::size_t b) {
    const DVec3 corner = lattice_.point(BrickLattice::kCells * lattice_.coordinate[b]);
    bricks[b] = coarse.any_near(Vec3(corner) + half_brick);
  });
  return bricks;
}

}  // namespace isoskin
