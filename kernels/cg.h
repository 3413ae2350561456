// Launches cg.cl: filtered conjugate gradients with all scalars on the device.
#pragma once

#include "kernels/element.h"

namespace isoskin::opencl {

struct CgState {  // CgState in cg.cl
  cl_int done, iterations;
  float start, rr, alpha, beta;
};

class ConjugateGradients {
public:
  explicit ConjugateGradients(Device& device);

  /// Launches only: forgets the iterations counted so far.
  void reset();
  /// Launches only: solves (I + dt K) dx = dt f, filtered with S = I - n n^T (0 where pinned), for the forces and the
  /// stiffness that `elements` has frozen.
  void solve(const ResidentMesh& mesh, const Array<Vec3>& normals, Elements& elements, const RelaxOptions& options);
  /// Launches only: moves the resident positions by dx, each at most `longest`.
  void move(ResidentMesh& mesh, float longest);
  /// Gives back the memory of the vectors; nothing may be running.
  void let_go() {
    for (Array<float>* vector : {&x_, &r_, &p_, &q_}) vector->let_go();
  }
  /// Enqueues only; `state` is filled after Device::finish(): iterations since reset(), residual of the last solve.
  void fetch_state(CgState& state);

private:
  struct Share {  // Share in cg.cl
    cl_uint items, each, vertices;
  };
  Share share(std::size_t vertices) const;

  Device* device_;
  Kernel start_, product_, advance_, turn_, finish_start_, finish_alpha_, finish_beta_, move_;
  Array<float> x_, r_, p_, q_, partial_;
  Array<CgState> state_;
};

}  // namespace isoskin::opencl
