// A field as kernels see it: the source text of its field_sample() and field_hessian(), and the buffers those read.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/field/field.h"
#include "kernels/device.h"

namespace isoskin::opencl {

/// The same fields as Origin in packet.cl.
struct Origin {
  float high[3] = {0, 0, 0};
  float low[3] = {0, 0, 0};
};
Origin make_origin(const DVec3& at);

class DeviceField {
public:
  virtual ~DeviceField() = default;
  /// True when this object can hold `field`'s kind.
  virtual bool takes(const Field& field) const = 0;
  /// Makes `field` the current one; uploads only what differs from the last. Precondition: takes(field).
  virtual void upload(const Field& field) = 0;
  virtual const char* source() const = 0;
  /// Options of the variant that the current field needs; different options are different programs.
  virtual std::string build_options() const = 0;
  /// Points a work item.
  virtual int width() const = 0;
  /// What kernels take positions relative to.
  virtual const Origin& origin() const = 0;
  /// Sets the arguments of FIELD_PARAMS.
  virtual void bind(Device& device, const Kernel& kernel, cl_uint& slot) const = 0;
};

std::unique_ptr<DeviceField> make_skeleton_device_field(Device& device);
std::unique_ptr<DeviceField> make_grid_device_field(Device& device);

/// The sources of evaluate.cl, project.cl and normals.cl: one program, since PoCL reads OpenCL's headers for each,
/// built before or not.
const std::vector<const char*>& field_kernels();

/// A kernel written over any field: built on first use for each variant of field it meets.
class FieldKernel {
public:
  /// `sources` follow the field's own in the program.
  FieldKernel(Device& device, std::vector<const char*> sources, const char* name)
      : device_(&device), sources_(std::move(sources)), name_(name) {}
  const Kernel& operator()(const DeviceField& field);

private:
  Device* device_;
  std::vector<const char*> sources_;
  const char* name_;
  using Variant = std::pair<const char*, std::string>;  // a field's source and options
  std::map<Variant, Kernel> built_;
};

}  // namespace isoskin::opencl
