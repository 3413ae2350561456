#include "core/refine/shape_sums.h"

#include <cmath>

#include "core/parallel.h"

namespace isoskin {
namespace {

constexpr double kOne = 1 << 30;

void add_to(std::int64_t& sum, std::int64_t value) {
  std::atomic_ref(sum).fetch_add(value, std::memory_order_relaxed);
}

}  // namespace

ShapeSums::ShapeSums(const TriangleMesh& mesh, double unit) : unit_(unit) {
  for_each_index(mesh.triangle_count(), [&](std::size_t t) { add(mesh.vertex, mesh.vertices.position, Index(t), 1); });
}

void ShapeSums::update(const MeshCopy& before, const TriangleMesh& mesh, const MeshChanges& changes) {
  for_each_index(changes.gone.size(), [&](std::size_t i) { add(before.vertex, before.position, changes.gone[i], -1); });
  for_each_index(changes.fresh.size(),
                 [&](std::size_t i) { add(mesh.vertex, mesh.vertices.position, changes.fresh[i], 1); });
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

void ShapeSums::add(const std::vector<Index>& vertex, const std::vector<Vec3>& position, Index t, int times) {
  const auto corners = [&](Index of) -> std::array<Vec3, 3> {
    const Index* const corner = &vertex[3 * std::size_t{of}];
    return {position[corner[0]], position[corner[1]], position[corner[2]]};
  };
  const ShapeTally::Part one = tally_.count(t, t + 1, corners, times);
  add_to(angles_, times * std::llround(one.angles * kOne));
  add_to(edges_, times * std::llround(one.edges / unit_ * kOne));
  add_to(area_, times * std::llround(one.area / (unit_ * unit_) * kOne));
  add_to(below_10_, times * std::int64_t(one.below_10));
  add_to(triangles_, times);
}

}  // namespace isoskin
