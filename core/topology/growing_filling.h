// The filling of a frame's holes, built as far as anybody asks for it: all tries of a repair share it.
#pragma once

#include <vector>

#include <tbb/enumerable_thread_specific.h>

#include "core/backend.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/filling.h"
#include "core/topology/point_grid.h"

namespace isoskin {

/// The lattice's surface about some places. What it refers to must outlive it, and the backend must hold the field.
class GrowingFilling {
public:
  GrowingFilling(const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend);
  GrowingFilling(const GrowingFilling&) = delete;
  GrowingFilling& operator=(const GrowingFilling&) = delete;

  /// When it does not reach `least` about the points, it is built on as far as `reach`; its vertices and triangles keep
  /// their numbers. World units.
  void extend(const std::vector<Vec3>& points, float least, float reach);

  const Filling& operator*() const { return filling_; }
  const Filling* operator->() const { return &filling_; }
  /// Its vertices, within seam_reach().
  const GrowingPointGrid& near() const { return near_; }
  /// The calling thread's.
  PathFinder& paths() const { return paths_.local(); }

private:
  std::vector<std::uint8_t> bricks_about(const std::vector<Vec3>& points, float reach) const;

  const BrickLattice& lattice_;
  const LatticeTopology& topology_;
  Backend& backend_;
  std::vector<std::uint8_t> built_;  // per brick
  Filling filling_;
  GrowingPointGrid near_;
  mutable tbb::enumerable_thread_specific<PathFinder> paths_;
};

}  // namespace isoskin
