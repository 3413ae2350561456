#include "core/mechanics/motion.h"

#include "core/parallel.h"

namespace isoskin {
namespace {

/// Where the prediction missed the surface, the old position may still find it.
void project_again_from(const std::vector<Vec3>& old, std::vector<Vec3>& position, std::vector<ProjectStatus>& status,
                        Backend& backend, const ProjectOptions& options) {
  std::vector<Index> failed;
  for (Index v = 0; v < status.size(); ++v)
    if (status[v] != ProjectStatus::converged) failed.push_back(v);
  if (failed.empty()) return;
  std::vector<Vec3> points;
  for (const Index v : failed) points.push_back(old[v]);
  std::vector<ProjectStatus> again(points.size());
  backend.project(points, options, again);
  for (std::size_t i = 0; i < failed.size(); ++i) {
    position[failed[i]] = points[i];
    status[failed[i]] = again[i];
  }
}

void set_velocities(VertexTable& vertices, const std::vector<Vec3>& old, const std::vector<ProjectStatus>& status,
                    double dt) {
  for_each_index(vertices.size(), [&](std::size_t v) {
    const bool moved = dt > 0.0 && status[v] == ProjectStatus::converged;
    vertices.velocity[v] = moved ? (vertices.position[v] - old[v]) / float(dt) : Vec3(0.0f);
  });
}

/// A step of Heun's method.
void advect(VertexTable& vertices, const VelocityField& velocity, double dt) {
  for_each_index(vertices.size(), [&](std::size_t v) {
    const DVec3 old(vertices.position[v]), step = dt * DVec3(vertices.velocity[v]);
    vertices.position[v] = Vec3(old + 0.5 * (step + dt * velocity.velocity(old + step)));
  });
}

/// Position within one triangle: weights of two edges that leave the same corner, by least squares.
struct EdgeWeights {
  double a, b;
};

EdgeWeights along_edges(const DVec3& d, const DVec3& edge_a, const DVec3& edge_b) {
  const double aa = glm::dot(edge_a, edge_a), ab = glm::dot(edge_a, edge_b), bb = glm::dot(edge_b, edge_b);
  const double determinant = aa * bb - ab * ab;
  if (!(determinant > 1e-12 * aa * bb)) return {-1.0, -1.0};  // a sliver has no inside to slide into
  const double da = glm::dot(d, edge_a), db = glm::dot(d, edge_b);
  return {(da * bb - db * ab) / determinant, (db * aa - da * ab) / determinant};
}

}  // namespace

void predict(TriangleMesh& mesh, const VelocityField* velocity, double dt, const Field& field, Backend& backend,
             const ProjectOptions& options, const OpenSet& open, const FlowOptions& flow) {
  if (!open.all()) {
    const std::vector<std::uint8_t>& frozen = open.frozen;
    OpenPart part = open_part(mesh, open);
    predict(part.mesh, velocity, dt, field, backend, options, {}, flow);
    for_each_index(frozen.size(), [&](std::size_t v) {
      if (frozen[v]) mesh.vertices.velocity[v] = Vec3(0.0f);
    });
    for_each_index(part.vertex.size(), [&](std::size_t i) {
      const Index v = part.vertex[i];
      if (frozen[v]) return;
      mesh.vertices.position[v] = part.mesh.vertices.position[i];
      mesh.vertices.velocity[v] = part.mesh.vertices.velocity[i];
    });
    return;
  }
  VertexTable& vertices = mesh.vertices;
  const std::vector<Vec3> old = vertices.position;
  if (velocity) {
    advect(vertices, *velocity, dt);
  } else if (dt > 0.0) {
    const std::vector<Vec3> way = surface_flow(mesh, dt, field, backend, options.max_step, flow);
    for_each_index(way.size(), [&](std::size_t v) { vertices.position[v] += way[v]; });
  }
  std::vector<ProjectStatus> status(mesh.vertex_count());
  backend.project(vertices.position, options, status);
  project_again_from(old, vertices.position, status, backend, options);
  if (!velocity) set_velocities(vertices, old, status, dt);
}

std::vector<Vec3> outward_normals(const std::vector<Vec3>& points, Backend& backend) {
  std::vector<float> values(points.size());
  std::vector<Vec3> normals(points.size());
  backend.evaluate(points, values, normals);
  for_each_index(normals.size(), [&](std::size_t i) { normals[i] = Vec3(outward_normal(DVec3(normals[i]))); });
  return normals;
}

void sample_velocities(TriangleMesh& mesh, const VelocityField& velocity) {
  for_each_index(mesh.vertex_count(), [&](std::size_t v) {
    mesh.vertices.velocity[v] = Vec3(velocity.velocity(DVec3(mesh.vertices.position[v])));
  });
}

void estimate_velocities(TriangleMesh& mesh, const Field& next, double dt, Backend& backend) {
  std::vector<float> values(mesh.vertex_count());
  std::vector<Vec3> gradients(mesh.vertex_count());
  backend.evaluate(mesh.vertices.position, values, gradients);
  for_each_index(mesh.vertex_count(), [&](std::size_t v) {
    const DVec3 g(gradients[v]);
    const double square = glm::dot(g, g);
    const double change = next.value(DVec3(mesh.vertices.position[v])) - double(values[v]);
    mesh.vertices.velocity[v] = square > 0.0 ? Vec3(-change / (dt * square) * g) : Vec3(0.0f);
  });
}

void slide_rest(TriangleMesh& mesh, const std::vector<Vec3>& before) {
  const VertexCorners corners = vertex_corners(mesh);
  const std::vector<Vec3> rest = mesh.vertices.rest;
  for_each_index(mesh.vertex_count(), [&](std::size_t v) {
    const DVec3 slid = DVec3(mesh.vertices.position[v]) - DVec3(before[v]);
    double best = -1.0;
    DVec3 change(0.0);
    for (Index i = corners.first[v]; i < corners.first[v + 1]; ++i) {
      const Index h = corners.corner[i];
      const Index a = mesh.to(h), b = mesh.from(TriangleMesh::prev(h));
      const auto edge = [&](Index to) { return DVec3(before[to]) - DVec3(before[v]); };
      EdgeWeights weights = along_edges(slid, edge(a), edge(b));
      const double inside = std::min(weights.a, weights.b);
      if (inside <= best) continue;
      best = inside;
      const double beyond = std::max(1.0, weights.a + weights.b);  // no farther than the opposite edge
      const auto turn = [&](Index to) { return DVec3(rest[to]) - DVec3(rest[v]); };
      change = (weights.a * turn(a) + weights.b * turn(b)) / beyond;
    }
    mesh.vertices.rest[v] = Vec3(DVec3(rest[v]) + change);
  });
}

}  // namespace isoskin
