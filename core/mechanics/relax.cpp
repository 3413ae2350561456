#include "core/mechanics/relax.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/parallel.h"

namespace isoskin {
namespace {

constexpr std::size_t kDotChunk = 4096;  // fixed, so a sum has the same tree whatever the number of threads

double inner_product(std::span<const DVec3> a, std::span<const DVec3> b) {
  std::vector<double> partial((a.size() + kDotChunk - 1) / kDotChunk, 0.0);
  tbb::parallel_for(std::size_t{0}, partial.size(), [&](std::size_t chunk) {
    double sum = 0.0;
    const std::size_t end = std::min(a.size(), (chunk + 1) * kDotChunk);
    for (std::size_t i = chunk * kDotChunk; i < end; ++i) sum += glm::dot(a[i], b[i]);
    partial[chunk] = sum;
  });
  double sum = 0.0;
  for (const double p : partial) sum += p;
  return sum;
}

DVec3 clamped(const DVec3& d, double longest) {
  const double length = glm::length(d);
  if (!std::isfinite(length)) return DVec3(0.0);
  return length > longest ? d * (longest / length) : d;
}

DVec3 triangle_normal(std::span<const Index> vertex, std::span<const DVec3> positions, std::size_t t) {
  const DVec3& a = positions[vertex[3 * t]];
  return glm::cross(positions[vertex[3 * t + 1]] - a, positions[vertex[3 * t + 2]] - a);
}

}  // namespace

void check(const RelaxOptions& o) {
  const auto require = [](bool ok, const char* what) {
    if (!ok) throw std::invalid_argument(std::string("relax options: ") + what);
  };
  require(o.edge_length > 0 && std::isfinite(o.edge_length), "edge_length must be positive and finite");
  require(o.young >= 0 && std::isfinite(o.young), "young must not be negative");
  require(o.poisson > -1 && o.poisson < 1, "poisson must lie between -1 and 1");
  require(o.spring >= 0 && std::isfinite(o.spring), "spring must not be negative");
  require(o.dt > 0 && std::isfinite(o.dt), "dt must be positive and finite");
  require(o.max_move > 0, "max_move must be positive");
}

SkinTopology skin_topology(const TriangleMesh& mesh) {
  return {mesh.vertex, vertex_corners(mesh)};
}

Skin::Skin(const SkinTopology& topology, std::span<const DVec3> positions, std::span<const DVec3> normals,
           std::span<const std::uint8_t> inverted, const RelaxOptions& options, std::span<const std::uint8_t> pinned)
    : topology_(topology),
      positions_(positions),
      normals_(normals),
      pinned_(pinned),
      mechanics_(options.mechanics),
      material_{options.edge_length, options.young, options.poisson, options.spring},
      corner_values_(topology.triangle_count()) {
  if (mechanics_ != Mechanics::fem) return;
  frames_.resize(topology.triangle_count());
  for_each_index(frames_.size(), [&](std::size_t t) {
    const Index* v = &topology.vertex[3 * t];
    const Corners p{positions[v[0]], positions[v[1]], positions[v[2]]};
    frames_[t] = element_frame(p, inverted[t] != 0, normals[v[0]] + normals[v[1]] + normals[v[2]]);
  });
}

template <class ElementFunction>
void Skin::gather(std::span<DVec3> sums, const ElementFunction& element) const {
  for_each_index(corner_values_.size(), [&](std::size_t t) {
    const Index* v = &topology_.vertex[3 * t];
    corner_values_[t] = element(t, v[0], v[1], v[2]);
  });
  for_each_index(sums.size(), [&](std::size_t v) {
    DVec3 sum(0.0);
    for (Index i = topology_.corners.first[v]; i < topology_.corners.first[v + 1]; ++i) {
      const Index corner = topology_.corners.corner[i];
      sum += corner_values_[corner / 3][corner % 3];
    }
    sums[v] = sum;
  });
}

std::vector<DVec3> Skin::forces() const {
  std::vector<DVec3> f(vertex_count());
  gather(f, [&](std::size_t t, Index a, Index b, Index c) {
    const Corners p{positions_[a], positions_[b], positions_[c]};
    return mechanics_ == Mechanics::fem ? element_forces(frames_[t], p, material_) : spring_forces(p, material_);
  });
  return f;
}

void Skin::stiffness_times(std::span<const DVec3> d, std::span<DVec3> product) const {
  gather(product, [&](std::size_t t, Index a, Index b, Index c) {
    const Corners dx{d[a], d[b], d[c]};
    if (mechanics_ == Mechanics::fem) return element_stiffness_times(frames_[t], dx, material_);
    return spring_stiffness_times({positions_[a], positions_[b], positions_[c]}, dx, material_);
  });
}

void Skin::filter(std::span<DVec3> d) const {
  for_each_index(d.size(), [&](std::size_t v) {
    d[v] = !pinned_.empty() && pinned_[v] ? DVec3(0.0) : d[v] - glm::dot(normals_[v], d[v]) * normals_[v];
  });
}

QuasiStaticMove quasi_static_move(const Skin& skin, const RelaxOptions& options) {
  const std::size_t n = skin.vertex_count();
  QuasiStaticMove result{std::vector<DVec3>(n, DVec3(0.0)), 0, 0.0};
  std::vector<DVec3> r = skin.forces();
  for_each_index(n, [&](std::size_t i) { r[i] *= double(options.dt); });
  skin.filter(r);
  std::vector<DVec3> p = r, ap(n);
  const double start = inner_product(r, r);
  double rr = start;
  const double enough = double(options.cg_tolerance) * options.cg_tolerance * start;
  while (result.iterations < options.cg_iterations && rr > enough) {
    skin.stiffness_times(p, ap);
    for_each_index(n, [&](std::size_t i) { ap[i] = p[i] + double(options.dt) * ap[i]; });
    skin.filter(ap);
    const double pap = inner_product(p, ap);
    if (!(pap > 0.0)) break;  // only when p has vanished: the system is positive definite
    const double alpha = rr / pap;
    for_each_index(n, [&](std::size_t i) {
      result.move[i] += alpha * p[i];
      r[i] -= alpha * ap[i];
    });
    const double previous = rr;
    rr = inner_product(r, r);
    for_each_index(n, [&](std::size_t i) { p[i] = r[i] + rr / previous * p[i]; });
    ++result.iterations;
  }
  result.residual = start > 0.0 ? std::sqrt(rr / start) : 0.0;
  return result;
}

void field_normals(const Field& field, std::span<const DVec3> positions, std::span<DVec3> normals) {
  for_each_index(positions.size(), [&](std::size_t i) {
    const DVec3 normal = outward_normal(field.sample(positions[i]).gradient);
    normals[i] = std::isfinite(glm::dot(normal, normal)) ? normal : DVec3(0.0);
  });
}

void mark_inverted(std::span<const Index> vertex, std::span<const DVec3> positions, std::span<const DVec3> normals,
                   std::span<std::uint8_t> inverted) {
  for_each_index(inverted.size(), [&](std::size_t t) {
    const DVec3 normal = triangle_normal(vertex, positions, t);
    bool all = true;
    for (int k = 0; k < 3; ++k) all = all && glm::dot(normal, normals[vertex[3 * t + k]]) < 0.0;
    inverted[t] = all;
  });
}

void pull_to_sharp_features(const SkinTopology& topology, const Field& field, const ProjectOptions& project,
                            double max_pull, std::span<DVec3> positions) {
  struct Plane {
    DVec3 through{0.0}, normal{0.0};
    double area = 0.0;  // 0: no plane here
  };
  std::vector<Plane> planes(topology.triangle_count());
  for_each_index(planes.size(), [&](std::size_t t) {
    const Index* v = &topology.vertex[3 * t];
    const Projection c = project_point(field, (positions[v[0]] + positions[v[1]] + positions[v[2]]) / 3.0, project);
    if (c.status != ProjectStatus::converged) return;
    const DVec3 normal = outward_normal(field.sample(c.point).gradient);
    planes[t] = {c.point, normal, 0.5 * glm::length(triangle_normal(topology.vertex, positions, t))};
  });
  for_each_index(positions.size(), [&](std::size_t v) {
    DVec3 pull(0.0);
    double area = 0.0;
    for (Index i = topology.corners.first[v]; i < topology.corners.first[v + 1]; ++i) {
      const Plane& plane = planes[topology.corners.corner[i] / 3];
      pull += plane.area * glm::dot(plane.through - positions[v], plane.normal) * plane.normal;
      area += plane.area;
    }
    if (area > 0.0) positions[v] += clamped(pull / area, max_pull);
  });
}

ProjectReport project_points(const Field& field, const ProjectOptions& options, std::span<Vec3> points,
                             std::span<ProjectStatus> status) {
  for_each_index(points.size(), [&](std::size_t i) {
    const Projection projected = project_point(field, DVec3(points[i]), options);
    status[i] = projected.status;
    if (projected.status == ProjectStatus::converged) points[i] = Vec3(projected.point);
  });
  ProjectReport report{points.size(), 0};
  for (const ProjectStatus s : status) report.quasi_critical += s != ProjectStatus::converged;
  return report;
}

RelaxReport relax_skin(const SkinTopology& topology, const Field& field, const RelaxOptions& relax,
                       const ProjectOptions& project, std::span<Vec3> positions, std::span<ProjectStatus> status,
                       std::span<const std::uint8_t> pinned) {
  check(relax);
  const std::size_t n = positions.size();
  const double max_move = double(relax.max_move) * relax.edge_length;
  std::vector<DVec3> x(n), normals(n);
  std::vector<std::uint8_t> inverted(topology.triangle_count());
  RelaxReport report;
  const auto put_on_surface = [&] {
    for_each_index(n, [&](std::size_t i) { positions[i] = Vec3(x[i]); });
    report.quasi_critical = project_points(field, project, positions, status).quasi_critical;
    for_each_index(n, [&](std::size_t i) { x[i] = DVec3(positions[i]); });
  };
  for_each_index(n, [&](std::size_t i) { x[i] = DVec3(positions[i]); });
  for (; report.steps < relax.steps; ++report.steps) {
    field_normals(field, x, normals);
    mark_inverted(topology.vertex, x, normals, inverted);
    const Skin skin(topology, x, normals, inverted, relax, pinned);
    const QuasiStaticMove solved = quasi_static_move(skin, relax);
    for_each_index(n, [&](std::size_t i) { x[i] += clamped(solved.move[i], max_move); });
    put_on_surface();
    for (int pull = 0; relax.sharp && pull < relax.sharp_pulls; ++pull) {
      pull_to_sharp_features(topology, field, project, max_move, x);
      put_on_surface();
    }
    report.cg_iterations += solved.iterations;
    report.residual = solved.residual;
    report.inverted = std::size_t(std::count(inverted.begin(), inverted.end(), std::uint8_t{1}));
  }
  return report;
}

}  // namespace isoskin
