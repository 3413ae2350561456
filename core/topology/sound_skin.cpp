#include "core/topology/sound_skin.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/point_grid.h"
#include "core/topology/triangle_pairs.h"

namespace isoskin {
namespace {

using Triangle = std::array<Vec3, 3>;

Vec3 centroid(const Triangle& p) {
  return (p[0] + p[1] + p[2]) / 3.0f;
}

/// Unit; zero without area.
Vec3 normal(const Triangle& p) {
  const Vec3 n = glm::cross(p[1] - p[0], p[2] - p[0]);
  const float length = glm::length(n);
  return length > 0.0f ? n / length : Vec3(0.0f);
}

/// Which of the triangles lie on the surface and face as it does.
std::vector<std::uint8_t> on_surface(const TriangleMesh& mesh, const std::vector<Index>& triangles, Backend& backend,
                                     const SoundOptions& options) {
  constexpr std::size_t kPoints = 7;
  constexpr float kLeastSlope = 0.1f;                  // of what a distance has
  constexpr float kAgreeMiddle = 0.5f, kAgree = 0.0f;  // cosines between the triangle's normal and the field's
  std::vector<Vec3> points(kPoints * triangles.size()), gradients(points.size());
  std::vector<float> values(points.size());
  for_each_index(triangles.size(), [&](std::size_t i) {
    const Triangle p = corners_of(mesh, triangles[i]);
    const std::array<Vec3, kPoints> of{
        centroid(p), p[0], p[1], p[2], 0.5f * (p[0] + p[1]), 0.5f * (p[1] + p[2]), 0.5f * (p[2] + p[0])};
    std::copy(of.begin(), of.end(), points.begin() + std::ptrdiff_t(kPoints * i));
  });
  backend.evaluate(points, values, gradients);
  std::vector<std::uint8_t> on(triangles.size());
  for_each_index(triangles.size(), [&](std::size_t i) {
    const Triangle p = corners_of(mesh, triangles[i]);
    const Vec3 n = normal(p);
    bool good = true;
    for (int k = 0; k < 3; ++k) good &= glm::distance(p[k], p[(k + 1) % 3]) <= options.longest;
    for (std::size_t k = 0; k < kPoints && good; ++k) {
      const std::size_t at = kPoints * i + k;
      const float slope = std::max(glm::length(gradients[at]), kLeastSlope);
      good = std::abs(values[at]) <= options.reach * slope &&
             -glm::dot(n, gradients[at]) > (k == 0 ? kAgreeMiddle : kAgree) * slope;
    }
    on[i] = good;
  });
  return on;
}

/// Whether the point lies over or under the triangle, along its normal.
bool covers(const Triangle& p, const Vec3& n, const Vec3& point, float far) {
  if (std::abs(glm::dot(n, point - p[0])) > far) return false;
  for (int k = 0; k < 3; ++k)
    if (glm::dot(glm::cross(p[(k + 1) % 3] - p[k], point - p[k]), n) < 0.0f) return false;
  return true;
}

}  // namespace

std::vector<std::uint8_t> sound_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted,
                                          Backend& backend, const SoundOptions& options) {
  constexpr float kSlack = 1.001f;  // wider than rounding
  const std::vector<Index> asked = indices_where(mesh.triangle_count(), [&](Index t) {
    return wanted[mesh.vertex[3 * t]] || wanted[mesh.vertex[3 * t + 1]] || wanted[mesh.vertex[3 * t + 2]];
  });
  const std::vector<std::uint8_t> on = on_surface(mesh, asked, backend, options);
  std::vector<Index> good;
  for (std::size_t i = 0; i < asked.size(); ++i)
    if (on[i]) good.push_back(asked[i]);
  std::vector<Vec3> middle(good.size()), facing(good.size());
  std::vector<float> radius(good.size()), reach(good.size());  // about the middle: of itself, of all that it may cover
  for_each_index(good.size(), [&](std::size_t i) {
    const Triangle p = corners_of(mesh, good[i]);
    middle[i] = centroid(p);
    facing[i] = normal(p);
    for (const Vec3& corner : p) radius[i] = std::max(radius[i], kSlack * glm::distance(corner, middle[i]));
    reach[i] = kSlack * std::hypot(radius[i], options.layers);
  });
  const PointGrid near(middle, options.longest);
  std::vector<std::uint8_t> sound(mesh.triangle_count());
  for_each_index(good.size(), [&](std::size_t i) {
    constexpr float kAgree = 0.3f;  // cosine between normals of layers of one surface
    const Triangle own = corners_of(mesh, good[i]);
    bool alone = true;
    near.near(middle[i], [&](Index j, float square) {
      const float far = std::max(radius[i] + reach[j], radius[j] + reach[i]);
      if (!alone || j == i || square > far * far || glm::dot(facing[i], facing[j]) < kAgree ||
          share_a_vertex(mesh, good[i], good[j]))
        return;
      const Triangle other = corners_of(mesh, good[j]);
      alone =
          !covers(other, facing[j], middle[i], options.layers) && !covers(own, facing[i], middle[j], options.layers);
      for (int k = 0; k < 3 && alone; ++k)
        alone = !covers(other, facing[j], own[k], options.layers) && !covers(own, facing[i], other[k], options.layers);
    });
    sound[good[i]] = alone;
  });
  return sound;
}

}  // namespace isoskin
