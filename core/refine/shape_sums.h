// Shape statistics of a mesh that go on from those of the mesh before.
#pragma once

#include "core/mesh/mesh_changes.h"
#include "core/refine/shape_tally.h"

namespace isoskin {

/// Sums are of whole numbers, so they depend neither on the order in which triangles are counted nor on what has been
/// counted and taken back since.
class ShapeSums {
public:
  ShapeSums() = default;
  /// Of none yet.
  explicit ShapeSums(double unit) : unit_(unit) {}
  /// Of all triangles. `unit`: lengths are summed to 2^-30 of it.
  ShapeSums(const TriangleMesh& mesh, double unit);

  /// From the mesh that was copied to this one.
  void update(const MeshCopy& before, const TriangleMesh& mesh, const MeshChanges& changes);

  /// What some triangles add up to but for their angles' steps: 2^-30 degrees, units, squared units.
  struct Sum {
    std::int64_t angles = 0, edges = 0, area = 0, below_10 = 0, triangles = 0;
    void add(const Sum& other);
  };
  /// Of one; `step`: its angle's, see ShapeTally.
  Sum of(const std::array<Vec3, 3>& corner, std::uint16_t& step) const;
  /// Count what of() told `times` (1 or -1) times. Both may run in parallel.
  void count(const Sum& sum, int times);
  void count(std::uint16_t step, int times) { tally_.count(step, times); }

  /// Counts some triangles `times` (1 or -1) times; `vertex`: three a triangle.
  void count(const std::vector<Index>& vertex, const std::vector<Vec3>& position, const std::vector<Index>& triangles,
             int times);

  /// As shape_statistics(), but min_angle and p1_angle are the multiples of ShapeTally::kStep at or below.
  ShapeStatistics statistics() const;

private:
  /// Counts triangle(i) for every i < count, `times` (1 or -1) times.
  template <class Triangle>
  void add(const std::vector<Index>& vertex, const std::vector<Vec3>& position, std::size_t count,
           const Triangle& triangle, int times);

  ShapeTally tally_;
  double unit_ = 1.0;
  Sum sum_;
};

}  // namespace isoskin
