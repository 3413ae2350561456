#include "kernels/opencl_backend.h"

#include <algorithm>
#include <optional>
#include <stdexcept>

#include "core/trace.h"
#include "kernels/device.h"
#include "kernels/device_field.h"
#include "kernels/evaluate.h"
#include "kernels/normals.h"
#include "kernels/project.h"
#include "kernels/relax.h"
#include "kernels/resident_mesh.h"

namespace isoskin {
namespace {

using opencl::Access;
using opencl::Array;
using opencl::Borrowed;
using opencl::View;

// Spans are taken in pieces of so many points: indices of floats stay within 32 bits, and a GPU need not hold them all.
constexpr std::size_t kPiece = std::size_t{1} << 26;

template <class Body>
void for_each_piece(std::size_t count, const Body& body) {
  for (std::size_t at = 0; at < count; at += kPiece) body(at, std::min(kPiece, count - at));
}

void require(bool ok, const char* what) {
  if (!ok) throw std::invalid_argument(std::string("opencl backend: ") + what);
}

class OpenClBackend final : public Backend {
public:
  explicit OpenClBackend(const OpenClOptions& options)
      : device_(options), evaluator_(device_), projector_(device_), normals_(device_), mesh_(device_) {
    kinds_.push_back(opencl::make_skeleton_device_field(device_));
    kinds_.push_back(opencl::make_grid_device_field(device_));
  }

  std::string name() const override { return device_.info().name; }

  void set_field(std::shared_ptr<const Field> field) override {
    require(field != nullptr, "the field must not be null");
    if (field == current_) return;
    for (const auto& kind : kinds_) {
      if (!kind->takes(*field)) continue;
      close_views();
      current_ = nullptr;
      device_.finish();
      kind->upload(*field);
      on_device_ = kind.get();
      current_ = std::move(field);
      return;
    }
    throw std::invalid_argument(
        "opencl backend: no kernel for this kind of field; expected SkeletonField, BlendGraphField or GridField");
  }

  void evaluate(std::span<const Vec3> points, std::span<float> values, std::span<Vec3> gradients) override {
    require(values.size() == points.size(), "evaluate needs one value a point");
    require(gradients.empty() || gradients.size() == points.size(), "evaluate needs one gradient a point, or none");
    const Span span("evaluate");
    close_views();
    for_each_piece(points.size(), [&](std::size_t at, std::size_t n) {
      evaluator_.evaluate(field(), points.subspan(at, n), values.subspan(at, n),
                          gradients.empty() ? gradients : gradients.subspan(at, n));
    });
  }

  void evaluate_hessian(std::span<const Vec3> points, std::span<float> hessians) override {
    require(hessians.size() == 6 * points.size(), "evaluate_hessian needs 6 floats a point");
    const Span span("evaluate_hessian");
    close_views();
    for_each_piece(points.size(), [&](std::size_t at, std::size_t n) {
      evaluator_.evaluate_hessian(field(), points.subspan(at, n), hessians.subspan(6 * at, 6 * n));
    });
  }

  ProjectReport project(std::span<Vec3> points, const ProjectOptions& options,
                        std::span<ProjectStatus> status) override {
    require(status.empty() || status.size() == points.size(), "project needs one status a point, or none");
    const Span span("project");
    close_views();
    ProjectReport report;
    for_each_piece(points.size(), [&](std::size_t at, std::size_t n) {
      const ProjectReport part =
          projector_.project(field(), points.subspan(at, n), options, status.empty() ? status : status.subspan(at, n));
      report.points += part.points;
      report.quasi_critical += part.quasi_critical;
    });
    return report;
  }

  void set_mesh(const TriangleMesh& mesh, std::span<const std::uint8_t> pinned) override {
    require(pinned.empty() || pinned.size() == mesh.vertex_count(), "set_mesh needs one byte a vertex, or none");
    require(mesh.vertex.size() < kPiece * 3 && mesh.vertex_count() < kPiece,
            "the mesh is too large for 32-bit indices");
    const Span span("set_mesh");
    close_views();
    mesh_.set(mesh, pinned);
  }

  RelaxReport relax(const RelaxOptions& relax, const ProjectOptions& project) override {
    const Span span("relax");
    close_views();
    check(relax);
    if (relax.steps <= 0 || mesh_.vertex_count() == 0) return {.steps = std::max(relax.steps, 0)};
    if (!relaxer_) relaxer_.emplace(device_);
    relaxer_->launch(field(), mesh_, projector_, normals_, relax, project);
    // What is asked for next comes with the report.
    open_views();
    inverted_view_.emplace(relaxer_->inverted(), Access::read);
    RelaxReport report = relaxer_->report();
    report.quasi_critical = opencl::count_status(status_view_->span()).quasi_critical;
    return report;
  }

  ProjectReport project_mesh(const ProjectOptions& options) override {
    const Span span("project_mesh");
    close_views();
    projector_.launch(field(), mesh_.positions, mesh_.status, mesh_.vertex_count(), options);
    const ProjectReport report = opencl::count_status(View<ProjectStatus>(mesh_.status, Access::read).span());
    device_.finish();
    return report;
  }

  std::span<const Vec3> positions() override {
    open_views();
    return positions_view_->span();
  }

  std::span<const ProjectStatus> status() override {
    open_views();
    return status_view_->span();
  }

  void vertex_normals(std::span<Vec3> normals) override {
    require(normals.size() == mesh_.vertex_count(), "vertex_normals needs one normal a resident vertex");
    if (normals.empty()) return;
    const Span span("vertex_normals");
    close_views();
    Borrowed out(device_, normals.data(), normals.size_bytes(), Access::write);
    normals_.vertex_normals(field(), mesh_, out);
    out.collect();
    device_.finish();
  }

  void inverted_triangles(std::span<std::uint8_t> inverted) override {
    require(inverted.size() == mesh_.triangle_count(), "inverted_triangles needs one byte a resident triangle");
    if (inverted.empty()) return;
    const Span span("inverted_triangles");
    if (inverted_view_) {
      std::ranges::copy(inverted_view_->span(), inverted.begin());
      return;
    }
    close_views();
    Array<Vec3> normals(device_);
    normals.resize(mesh_.vertex_count());
    Borrowed out(device_, inverted.data(), inverted.size_bytes(), Access::write);
    normals_.vertex_normals(field(), mesh_, normals);
    normals_.mark_inverted(field(), mesh_, normals, out);
    out.collect();
    device_.finish();
  }

private:
  const opencl::DeviceField& field() const {
    require(current_ != nullptr, "no field: call set_field first");
    return *on_device_;
  }

  /// Both at once: who asks for one asks for the other.
  void open_views() {
    if (!positions_view_) positions_view_.emplace(mesh_.positions, Access::read);
    if (!status_view_) status_view_.emplace(mesh_.status, Access::read);
  }

  void close_views() {
    positions_view_.reset();
    status_view_.reset();
    inverted_view_.reset();
  }

  opencl::Device device_;
  opencl::Evaluator evaluator_;
  opencl::Projector projector_;
  opencl::Normals normals_;
  opencl::ResidentMesh mesh_;
  std::optional<opencl::Relaxer> relaxer_;  // its programs take time to build: not before they are needed
  std::vector<std::unique_ptr<opencl::DeviceField>> kinds_;
  std::shared_ptr<const Field> current_;
  opencl::DeviceField* on_device_ = nullptr;
  std::optional<View<Vec3>> positions_view_;
  std::optional<View<ProjectStatus>> status_view_;
  std::optional<View<std::uint8_t>> inverted_view_;  // of the positions relax() left
};

}  // namespace

std::unique_ptr<Backend> make_opencl_backend(const OpenClOptions& options) {
  return std::make_unique<OpenClBackend>(options);
}

}  // namespace isoskin
