#include "kernels/device_field.h"

#include "embedded/evaluate.cl.h"
#include "embedded/normals.cl.h"
#include "embedded/packet.cl.h"
#include "embedded/project.cl.h"

namespace isoskin::opencl {

namespace {

// Out of line: GCC 12 takes double(float(x)) for x when it vectorises several at once, and the low part is lost.
[[gnu::noinline]] float rounded(double x) {
  return static_cast<float>(x);
}

}  // namespace

Origin make_origin(const DVec3& at) {
  Origin origin;
  for (int i = 0; i < 3; ++i) {
    origin.high[i] = rounded(at[i]);
    origin.low[i] = rounded(at[i] - origin.high[i]);
  }
  return origin;
}

const std::vector<const char*>& field_kernels() {
  static const std::vector<const char*> sources = {source::evaluate, source::project, source::normals};
  return sources;
}

const Kernel& FieldKernel::operator()(const DeviceField& field) {
  const Variant variant{field.source(), field.build_options()};
  auto it = built_.find(variant);
  if (it == built_.end()) {
    std::vector<const char*> program = {source::packet, field.source()};
    program.insert(program.end(), sources_.begin(), sources_.end());
    it = built_.emplace(variant, device_->kernel(program, variant.second, name_)).first;
  }
  return it->second;
}

}  // namespace isoskin::opencl
