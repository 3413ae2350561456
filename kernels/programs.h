// Contexts and built programs of OpenCL devices, kept for the process.
#pragma once

#include <CL/cl.h>

#include <filesystem>
#include <string>
#include <vector>

#include "kernels/opencl_backend.h"

namespace isoskin::opencl {

inline constexpr const char* kPocl = "Portable Computing Language";

/// Of an OpenCL error code.
const char* error_name(cl_int code);

/// Where PoCL keeps compiled kernels; it shows no device when it cannot write there.
std::filesystem::path pocl_cache();

/// The note that kernels of a PoCL device are compiled; empty for other drivers. Another version compiles anew.
std::filesystem::path note_of(const DeviceInfo& info);

/// The context that all Devices of this process share.
cl_context shared_context(cl_device_id id, cl_platform_id platform);

/// The program made of `prelude` and `sources` joined in order; built once for each device and process, and for PoCL
/// read from its cache where another process has built it. Throws std::runtime_error with the build log.
cl_program built_program(cl_device_id id, cl_context context, const char* prelude,
                         const std::vector<const char*>& sources, const std::string& options);

}  // namespace isoskin::opencl
