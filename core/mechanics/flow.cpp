#include "core/mechanics/flow.h"

#include <algorithm>
#include <utility>

#include "core/mesh/small_pieces.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

/// What displacements must be along one direction a vertex; zero directions ask for nothing.
struct NormalParts {
  std::vector<Vec3> direction;
  std::vector<float> length;
};

Vec3 normalized(const Vec3& v) {
  const float length = glm::length(v);
  return length > 0.0f ? v / length : Vec3(0.0f);
}

std::vector<Vec3> normals_of(const TriangleMesh& mesh, const VertexCorners& corners) {
  std::vector<Vec3> normals(mesh.vertex_count());
  for_each_index(normals.size(), [&](std::size_t v) {
    const Vec3& p = mesh.position(Index(v));
    Vec3 sum(0.0f);
    for (Index i = corners.first[v]; i < corners.first[v + 1]; ++i) {
      const Index h = corners.corner[i];
      sum += glm::cross(mesh.position(mesh.to(h)) - p, mesh.position(mesh.from(TriangleMesh::prev(h))) - p);
    }
    normals[v] = normalized(sum);
  });
  return normals;
}

/// Displacements become their neighbours' mean, but for what is known of them; Chebyshev's weights carry it as many
/// edges as there are sweeps (Jacobi's alone: their root). `neighbour`: one a corner.
void sweep(const VertexCorners& corners, const std::vector<Index>& neighbour, const NormalParts& known, int times,
           std::vector<Vec3>& displacement) {
  constexpr float kRadius = 0.95f;  // spectral, as of a small mesh: what is slower to settle is left to later frames
  std::vector<Vec3> before = displacement, next(displacement.size());
  float weight = 1.0f;
  for (int i = 0; i < times; ++i) {
    if (i > 0) weight = 1.0f / (1.0f - (i == 1 ? 0.5f : 0.25f) * kRadius * kRadius * weight);
    for_each_index(next.size(), [&](std::size_t v) {
      const Index begin = corners.first[v], end = corners.first[v + 1];
      if (begin == end) return;
      Vec3 sum(0.0f);
      for (Index c = begin; c < end; ++c) sum += displacement[neighbour[c]];
      const Vec3 mean = sum / float(end - begin);
      const Vec3& n = known.direction[v];
      const Vec3 mended = mean + (known.length[v] - glm::dot(n, mean)) * n;
      next[v] = before[v] + weight * (mended - before[v]);
    });
    std::swap(before, displacement);
    std::swap(displacement, next);
  }
}

/// A vertex on its way to the rim of the sheet it is in.
struct Walker {
  Index vertex;
  Vec3 at, heading;
};

/// Vertices that their displacement leaves inside while the surface nearest to them faces elsewhere than they do: the
/// rim of a sheet has outrun them. They walk on along the sheet, in the direction they face, until they come out of it
/// at a rim again; those that turn back, or get where it is no sheet, stay where they were.
void follow_rims(const TriangleMesh& mesh, const std::vector<Vec3>& normals, Backend& backend,
                 const FlowOptions& options, std::vector<Vec3>& displacement) {
  constexpr float kLeastSlope = 0.1f;  // of what a distance has: less is no side to keep off from
  constexpr float kAgree = 0.5f;       // cosine between what a vertex faces and what it comes out at
  constexpr float kAlong = 0.5f;       // of a heading: less is a bump in the middle of the sheet, to be walked over
  constexpr float kToMiddle = 0.5f;    // of a step
  const float step = 0.25f * options.half_sheet;
  std::vector<Walker> walkers(displacement.size());
  for_each_index(walkers.size(), [&](std::size_t v) {
    walkers[v] = {Index(v), mesh.position(Index(v)) + displacement[v], normals[v]};
  });
  for (int i = 0; i <= options.rim_steps && !walkers.empty(); ++i) {
    std::vector<Vec3> points(walkers.size()), gradients(walkers.size());
    std::vector<float> values(walkers.size());
    for_each_index(points.size(), [&](std::size_t w) { points[w] = walkers[w].at; });
    backend.evaluate(points, values, gradients);
    std::vector<Walker> walking;
    for (std::size_t w = 0; w < walkers.size(); ++w) {
      Walker walker = walkers[w];
      const float slope = glm::length(gradients[w]);
      const Vec3 outward = slope > kLeastSlope ? -gradients[w] / slope : Vec3(0.0f);
      const float agree = glm::dot(outward, walker.heading);
      if (i == 0 && (values[w] <= 0.0f || agree >= kAgree)) continue;  // nothing has outrun it
      if (values[w] <= 0.0f && agree > kAgree) displacement[walker.vertex] = walker.at - mesh.position(walker.vertex);
      if (values[w] <= 0.0f || !(values[w] <= options.half_sheet)) continue;
      const Vec3 along = walker.heading - agree * outward;
      if (glm::length(along) >= kAlong) walker.heading = normalized(along);
      if (glm::dot(walker.heading, normals[walker.vertex]) < 0.0f) continue;
      walker.at += step * (walker.heading - kToMiddle * outward);
      walking.push_back(walker);
    }
    walkers = std::move(walking);
  }
}

/// Where displaced vertices are near the surface: to land on it, along its normals there.
void aim(const TriangleMesh& mesh, const std::vector<Vec3>& displacement, Backend& backend, float max_step,
         NormalParts& known) {
  constexpr float kLeastSlope = 0.1f;  // of what a distance has: less is no direction to go by
  std::vector<Vec3> points(displacement.size()), gradients(displacement.size());
  std::vector<float> values(displacement.size());
  for_each_index(points.size(), [&](std::size_t v) { points[v] = mesh.position(Index(v)) + displacement[v]; });
  backend.evaluate(points, values, gradients);
  for_each_index(points.size(), [&](std::size_t v) {
    const float slope = glm::length(gradients[v]);
    const bool steep = slope > kLeastSlope;
    if (steep) known.direction[v] = -gradients[v] / slope;
    const float step = steep ? std::clamp(values[v] / slope, -max_step, max_step) : 0.0f;
    known.length[v] = glm::dot(known.direction[v], displacement[v]) + step;
  });
}

}  // namespace

std::vector<Vec3> surface_flow(const TriangleMesh& mesh, double dt, Backend& backend, float max_step,
                               const FlowOptions& options) {
  const VertexCorners corners = vertex_corners(mesh);
  std::vector<Index> neighbour(corners.corner.size());
  for_each_index(neighbour.size(), [&](std::size_t c) { neighbour[c] = mesh.to(corners.corner[c]); });
  std::vector<Vec3> displacement(mesh.vertex_count());
  NormalParts known{normals_of(mesh, corners), std::vector<float>(mesh.vertex_count())};
  for_each_index(displacement.size(), [&](std::size_t v) {
    displacement[v] = float(dt) * mesh.vertices.velocity[v];
    known.length[v] = glm::dot(known.direction[v], displacement[v]);
  });
  std::vector<std::pair<Index, Vec3>> small;
  for (const Index v : small_piece_vertices(mesh)) small.emplace_back(v, known.length[v] * known.direction[v]);
  sweep(corners, neighbour, known, options.sweeps, displacement);
  const std::vector<Vec3> normals = known.direction;
  for (int i = 0; i < options.aims; ++i) {
    if (options.half_sheet > 0.0f) follow_rims(mesh, normals, backend, options, displacement);
    aim(mesh, displacement, backend, max_step, known);
    sweep(corners, neighbour, known, options.sweeps, displacement);
  }
  for (const auto& [v, straight] : small) displacement[v] = straight;
  return displacement;
}

}  // namespace isoskin
