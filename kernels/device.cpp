#define CL_USE_DEPRECATED_OPENCL_1_2_APIS  // clCreateCommandQueue: its successor is missing on 1.2 devices
#include "kernels/device.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <new>

#include "core/trace.h"
#include "kernels/programs.h"

namespace isoskin::opencl {
namespace {

constexpr std::size_t kPage = 4096;
constexpr std::size_t kMostKept = std::size_t{1} << 24;  // bytes of a block that goes back to the pool
constexpr std::size_t kMostPending = 1 << 14;            // profiled events kept before they are read back

// Host threads share a launch in parts that take so long, far longer than to enqueue one, and in so many that none
// waits long for the last.
constexpr double kPartSeconds = 20e-6;
constexpr std::size_t kPartsAThread = 4;
// Their global ids begin here: PoCL compiles a kernel once for launches from zero and once more for all others.
constexpr std::size_t kFirstItem = 256;
// PoCL 3.1 loads a kernel again for a larger launch than all before, and then confuses the two where several threads
// run it (pocl_release_dlhandle_cache). So the first launch is as large as any, of items behind the end of all arrays.
constexpr std::size_t kMostGroups = 1000;  // of a part
constexpr std::size_t kFarItem = std::size_t{1} << 27;
// The work item's number, in every program.
constexpr const char* kItem = "#define ITEM get_global_id(0)\n";
constexpr const char* kDrivenItem = "#define ITEM (get_global_id(0) - 256)\n";

struct Found {
  cl_platform_id platform;
  cl_device_id id;
  DeviceInfo info;
};

std::string text_info(cl_device_id id, cl_device_info what) {
  std::size_t bytes = 0;
  check(clGetDeviceInfo(id, what, 0, nullptr, &bytes), "clGetDeviceInfo");
  std::string text(bytes, '\0');
  check(clGetDeviceInfo(id, what, bytes, text.data(), nullptr), "clGetDeviceInfo");
  while (!text.empty() && text.back() == '\0') text.pop_back();
  return text;
}

std::string text_info(cl_platform_id platform, cl_platform_info what) {
  std::size_t bytes = 0;
  check(clGetPlatformInfo(platform, what, 0, nullptr, &bytes), "clGetPlatformInfo");
  std::string text(bytes, '\0');
  check(clGetPlatformInfo(platform, what, bytes, text.data(), nullptr), "clGetPlatformInfo");
  while (!text.empty() && text.back() == '\0') text.pop_back();
  return text;
}

std::string platform_name(cl_platform_id platform) {
  return text_info(platform, CL_PLATFORM_NAME);
}

template <class T>
T number_info(cl_device_id id, cl_device_info what) {
  T value{};
  check(clGetDeviceInfo(id, what, sizeof value, &value, nullptr), "clGetDeviceInfo");
  return value;
}

/// Does the device run what is enqueued at once, in the thread that enqueues it, and take pointers to any memory?
bool is_driven(const DeviceInfo& info) {
  return info.platform == kPocl && info.name.starts_with("basic-") && info.driver.starts_with("3.");
}

std::size_t host_threads() {
  return tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
}

/// Lets PoCL 3, of which that is known, show the device that runs kernels in the caller's thread before the one that
/// has threads of its own. To be called before its devices are asked for.
void ask_for_basic_device(cl_platform_id platform) {
  if (platform_name(platform) == kPocl && text_info(platform, CL_PLATFORM_VERSION).find("PoCL 3.") != std::string::npos)
    setenv("POCL_DEVICES", "basic pthread", 0);
}

std::vector<Found> find_devices() {
  cl_uint count = 0;
  if (clGetPlatformIDs(0, nullptr, &count) != CL_SUCCESS || count == 0) return {};
  std::vector<cl_platform_id> platforms(count);
  check(clGetPlatformIDs(count, platforms.data(), nullptr), "clGetPlatformIDs");
  // The loader lists platforms in the order of a directory scan: sort, so that an index means the same tomorrow.
  std::stable_sort(platforms.begin(), platforms.end(),
                   [](cl_platform_id a, cl_platform_id b) { return platform_name(a) < platform_name(b); });
  std::vector<Found> found;
  for (cl_platform_id platform : platforms) {
    ask_for_basic_device(platform);
    cl_uint devices = 0;
    if (clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 0, nullptr, &devices) != CL_SUCCESS) continue;
    std::vector<cl_device_id> ids(devices);
    check(clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, devices, ids.data(), nullptr), "clGetDeviceIDs");
    for (cl_device_id id : ids) {
      DeviceInfo info;
      info.index = static_cast<int>(found.size());
      info.platform = platform_name(platform);
      info.name = text_info(id, CL_DEVICE_NAME);
      info.version = text_info(id, CL_DEVICE_VERSION);
      info.driver = text_info(id, CL_DRIVER_VERSION);
      info.cpu = (number_info<cl_device_type>(id, CL_DEVICE_TYPE) & CL_DEVICE_TYPE_CPU) != 0;
      info.compute_units = is_driven(info) ? static_cast<unsigned>(host_threads())
                                           : number_info<cl_uint>(id, CL_DEVICE_MAX_COMPUTE_UNITS);
      info.global_bytes = number_info<cl_ulong>(id, CL_DEVICE_GLOBAL_MEM_SIZE);
      found.push_back({platform, id, std::move(info)});
    }
  }
  return found;
}

/// Tries it: permissions alone say little to root or on a read-only file system.
bool can_write(const std::filesystem::path& folder) {
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  const std::filesystem::path probe = folder / "isoskin-probe";
  const bool written = !failed && (std::ofstream(probe) << "x").flush().good();
  std::filesystem::remove(probe, failed);
  return written;
}

Found choose_device(int index) {
  std::vector<Found> found = find_devices();
  if (found.empty()) {
    const std::filesystem::path cache = pocl_cache();
    if (!cache.empty() && !can_write(cache))
      throw InputError(
          fmt::format("no OpenCL device: the kernel cache folder {} cannot be written; expected a "
                      "writable folder in POCL_CACHE_DIR",
                      cache.string()));
    throw InputError(
        "no OpenCL device: expected a GPU driver or PoCL (install pocl-opencl-icd; check OCL_ICD_VENDORS if it is "
        "set)");
  }
  if (index >= static_cast<int>(found.size()) || index < -1)
    throw InputError(fmt::format("OpenCL device {}: no such device; expected 0 to {}", index, found.size() - 1));
  if (index >= 0) return found[index];
  const auto gpu = std::find_if(found.begin(), found.end(), [](const Found& f) { return !f.info.cpu; });
  return gpu != found.end() ? *gpu : found.front();
}

/// Four sizes for each power of two, so that a mesh that grows a little finds its old blocks again.
std::size_t size_class(std::size_t bytes) {
  std::size_t step = kPage;
  while (8 * step < bytes) step *= 2;
  return (bytes + step - 1) / step * step;
}

cl_map_flags map_flags(Access access) {
  if (access == Access::read) return CL_MAP_READ;
  return access == Access::write ? CL_MAP_WRITE_INVALIDATE_REGION : CL_MAP_READ | CL_MAP_WRITE;
}

}  // namespace

void check(cl_int code, const char* call) {
  if (code != CL_SUCCESS) throw std::runtime_error(fmt::format("{}: {} ({})", call, error_name(code), code));
}

Device::Device(const OpenClOptions& options, bool like_gpu) : profile_(options.trace) {
  Found found = choose_device(options.device);
  info_ = std::move(found.info);
  id_ = found.id;
  info_.cpu = info_.cpu && !like_gpu;
  driven_ = info_.cpu && is_driven(info_);
  if (info_.cpu) share_local_size_ = 1;
  if (driven_) packet_local_size_ = 8;  // small parts for many threads
  context_ = shared_context(id_, found.platform);
  cl_int code = CL_SUCCESS;
  // The 1.2 call: clCreateCommandQueueWithProperties is missing on 1.2 devices.
  queue_ = Queue(clCreateCommandQueue(context_, id_, profile_ ? CL_QUEUE_PROFILING_ENABLE : 0, &code));
  check(code, "clCreateCommandQueue");
  if (profile_) {
    cl_event event = nullptr;
    check(clEnqueueMarkerWithWaitList(queue_.get(), 0, nullptr, &event), "clEnqueueMarkerWithWaitList");
    check(clWaitForEvents(1, &event), "clWaitForEvents");
    host_zero_ = std::chrono::steady_clock::now();
    check(clGetEventProfilingInfo(event, CL_PROFILING_COMMAND_END, sizeof device_zero_, &device_zero_, nullptr),
          "clGetEventProfilingInfo");
    clReleaseEvent(event);
  }
}

Device::~Device() {
  clFinish(queue_.get());
  for (const Pending& p : pending_) clReleaseEvent(p.event);
}

Kernel Device::kernel(const std::vector<const char*>& sources, const std::string& build_options, const char* name) {
  const cl_program program = built_program(id_, context_, driven_ ? kDrivenItem : kItem, sources, build_options);
  cl_int code = CL_SUCCESS;
  KernelHandle handle(clCreateKernel(program, name, &code));
  check(code, name);
  return {std::move(handle), name};
}

void Device::set_raw_argument(const Kernel& kernel, cl_uint slot, std::size_t bytes, const void* value) {
  const cl_int code = clSetKernelArg(kernel.handle.get(), slot, bytes, value);
  if (code != CL_SUCCESS) check(code, fmt::format("clSetKernelArg({}, {})", kernel.name, slot).c_str());
}

void Device::set_buffer_argument(const Kernel& kernel, cl_uint slot, const Buffer& buffer) {
  if (!driven_) return set_raw_argument(kernel, slot, sizeof buffer.memory, &buffer.memory);
  const cl_int code = clSetKernelArgSVMPointer(kernel.handle.get(), slot, buffer.host);
  if (code != CL_SUCCESS) check(code, fmt::format("clSetKernelArgSVMPointer({}, {})", kernel.name, slot).c_str());
}

void Device::enqueue(const Kernel& kernel, std::size_t items, std::size_t local) {
  if (driven_) return drive(kernel, (items + local - 1) / local, local);
  const std::size_t global = (items + local - 1) / local * local;
  const auto begin = std::chrono::steady_clock::now();
  const cl_int code = clEnqueueNDRangeKernel(queue_.get(), kernel.handle.get(), 1, nullptr, &global, &local, 0, nullptr,
                                             event_slot("kernel", kernel.name));
  if (code != CL_SUCCESS) {
    if (profile_) pending_.pop_back();
    check(code, fmt::format("clEnqueueNDRangeKernel({})", kernel.name).c_str());
  }
  if (profile_ && trace::enabled()) trace::add("launch", kernel.name, begin, std::chrono::steady_clock::now());
}

double Device::run_groups(const Kernel& kernel, std::size_t first_item, std::size_t groups, std::size_t local) {
  Queue& queue = thread_queue_.local();
  if (!queue.get()) {
    cl_int code = CL_SUCCESS;
    queue = Queue(clCreateCommandQueue(context_, id_, 0, &code));
    check(code, "clCreateCommandQueue");
  }
  const auto begin = std::chrono::steady_clock::now();
  const std::size_t offset = kFirstItem + first_item, global = groups * local;
  const cl_int code =
      clEnqueueNDRangeKernel(queue.get(), kernel.handle.get(), 1, &offset, &global, &local, 0, nullptr, nullptr);
  if (code != CL_SUCCESS) check(code, fmt::format("clEnqueueNDRangeKernel({})", kernel.name).c_str());
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void Device::drive(const Kernel& kernel, std::size_t groups, std::size_t local) {
  const auto begin = std::chrono::steady_clock::now();
  if (std::exchange(kernel.loaded_for, local) != local) run_groups(kernel, kFarItem, kMostGroups, local);
  const std::size_t threads = host_threads();
  const std::size_t least = (groups + kMostGroups - 1) / kMostGroups;
  const std::size_t most = threads == 1 ? least : std::max(least, std::min(groups, kPartsAThread * threads));
  const double wanted = static_cast<double>(groups) * kernel.group_seconds / kPartSeconds;
  const std::size_t parts =
      kernel.group_seconds > 0.0 ? std::clamp(static_cast<std::size_t>(std::min(wanted, 1e9)), least, most) : most;
  double seconds = 0.0;  // of the first part
  const auto run = [&](std::size_t part) {
    const std::size_t first = groups * part / parts, last = groups * (part + 1) / parts;
    const double took = run_groups(kernel, first * local, last - first, local);
    if (part == 0) seconds = took;
  };
  if (threads == 1 || parts == 1) {
    for (std::size_t part = 0; part < parts; ++part) run(part);
  } else {
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(std::size_t{0}, parts, run, tbb::simple_partitioner()); });
  }
  // Slow to fall: a kernel that has nothing to do for once will have again.
  const double now = seconds / static_cast<double>(groups / parts);
  kernel.group_seconds = std::max(now, 0.75 * kernel.group_seconds + 0.25 * now);
  if (profile_ && trace::enabled()) trace::add("kernel", kernel.name, begin, std::chrono::steady_clock::now());
}

void Device::copy(const char* name, void* to, const void* from, std::size_t bytes) {
  constexpr std::size_t kPart = std::size_t{1} << 18;
  const auto begin = std::chrono::steady_clock::now();
  tbb::parallel_for(std::size_t{0}, (bytes + kPart - 1) / kPart, [&](std::size_t i) {
    std::memcpy(static_cast<std::byte*>(to) + i * kPart, static_cast<const std::byte*>(from) + i * kPart,
                std::min(kPart, bytes - i * kPart));
  });
  if (profile_ && trace::enabled()) trace::add("copy", name, begin, std::chrono::steady_clock::now());
}

Block Device::acquire(std::size_t bytes) {
  bytes = size_class(bytes);
  if (const auto it = free_.find(bytes); it != free_.end()) {
    Block block = std::move(it->second);
    free_.erase(it);
    return block;
  }
  Block block;
  block.bytes = bytes;
  cl_mem_flags flags = CL_MEM_READ_WRITE;
  if (info_.cpu) {
    block.host = {static_cast<std::byte*>(::operator new[](bytes, std::align_val_t(kPage))),
                  [](std::byte* p) { ::operator delete[](p, std::align_val_t(kPage)); }};
    flags |= CL_MEM_USE_HOST_PTR;
  }
  if (!driven_) {
    cl_int code = CL_SUCCESS;
    block.memory = Memory(clCreateBuffer(context_, flags, bytes, block.host.get(), &code));
    if (code != CL_SUCCESS) check(code, fmt::format("clCreateBuffer({} bytes)", bytes).c_str());
  }
  pooled_bytes_ += bytes;
  return block;
}

void Device::release(Block block) {
  if (block.bytes > kMostKept) {
    finish();
    pooled_bytes_ -= block.bytes;
    block.memory = Memory();  // before what it lies on
    return;
  }
  free_.emplace(block.bytes, std::move(block));
}

void Device::finish() {
  if (!busy_) return;
  busy_ = false;
  check(clFinish(queue_.get()), "clFinish");
  collect_events();
}

void* Device::map(const Buffer& buffer, Access access, std::size_t bytes) {
  if (driven_) return buffer.host;
  cl_int code = CL_SUCCESS;
  void* mapped = clEnqueueMapBuffer(queue_.get(), buffer.memory, CL_FALSE, map_flags(access), 0, bytes, 0, nullptr,
                                    event_slot("copy", "map"), &code);
  check(code, "clEnqueueMapBuffer");
  return mapped;
}

void Device::unmap(const Buffer& buffer, void* mapped) {
  if (driven_) return;
  check(clEnqueueUnmapMemObject(queue_.get(), buffer.memory, mapped, 0, nullptr, event_slot("copy", "unmap")),
        "clEnqueueUnmapMemObject");
}

void Device::read(const Buffer& buffer, void* to, std::size_t bytes) {
  if (driven_) return copy("read", to, buffer.host, bytes);
  check(
      clEnqueueReadBuffer(queue_.get(), buffer.memory, CL_FALSE, 0, bytes, to, 0, nullptr, event_slot("copy", "read")),
      "clEnqueueReadBuffer");
}

void Device::write(const Buffer& buffer, const void* from, std::size_t bytes) {
  if (driven_) return copy("write", buffer.host, from, bytes);
  check(clEnqueueWriteBuffer(queue_.get(), buffer.memory, CL_FALSE, 0, bytes, from, 0, nullptr,
                             event_slot("copy", "write")),
        "clEnqueueWriteBuffer");
}

void Device::clear(const Buffer& buffer, std::size_t bytes) {
  if (driven_) {
    std::memset(buffer.host, 0, bytes);
    return;
  }
  const cl_uint zero = 0;
  check(clEnqueueFillBuffer(queue_.get(), buffer.memory, &zero, sizeof zero, 0, bytes, 0, nullptr,
                            event_slot("copy", "fill")),
        "clEnqueueFillBuffer");
}

Memory Device::wrap(void* host, std::size_t bytes) {
  cl_int code = CL_SUCCESS;
  Memory memory(clCreateBuffer(context_, CL_MEM_READ_WRITE | CL_MEM_USE_HOST_PTR, bytes, host, &code));
  check(code, "clCreateBuffer(USE_HOST_PTR)");
  return memory;
}

cl_event* Device::event_slot(const char* track, const std::string& name) {
  if (profile_ && pending_.size() >= kMostPending) finish();
  busy_ = true;
  if (!profile_) return nullptr;
  pending_.push_back({track, name, nullptr});
  return &pending_.back().event;
}

void Device::collect_events() {
  for (const Pending& p : pending_) {
    cl_ulong begin = 0, end = 0;
    if (trace::enabled() && p.event &&
        clGetEventProfilingInfo(p.event, CL_PROFILING_COMMAND_START, sizeof begin, &begin, nullptr) == CL_SUCCESS &&
        clGetEventProfilingInfo(p.event, CL_PROFILING_COMMAND_END, sizeof end, &end, nullptr) == CL_SUCCESS) {
      const auto host_time = [&](cl_ulong t) {
        return host_zero_ +
               std::chrono::nanoseconds(static_cast<std::int64_t>(t) - static_cast<std::int64_t>(device_zero_));
      };
      trace::add(p.track, p.name, host_time(begin), host_time(end));
    }
    if (p.event) clReleaseEvent(p.event);
  }
  pending_.clear();
}

Borrowed::Borrowed(Device& device, void* data, std::size_t bytes, Access access)
    : device_(&device), data_(data), bytes_(bytes), access_(access) {
  if (bytes == 0 || device.driven()) return;
  if (device.info().cpu) {
    wrapped_ = device.wrap(data, bytes);
    return;
  }
  block_ = device.acquire(bytes);
  if (access != Access::write) device.write(memory(), data, bytes);
}

Borrowed::~Borrowed() {
  if (block_.bytes > 0) device_->release(std::move(block_));
}

void Borrowed::collect() {
  if (bytes_ == 0 || access_ == Access::read || device_->driven()) return;
  if (wrapped_.get())
    device_->unmap(memory(), device_->map(memory(), Access::read, bytes_));
  else
    device_->read(memory(), data_, bytes_);
}

}  // namespace isoskin::opencl

namespace isoskin {

std::vector<DeviceInfo> list_devices() {
  std::vector<DeviceInfo> list;
  for (opencl::Found& found : opencl::find_devices()) list.push_back(std::move(found.info));
  return list;
}

bool kernels_are_compiled(const OpenClOptions& options) {
  const std::filesystem::path note = opencl::note_of(opencl::choose_device(options.device).info);
  std::error_code ignored;
  return note.empty() || std::filesystem::exists(note, ignored);
}

void note_compiled_kernels(const OpenClOptions& options) {
  const std::filesystem::path note = opencl::note_of(opencl::choose_device(options.device).info);
  if (!note.empty()) std::ofstream{note};
}

}  // namespace isoskin
