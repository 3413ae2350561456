#include "kernels/element.h"

#include "embedded/element.cl.h"

namespace isoskin::opencl {

namespace {

Kernel element_kernel(Device& device, const char* name) {
  return device.kernel({source::element}, "-DVW=" + std::to_string(device.vector_width()), name);
}

}  // namespace

Elements::Elements(Device& device)
    : device_(&device),
      fem_forces_(element_kernel(device, "element_forces")),
      fem_product_(element_kernel(device, "element_product")),
      spring_forces_(element_kernel(device, "spring_forces")),
      spring_product_(element_kernel(device, "spring_product")),
      frames_(device),
      slots_(device) {}

void Elements::forces(const ResidentMesh& mesh, const Array<Vec3>& normals, const Array<std::uint8_t>& inverted,
                      const RelaxOptions& options) {
  const auto count = static_cast<cl_uint>(mesh.triangle_count());
  slots_.resize(9 * mesh.triangle_count());
  if (options.mechanics == Mechanics::springs) {
    device_->launch(spring_forces_, count, mesh.positions, mesh.vertex, slots_, material(options), count);
    return;
  }
  frames_.resize(8 * mesh.triangle_count());
  const cl_uint width = device_->vector_width();
  device_->launch_shares(fem_forces_, (count + width - 1) / width, mesh.positions, normals, inverted, mesh.vertex,
                         frames_, slots_, material(options), count);
}

Elements::Material Elements::material(const RelaxOptions& options) {
  const double nu = options.poisson;
  const double area = 0.25 * kSqrt3;  // of the rest triangle, in units of e^2
  return {options.edge_length, static_cast<float>(area * options.young / (1.0 - nu * nu)), options.poisson,
          options.spring};
}

}  // namespace isoskin::opencl
