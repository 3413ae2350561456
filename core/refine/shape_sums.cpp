#include "core/refine/shape_sums.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include <tbb/parallel_for.h>

namespace isoskin {
namespace {

constexpr double kOne = 1 << 30;

void add_to(std::int64_t& sum, std::int64_t value) {
  std::atomic_ref(sum).fetch_add(value, std::memory_order_relaxed);
}

}  // namespace

ShapeSums::ShapeSums(const TriangleMesh& mesh, double unit) : unit_(unit) {
  add(
      mesh.vertex, mesh.vertices.position, mesh.triangle_count(), [](std::size_t i) { return Index(i); }, 1);
}

void ShapeSums::update(const MeshCopy& before, const TriangleMesh& mesh, const MeshChanges& changes) {
  count(before.vertex, before.position, changes.gone, -1);
  count(mesh.vertex, mesh.vertices.position, changes.fresh, 1);
}

void ShapeSums::count(const std::vector<Index>& vertex, const std::vector<Vec3>& position,
                      const std::vector<Index>& triangles, int times) {
  add(
      vertex, position, triangles.size(), [&](std::size_t i) { return triangles[i]; }, times);
}

ShapeStatistics ShapeSums::statistics() const {
  ShapeTally::Part all;
  all.angles = double(angles_) / kOne;
  all.edges = double(edges_) / kOne * unit_;
  all.area = double(area_) / kOne * unit_ * unit_;
  all.least = tally_.least();
  all.below_10 = Index(below_10_);
  all.triangles = Index(triangles_);
  return tally_.statistics({all});
}

template <class Triangle>
void ShapeSums::add(const std::vector<Index>& vertex, const std::vector<Vec3>& position, std::size_t count,
                    const Triangle& triangle, int times) {
  constexpr std::size_t kBlock = 1024;  // summed by one thread: all adding to one place wait for each other
  tbb::parallel_for(std::size_t(0), (count + kBlock - 1) / kBlock, [&](std::size_t block) {
    std::int64_t angles = 0, edges = 0, area = 0, below_10 = 0, triangles = 0;
    for (std::size_t i = block * kBlock; i < std::min(count, (block + 1) * kBlock); ++i) {
      const Index t = triangle(i);
      const auto corners = [&](Index of) -> std::array<Vec3, 3> {
        const Index* const corner = &vertex[3 * std::size_t{of}];
        return {position[corner[0]], position[corner[1]], position[corner[2]]};
      };
      const ShapeTally::Part one = tally_.count(t, t + 1, corners, times);
      angles += times * std::llround(one.angles * kOne);
      edges += times * std::llround(one.edges / unit_ * kOne);
      area += times * std::llround(one.area / (unit_ * unit_) * kOne);
      below_10 += times * std::int64_t(one.below_10);
      triangles += times;
    }
    add_to(angles_, angles);
    add_to(edges_, edges);
    add_to(area_, area);
    add_to(below_10_, below_10);
    add_to(triangles_, triangles);
  });
}

}  // namespace isoskin
