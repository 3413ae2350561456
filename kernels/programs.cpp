#include "kernels/programs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <mutex>

#include "kernels/device.h"

namespace isoskin::opencl {
namespace {

/// What all Devices of one OpenCL device share. Kept until the process ends: drivers dislike late releases.
struct Shared {
  cl_context context = nullptr;
  std::map<std::string, cl_program> programs;  // source and options -> built program
};

std::mutex shared_guard;

Shared& shared(cl_device_id id) {
  static auto* all = new std::map<cl_device_id, Shared>;
  return (*all)[id];
}

std::string build_log(cl_program program, cl_device_id id) {
  std::size_t bytes = 0;
  if (clGetProgramBuildInfo(program, id, CL_PROGRAM_BUILD_LOG, 0, nullptr, &bytes) != CL_SUCCESS) return "(no log)";
  std::string log(bytes, '\0');
  clGetProgramBuildInfo(program, id, CL_PROGRAM_BUILD_LOG, bytes, log.data(), nullptr);
  while (!log.empty() && log.back() == '\0') log.pop_back();
  return log;
}

using Program = Owned<cl_program, clReleaseProgram>;

Program build_source(cl_device_id id, cl_context context, const std::string& flags, const std::string& text) {
  cl_int code = CL_SUCCESS;
  const char* pointer = text.c_str();
  Program program(clCreateProgramWithSource(context, 1, &pointer, nullptr, &code));
  check(code, "clCreateProgramWithSource");
  code = clBuildProgram(program.get(), 1, &id, flags.c_str(), nullptr, nullptr);
  if (code != CL_SUCCESS)
    throw std::runtime_error(
        fmt::format("clBuildProgram({}): {} ({})\n{}", flags, error_name(code), code, build_log(program.get(), id)));
  return program;
}

}  // namespace

const char* error_name(cl_int code) {
  switch (code) {
    case CL_DEVICE_NOT_FOUND:
      return "CL_DEVICE_NOT_FOUND";
    case CL_DEVICE_NOT_AVAILABLE:
      return "CL_DEVICE_NOT_AVAILABLE";
    case CL_COMPILER_NOT_AVAILABLE:
      return "CL_COMPILER_NOT_AVAILABLE";
    case CL_MEM_OBJECT_ALLOCATION_FAILURE:
      return "CL_MEM_OBJECT_ALLOCATION_FAILURE";
    case CL_OUT_OF_RESOURCES:
      return "CL_OUT_OF_RESOURCES";
    case CL_OUT_OF_HOST_MEMORY:
      return "CL_OUT_OF_HOST_MEMORY";
    case CL_BUILD_PROGRAM_FAILURE:
      return "CL_BUILD_PROGRAM_FAILURE";
    case CL_MAP_FAILURE:
      return "CL_MAP_FAILURE";
    case CL_INVALID_VALUE:
      return "CL_INVALID_VALUE";
    case CL_INVALID_DEVICE:
      return "CL_INVALID_DEVICE";
    case CL_INVALID_CONTEXT:
      return "CL_INVALID_CONTEXT";
    case CL_INVALID_MEM_OBJECT:
      return "CL_INVALID_MEM_OBJECT";
    case CL_INVALID_BUILD_OPTIONS:
      return "CL_INVALID_BUILD_OPTIONS";
    case CL_INVALID_PROGRAM_EXECUTABLE:
      return "CL_INVALID_PROGRAM_EXECUTABLE";
    case CL_INVALID_KERNEL_NAME:
      return "CL_INVALID_KERNEL_NAME";
    case CL_INVALID_ARG_INDEX:
      return "CL_INVALID_ARG_INDEX";
    case CL_INVALID_ARG_VALUE:
      return "CL_INVALID_ARG_VALUE";
    case CL_INVALID_ARG_SIZE:
      return "CL_INVALID_ARG_SIZE";
    case CL_INVALID_KERNEL_ARGS:
      return "CL_INVALID_KERNEL_ARGS";
    case CL_INVALID_WORK_GROUP_SIZE:
      return "CL_INVALID_WORK_GROUP_SIZE";
    case CL_INVALID_BUFFER_SIZE:
      return "CL_INVALID_BUFFER_SIZE";
    default:
      return "error";
  }
}

std::filesystem::path pocl_cache() {
  if (const char* set = std::getenv("POCL_CACHE_DIR")) return set;
  if (const char* set = std::getenv("XDG_CACHE_HOME")) return std::filesystem::path(set) / "pocl";
  if (const char* set = std::getenv("HOME")) return std::filesystem::path(set) / ".cache" / "pocl";
  return {};
}

std::filesystem::path note_of(const DeviceInfo& info) {
  if (info.platform != kPocl || pocl_cache().empty()) return {};
  const std::string kind = info.name.substr(0, info.name.find('-'));
  std::string name = "isoskin-" + info.driver + '-' + kind + ".compiled";
  std::replace(name.begin(), name.end(), '/', '-');
  return pocl_cache() / name;
}

cl_context shared_context(cl_device_id id, cl_platform_id platform) {
  const std::lock_guard lock(shared_guard);
  Shared& s = shared(id);
  if (!s.context) {
    const cl_context_properties properties[] = {CL_CONTEXT_PLATFORM, reinterpret_cast<cl_context_properties>(platform),
                                                0};
    cl_int code = CL_SUCCESS;
    s.context = clCreateContext(properties, 1, &id, nullptr, nullptr, &code);
    check(code, "clCreateContext");
  }
  return s.context;
}

cl_program built_program(cl_device_id id, cl_context context, const char* prelude,
                         const std::vector<const char*>& sources, const std::string& options) {
  std::string text = prelude;
  for (const char* source : sources) text += source;
  const std::lock_guard lock(shared_guard);
  cl_program& slot = shared(id).programs[options + '\n' + text];
  if (slot) return slot;

  const std::string flags = "-cl-std=CL1.2 " + options;
  const Program program = build_source(id, context, flags, text);
  check(clRetainProgram(program.get()), "clRetainProgram");
  return slot = program.get();
}

}  // namespace isoskin::opencl
