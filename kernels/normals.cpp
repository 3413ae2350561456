#include "kernels/normals.h"

namespace isoskin::opencl {

Normals::Normals(Device& device)
    : device_(&device),
      vertex_normals_(device, field_kernels(), "vertex_normals"),
      mark_inverted_(device, field_kernels(), "mark_inverted") {}

}  // namespace isoskin::opencl
