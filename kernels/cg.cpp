#include "kernels/cg.h"

#include "embedded/cg.cl.h"

namespace isoskin::opencl {
namespace {

constexpr cl_uint kCpuShare = 1024;      // vertices of one work item; a multiple of 16
constexpr cl_uint kMostGpuItems = 4096;  // one item adds up their partial sums

Kernel cg_kernel(Device& device, const char* name) {
  return device.kernel({source::cg}, "-DVW=" + std::to_string(device.vector_width()), name);
}

}  // namespace

ConjugateGradients::ConjugateGradients(Device& device)
    : device_(&device),
      start_(cg_kernel(device, "start")),
      product_(cg_kernel(device, "product")),
      advance_(cg_kernel(device, "advance")),
      turn_(cg_kernel(device, "turn")),
      finish_start_(cg_kernel(device, "finish_start")),
      finish_alpha_(cg_kernel(device, "finish_alpha")),
      finish_beta_(cg_kernel(device, "finish_beta")),
      move_(cg_kernel(device, "move")),
      x_(device),
      r_(device),
      p_(device),
      q_(device),
      partial_(device),
      state_(device) {
  state_.resize(1);
}

void ConjugateGradients::reset() {
  state_.clear();
}

void ConjugateGradients::solve(const ResidentMesh& mesh, const Array<Vec3>& normals, Elements& elements,
                               const RelaxOptions& options) {
  const Share own = share(mesh.vertex_count());
  for (Array<float>* vector : {&x_, &r_, &p_, &q_}) vector->resize(std::size_t{3} * own.items * own.each);
  partial_.resize(own.items);
  device_->launch_shares(start_, own.items, mesh.first, mesh.corner, elements.slots(), normals, mesh.pinned, x_, r_, p_,
                         partial_, options.dt, own);
  device_->launch_shares(finish_start_, 1, partial_, state_, options.cg_tolerance, own.items);
  for (int i = 0; i < options.cg_iterations; ++i) {
    elements.product(mesh, p_, state_, options);
    device_->launch_shares(product_, own.items, mesh.first, mesh.corner, elements.slots(), normals, mesh.pinned, p_, q_,
                           partial_, state_, options.dt, own);
    device_->launch_shares(finish_alpha_, 1, partial_, state_, own.items);
    device_->launch_shares(advance_, own.items, x_, r_, p_, q_, partial_, state_, own);
    device_->launch_shares(finish_beta_, 1, partial_, state_, options.cg_tolerance, own.items);
    device_->launch_shares(turn_, own.items, p_, r_, state_, own);
  }
}

void ConjugateGradients::move(ResidentMesh& mesh, float longest) {
  const auto count = static_cast<cl_uint>(mesh.vertex_count());
  device_->launch(move_, count, mesh.positions, x_, longest, count);
}

void ConjugateGradients::fetch_state(CgState& state) {
  state_.fetch({&state, 1});
}

ConjugateGradients::Share ConjugateGradients::share(std::size_t vertices) const {
  const auto n = static_cast<cl_uint>(vertices);
  const cl_uint each = device_->info().cpu ? kCpuShare : (n + kMostGpuItems - 1) / kMostGpuItems;
  return {each == 0 ? 0 : (n + each - 1) / each, each, n};
}

}  // namespace isoskin::opencl
