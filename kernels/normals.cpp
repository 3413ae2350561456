#include "kernels/normals.h"

#include "embedded/normals.cl.h"

namespace isoskin::opencl {

Normals::Normals(Device& device)
    : device_(&device),
      vertex_normals_(device, {source::normals}, "vertex_normals"),
      mark_inverted_(device, {source::normals}, "mark_inverted") {}

}  // namespace isoskin::opencl
