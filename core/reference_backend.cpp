// The float64 host definition of every batch operation (core/backend.h).
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/backend.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

void require(bool ok, const char* what) {
  if (!ok) throw std::invalid_argument(std::string("reference backend: ") + what);
}

bool finite(const Vec3& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

float narrowed(double x) {
  constexpr double kLargest = std::numeric_limits<float>::max();
  return float(std::clamp(x, -kLargest, kLargest));
}

class ReferenceBackend final : public Backend {
public:
  std::string name() const override { return "reference"; }

  void set_field(std::shared_ptr<const Field> field) override {
    require(field != nullptr, "the field must not be null");
    field_ = std::move(field);
  }

  void evaluate(std::span<const Vec3> points, std::span<float> values, std::span<Vec3> gradients) override {
    require(values.size() == points.size(), "evaluate needs one value a point");
    require(gradients.empty() || gradients.size() == points.size(), "evaluate needs one gradient a point, or none");
    const Field& f = field();
    for_each_index(points.size(), [&](std::size_t i) {
      if (!finite(points[i])) {
        values[i] = std::numeric_limits<float>::quiet_NaN();
        if (!gradients.empty()) gradients[i] = Vec3(0.0f);
      } else if (gradients.empty()) {
        values[i] = narrowed(f.value(DVec3(points[i])));
      } else {
        const FieldSample s = f.sample(DVec3(points[i]));
        values[i] = narrowed(s.value);
        gradients[i] = {narrowed(s.gradient.x), narrowed(s.gradient.y), narrowed(s.gradient.z)};
      }
    });
  }

  void evaluate_hessian(std::span<const Vec3> points, std::span<float> hessians) override {
    require(hessians.size() == 6 * points.size(), "evaluate_hessian needs 6 floats a point");
    const Field& f = field();
    for_each_index(points.size(), [&](std::size_t i) {
      const DMat3 h = finite(points[i]) ? f.hessian(DVec3(points[i])) : DMat3(0.0);
      const double packed[6] = {h[0][0], h[1][1], h[2][2], h[1][0], h[2][0], h[2][1]};
      for (int k = 0; k < 6; ++k) hessians[6 * i + k] = narrowed(packed[k]);
    });
  }

  ProjectReport project(std::span<Vec3> points, const ProjectOptions& options,
                        std::span<ProjectStatus> status) override {
    require(status.empty() || status.size() == points.size(), "project needs one status a point, or none");
    if (!status.empty()) return project_points(field(), options, points, status);
    std::vector<ProjectStatus> own(points.size());
    return project_points(field(), options, points, own);
  }

  void set_mesh(const TriangleMesh& mesh, std::span<const std::uint8_t> pinned) override {
    require(pinned.empty() || pinned.size() == mesh.vertex_count(), "set_mesh needs one byte a vertex, or none");
    topology_ = skin_topology(mesh);
    positions_ = mesh.vertices.position;
    pinned_.assign(pinned.begin(), pinned.end());
    status_.assign(positions_.size(), ProjectStatus::converged);
  }

  RelaxReport relax(const RelaxOptions& relax, const ProjectOptions& project) override {
    return relax_skin(topology_, field(), relax, project, positions_, status_, pinned_);
  }

  ProjectReport project_mesh(const ProjectOptions& options) override {
    return project_points(field(), options, positions_, status_);
  }

  std::span<const Vec3> positions() override { return positions_; }
  std::span<const ProjectStatus> status() override { return status_; }

  void vertex_normals(std::span<Vec3> normals) override {
    require(normals.size() == positions_.size(), "vertex_normals needs one normal a resident vertex");
    const std::vector<DVec3> n = resident_normals(wide_positions());
    for_each_index(n.size(), [&](std::size_t i) { normals[i] = Vec3(n[i]); });
  }

  void inverted_triangles(std::span<std::uint8_t> inverted) override {
    require(inverted.size() == topology_.triangle_count(), "inverted_triangles needs one byte a resident triangle");
    const std::vector<DVec3> x = wide_positions();
    mark_inverted(topology_.vertex, x, resident_normals(x), inverted);
  }

private:
  const Field& field() const {
    require(field_ != nullptr, "no field: call set_field first");
    return *field_;
  }

  std::vector<DVec3> wide_positions() const { return {positions_.begin(), positions_.end()}; }

  std::vector<DVec3> resident_normals(std::span<const DVec3> x) const {
    std::vector<DVec3> normals(x.size());
    field_normals(field(), x, normals);
    return normals;
  }

  std::shared_ptr<const Field> field_;
  SkinTopology topology_{{}, {{0}, {}}};
  std::vector<Vec3> positions_;
  std::vector<std::uint8_t> pinned_;  // one a vertex, or none
  std::vector<ProjectStatus> status_;
};

}  // namespace

std::unique_ptr<Backend> make_reference_backend() {
  return std::make_unique<ReferenceBackend>();
}

}  // namespace isoskin
