#include "core/particles/spread.h"

#include "core/parallel.h"
#include "core/topology/point_grid.h"

namespace isoskin {

std::vector<Vec3> surface_normals(std::span<const Vec3> points, Backend& backend) {
  std::vector<float> values(points.size());
  std::vector<Vec3> normals(points.size());
  backend.evaluate(points, values, normals);
  for (Vec3& n : normals) n = Vec3(outward_normal(DVec3(n)));
  return normals;
}

void thin(std::vector<Vec3>& points, Backend& backend, const SpreadOptions& options) {
  const std::vector<Vec3> normals = surface_normals(points, backend);
  const PointGrid grid(points, float(options.thinned * options.spacing));
  std::vector<std::uint8_t> kept(points.size(), 0);
  std::vector<Vec3> thinned;
  for (std::size_t i = 0; i < points.size(); ++i) {
    bool crowded = false;
    grid.near(points[i], [&](Index j, float) { crowded |= kept[j] && glm::dot(normals[i], normals[j]) > 0.0f; });
    kept[i] = !crowded;
    if (!crowded) thinned.push_back(points[i]);
  }
  points = std::move(thinned);
}

void repel(std::vector<Vec3>& points, Backend& backend, const ProjectOptions& project, const SpreadOptions& options) {
  const float spacing = float(options.spacing), reach = float(options.reach) * spacing;
  const float strength = float(options.strength) * spacing, longest = float(options.longest_move) * spacing;
  std::vector<Vec3> moved(points.size());
  for (int round = 0; round < options.rounds; ++round) {
    const std::vector<Vec3> normals = surface_normals(points, backend);
    const PointGrid grid(points, reach);
    for_each_index(points.size(), [&](std::size_t i) {
      Vec3 push(0.0f);
      grid.near(points[i], [&](Index j, float square) {
        if (square == 0.0f || glm::dot(normals[i], normals[j]) <= 0.0f) return;
        const float distance = std::sqrt(square), near = 1.0f - distance / reach;
        push += near * near / distance * (points[i] - points[j]);
      });
      push = strength * (push - glm::dot(push, normals[i]) * normals[i]);
      if (const float size = glm::length(push); size > longest) push *= longest / size;
      moved[i] = points[i] + push;
    });
    std::vector<ProjectStatus> status(points.size());
    backend.project(moved, project, status);
    for_each_index(points.size(), [&](std::size_t i) {
      if (status[i] == ProjectStatus::converged) points[i] = moved[i];
    });
  }
}

}  // namespace isoskin
