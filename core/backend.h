// The batch interface through which every data-parallel step is asked for: one virtual call a batch, never one an
// element (design 2). reference_backend is its plain float64 definition; kernels/ holds the OpenCL one.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/field/field.h"
#include "core/mechanics/project.h"
#include "core/mechanics/relax.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// A backend holds one field and one mesh at a time. Positions stay with the backend from set_mesh() on, through
/// relax() and project_mesh(), until positions() is asked for. Not thread safe; parallel inside.
class Backend {
public:
  virtual ~Backend() = default;

  /// "reference" or the device's name.
  virtual std::string name() const = 0;

  /// Makes `field` the current one. Keeps a reference; uploads only what changed since the last call.
  /// Throws std::invalid_argument when the backend has no kernel for this kind of field.
  virtual void set_field(std::shared_ptr<const Field> field) = 0;

  /// F (and grad F unless `gradients` is empty) at `points`. values.size() == points.size(); gradients the same or 0.
  /// At a point that is not finite the field is not asked: value NaN, gradient zero. Larger values than float32 holds
  /// are clamped to it. Like every method below: std::invalid_argument for spans of another size or without a field.
  virtual void evaluate(std::span<const Vec3> points, std::span<float> values, std::span<Vec3> gradients) = 0;

  /// Second derivatives, 6 floats a point: xx yy zz xy xz yz; zero at a point that is not finite. hessians.size() == 6
  /// * points.size().
  virtual void evaluate_hessian(std::span<const Vec3> points, std::span<float> hessians) = 0;

  /// Moves each point onto F = 0 in place; those that fail stay. status.size() == points.size() (or 0: not wanted).
  virtual ProjectReport project(std::span<Vec3> points, const ProjectOptions& options,
                                std::span<ProjectStatus> status) = 0;

  /// Makes `mesh` the resident mesh: positions and topology are copied in. It may have borders, and needs no twins.
  /// `pinned` (one byte a vertex, or none): relax() does not move a pinned vertex but onto the surface.
  virtual void set_mesh(const TriangleMesh& mesh, std::span<const std::uint8_t> pinned = {}) = 0;

  /// Relaxes the resident mesh: per step assemble, filtered CG, move, project. The field must be set.
  virtual RelaxReport relax(const RelaxOptions& relax, const ProjectOptions& project) = 0;

  /// Projects the resident mesh's vertices.
  virtual ProjectReport project_mesh(const ProjectOptions& options) = 0;

  /// Resident positions; the span is valid until the next call of any other method.
  virtual std::span<const Vec3> positions() = 0;

  /// Status of every resident vertex after the last projection (converged for a fresh mesh).
  virtual std::span<const ProjectStatus> status() = 0;

  /// Outward unit normals -grad F / |grad F| at resident vertices, zero where the gradient vanishes.
  virtual void vertex_normals(std::span<Vec3> normals) = 0;

  /// 1 where a resident triangle is inverted: normal . grad F > 0 at all three corners (design 1).
  virtual void inverted_triangles(std::span<std::uint8_t> inverted) = 0;
};

/// The float64 host definition of every batch operation: easy to read, the oracle of the kernel tests, and able to run
/// any Field. Parallel over elements with oneTBB; the result does not depend on the number of threads.
std::unique_ptr<Backend> make_reference_backend();

}  // namespace isoskin
