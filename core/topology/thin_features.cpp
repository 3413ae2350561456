#include "core/topology/thin_features.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace isoskin {
namespace {

/// The thin part of a neck or tunnel as a cylinder.
struct Cylinder {
  DVec3 center, axis;
  double radius, half_length;

  bool contains(const Vec3& p) const {
    const DVec3 x = DVec3(p) - center;
    const double along = glm::dot(x, axis);
    return std::abs(along) <= half_length && glm::length(x - along * axis) <= radius;
  }
};

std::vector<Cylinder> thin_parts(std::span<const CriticalPoint> points, const ThinOptions& options) {
  const double thin = options.thin * options.edge_length;
  std::vector<Cylinder> parts;
  for (const CriticalPoint& p : points) {
    const bool neck = p.kind == CriticalKind::two_saddle && p.value > 0.0;
    const bool tunnel = p.kind == CriticalKind::one_saddle && p.value < 0.0;
    if (!neck && !tunnel) continue;
    const int axis = neck ? 2 : 0;
    const DVec3 size = glm::abs(p.hessian.values);
    const double sharper = std::max(size[1], size[2 - axis]), blunter = std::min(size[1], size[2 - axis]);
    const double waist2 = 2.0 * std::abs(p.value) / sharper;  // squared, of the smaller radius
    if (waist2 >= thin * thin) continue;
    const double half = std::sqrt((thin * thin - waist2) * sharper / size[axis]);
    parts.push_back({p.position, p.hessian.vectors[axis], thin * std::sqrt(sharper / blunter),
                     std::min(half, options.longest * options.edge_length)});
  }
  return parts;
}

}  // namespace

std::vector<Index> thin_feature_vertices(const TriangleMesh& mesh, std::span<const CriticalPoint> points,
                                         const ThinOptions& options, const std::vector<std::uint8_t>& frozen) {
  const std::vector<Cylinder> parts = thin_parts(points, options);
  if (parts.empty()) return {};
  std::vector<std::uint8_t> thin(mesh.vertex_count());
  for_each_index(thin.size(), [&](std::size_t v) {
    if (v < frozen.size() && frozen[v]) return;
    thin[v] =
        std::any_of(parts.begin(), parts.end(), [&](const Cylinder& c) { return c.contains(mesh.position(Index(v))); });
  });
  std::vector<Index> vertices;
  for (Index v = 0; v < thin.size(); ++v)
    if (thin[v]) vertices.push_back(v);
  return vertices;
}

}  // namespace isoskin
