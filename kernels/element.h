// Launches element.cl: forces and stiffness products of the skin's elements, written to corner slots.
#pragma once

#include "core/mechanics/relax.h"
#include "kernels/resident_mesh.h"

namespace isoskin::opencl {

class Elements {
public:
  explicit Elements(Device& device);

  /// Launches only: negated forces at the resident positions into the slots; freezes the elements' frames there.
  /// normals: outward, one a vertex; inverted: one byte a triangle.
  void forces(const ResidentMesh& mesh, const Array<Vec3>& normals, const Array<std::uint8_t>& inverted,
              const RelaxOptions& options);

  /// Launches only: the stiffness frozen by forces() times `d` (3 floats a vertex) into the slots. Does nothing when
  /// the first int of `done` is not 0.
  template <class Vector, class Flag>
  void product(const ResidentMesh& mesh, const Vector& d, const Flag& done, const RelaxOptions& options) {
    const auto count = static_cast<cl_uint>(mesh.triangle_count());
    if (options.mechanics == Mechanics::fem)
      device_->launch(fem_product_, count, frames_, mesh.vertex, d, slots_, done, material(options), count);
    else
      device_->launch(spring_product_, count, mesh.positions, mesh.vertex, d, slots_, done, material(options), count);
  }

  /// Gives back the memory of slots and frames, which are over. Nothing may be running.
  void let_go() {
    frames_.let_go();
    slots_.let_go();
  }

  /// 3 floats a corner.
  const Array<float>& slots() const { return slots_; }

private:
  struct Material {  // ElementParams in element.cl
    float edge_length, stiffness, poisson, spring;
  };
  static Material material(const RelaxOptions& options);

  Device* device_;
  Kernel fem_forces_, fem_product_, spring_forces_, spring_product_;
  Array<float> frames_, slots_;
};

}  // namespace isoskin::opencl
