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

void ShapeSums::Sum::add(const Sum& other) {
  angles += other.angles;
  edges += other.edges;
  area += other.area;
  below_10 += other.below_10;
  triangles += other.triangles;
}

ShapeSums::Sum ShapeSums::of(const std::array<Vec3, 3>& corner, std::uint16_t& step) const {
  const DVec3 a(corner[0]), b(corner[1]), c(corner[2]);
  const double angle = smallest_angle(a, b, c);
  const double edges = glm::length(b - a) + glm::length(c - b) + glm::length(a - c);
  const double area = 0.5 * glm::length(glm::cross(b - a, c - a));
  step = ShapeTally::step(angle);
  return {std::llround(angle * kOne), std::llround(edges / unit_ * kOne), std::llround(area / (unit_ * unit_) * kOne),
          angle < 10.0, 1};
}

void ShapeSums::count(const Sum& sum, int times) {
  add_to(sum_.angles, times * sum.angles);
  add_to(sum_.edges, times * sum.edges);
  add_to(sum_.area, times * sum.area);
  add_to(sum_.below_10, times * sum.below_10);
  add_to(sum_.triangles, times * sum.triangles);
}

ShapeStatistics ShapeSums::statistics() const {
  ShapeTally::Part all;
  all.angles = double(sum_.angles) / kOne;
  all.edges = double(sum_.edges) / kOne * unit_;
  all.area = double(sum_.area) / kOne * unit_ * unit_;
  all.least = tally_.least();
  all.below_10 = Index(sum_.below_10);
  all.triangles = Index(sum_.triangles);
  return tally_.statistics({all});
}

template <class Triangle>
void ShapeSums::add(const std::vector<Index>& vertex, const std::vector<Vec3>& position, std::size_t count,
                    const Triangle& triangle, int times) {
  constexpr std::size_t kBlock = 1024;  // summed by one thread: all adding to one place wait for each other
  tbb::parallel_for(std::size_t(0), (count + kBlock - 1) / kBlock, [&](std::size_t block) {
    Sum sum;
    for (std::size_t i = block * kBlock; i < std::min(count, (block + 1) * kBlock); ++i) {
      const Index* const corner = &vertex[3 * std::size_t{triangle(i)}];
      std::uint16_t step = 0;
      sum.add(of({position[corner[0]], position[corner[1]], position[corner[2]]}, step));
      tally_.count(step, times);
    }
    this->count(sum, times);
  });
}

}  // namespace isoskin
