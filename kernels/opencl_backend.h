// The OpenCL backend: the kernels of this folder behind core's batch interface (design 2).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/backend.h"

namespace isoskin {

struct DeviceInfo {
  int index = 0;  // what --device takes
  std::string platform, name, version, driver;
  bool cpu = false;  // shares memory with the host: buffers are mapped, never copied
  unsigned compute_units = 0;
  std::size_t global_bytes = 0;
};

/// All OpenCL devices of all platforms, in a fixed order. Empty when there is none; never throws for that.
std::vector<DeviceInfo> list_devices();

struct OpenClOptions {
  int device = -1;     // index in list_devices(); -1: the first GPU, else the first device
  bool trace = false;  // profile every kernel and transfer (see core/trace.h)
};

/// False when this device compiles kernels as they are first used (PoCL does, for seconds) and has not done so for
/// isoskin on this machine: there is no note of it in PoCL's cache of kernels. Throws as make_opencl_backend().
bool kernels_are_compiled(const OpenClOptions& options = {});

/// Leaves that note; call it when kernels have run. A cache that cannot be written is left alone.
void note_compiled_kernels(const OpenClOptions& options = {});

/// Throws InputError when there is no such device ("no OpenCL device: install pocl-opencl-icd ..."), and
/// std::runtime_error with the build log when a program does not build. Compiled programs are cached.
std::unique_ptr<Backend> make_opencl_backend(const OpenClOptions& options = {});

}  // namespace isoskin
