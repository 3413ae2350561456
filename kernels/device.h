// A thin RAII layer over the OpenCL C API: one device, its commands in order, a buffer pool, cached programs.
// Errors are std::runtime_error that name the call, and for builds carry the log.
#pragma once

#include <CL/cl.h>

#include <tbb/enumerable_thread_specific.h>

#include <chrono>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "kernels/opencl_backend.h"

namespace isoskin::opencl {

/// Throws std::runtime_error "<call>: <code's name> (<code>)" unless `code` is CL_SUCCESS.
void check(cl_int code, const char* call);

/// Owns one OpenCL handle.
template <class Handle, cl_int (*Release)(Handle)>
class Owned {
public:
  Owned() = default;
  explicit Owned(Handle handle) : handle_(handle) {}
  Owned(Owned&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Owned& operator=(Owned&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Owned() {
    if (handle_) Release(handle_);
  }
  Handle get() const { return handle_; }

private:
  Handle handle_ = nullptr;
};

using Queue = Owned<cl_command_queue, clReleaseCommandQueue>;
using Memory = Owned<cl_mem, clReleaseMemObject>;
using KernelHandle = Owned<cl_kernel, clReleaseKernel>;

/// A kernel with its own argument slots. Not shared between threads.
struct Kernel {
  KernelHandle handle;
  std::string name;
  // Where host threads run it: what a work-group took of late, and the group size it is loaded for.
  mutable double group_seconds = 0.0;
  mutable std::size_t loaded_for = 0;
};

/// Memory that kernels use: a buffer of OpenCL's, or the host's own where its threads drive the device.
struct Buffer {
  cl_mem memory = nullptr;
  void* host = nullptr;
};

/// One block of the pool: aligned host memory that the device shares (CPU) or device memory.
struct Block {
  Memory memory;
  std::unique_ptr<std::byte[], void (*)(std::byte*)> host{nullptr, nullptr};
  std::size_t bytes = 0;

  Buffer buffer() const { return {memory.get(), host.get()}; }
};

/// What a caller wants from host access to a buffer.
enum class Access { read, write, read_write };

/// Passed to launch() where a kernel takes an optional buffer.
struct NoBuffer {};

/// Commands run one after the other. PoCL's basic device runs a kernel in the thread that enqueues it; there oneTBB's
/// threads each enqueue a part of the work-groups and launch() returns when all have run: waking PoCL's own threads
/// takes longer than most kernels. Elsewhere launch() enqueues, and finish() waits.
class Device {
public:
  /// Throws InputError as promised by make_opencl_backend(). `like_gpu`: treats a CPU as a GPU (copies instead of
  /// maps, one point a work item), to test that path where there is none.
  explicit Device(const OpenClOptions& options, bool like_gpu = false);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const DeviceInfo& info() const { return info_; }
  /// True where host threads run the work-groups.
  bool driven() const { return driven_; }

  /// Points or elements one work item takes in packet kernels: 16 on CPUs (explicit SIMD), 1 on GPUs.
  int vector_width() const { return info_.cpu ? 16 : 1; }

  /// Work-group size of every launch; a power of two. Results do not depend on it.
  void set_local_size(std::size_t size) { local_size_ = packet_local_size_ = share_local_size_ = size; }

  /// A kernel of the program made of `sources` joined in order. The program is built once for each device and process.
  /// Throws std::runtime_error with the build log.
  Kernel kernel(const std::vector<const char*>& sources, const std::string& build_options, const char* name);

  /// Runs `kernel` over at least `items` work items (padded to whole work-groups: the kernel guards its tail).
  /// Does not wait. items == 0 launches nothing.
  template <class... Arguments>
  void launch(const Kernel& kernel, std::size_t items, const Arguments&... arguments) {
    launch_in_groups(local_size_, kernel, items, arguments...);
  }

  /// As launch(), for kernels whose items take `width` of `points` points each.
  template <class... Arguments>
  void launch_packets(const Kernel& kernel, int width, std::size_t points, const Arguments&... arguments) {
    launch_in_groups(width > 1 ? packet_local_size_ : local_size_, kernel, (points + width - 1) / width, arguments...);
  }

  /// As launch(), for kernels whose items are long loops: one item a group on CPUs, so that they spread over the cores.
  template <class... Arguments>
  void launch_shares(const Kernel& kernel, std::size_t items, const Arguments&... arguments) {
    launch_in_groups(share_local_size_, kernel, items, arguments...);
  }

  /// Sets argument `slot` and counts it up. Takes what has memory(), NoBuffer, numbers and structs of numbers, and
  /// anything with bind(device, kernel, slot), which sets as many arguments as it likes.
  template <class T>
  void set_argument(const Kernel& kernel, cl_uint& slot, const T& value) {
    if constexpr (requires { value.bind(*this, kernel, slot); }) {
      value.bind(*this, kernel, slot);
    } else if constexpr (std::is_same_v<T, NoBuffer>) {
      set_raw_argument(kernel, slot++, sizeof(cl_mem), nullptr);
    } else if constexpr (requires { value.memory(); }) {
      set_buffer_argument(kernel, slot++, value.memory());
    } else {
      static_assert(std::is_trivially_copyable_v<T> && !std::is_pointer_v<T>);
      set_raw_argument(kernel, slot++, sizeof value, &value);
    }
  }

  /// A block of at least `bytes`, from the pool where one fits; give it back with release(). Large blocks are not kept
  /// there: filling them takes far longer than having them from the system, and other steps need the memory.
  Block acquire(std::size_t bytes);
  void release(Block block);

  /// Waits for everything enqueued so far; then hands profiled times to the trace. Free when there is nothing.
  void finish();

  // These do not wait: what they read or write is to be left alone until finish(). On a CPU one wait takes as long as a
  // kernel over thousands of points, so whoever needs several results enqueues all of them first.
  void* map(const Buffer& buffer, Access access, std::size_t bytes);
  void unmap(const Buffer& buffer, void* mapped);
  void read(const Buffer& buffer, void* to, std::size_t bytes);
  void write(const Buffer& buffer, const void* from, std::size_t bytes);
  /// Sets the first `bytes` to zero; a multiple of 4.
  void clear(const Buffer& buffer, std::size_t bytes);
  /// A buffer over the caller's memory, without a copy. CPU devices that are not driven only.
  Memory wrap(void* host, std::size_t bytes);

  std::size_t pooled_bytes() const { return pooled_bytes_; }

private:
  struct Pending {
    const char* track;
    std::string name;
    cl_event event;
  };

  template <class... Arguments>
  void launch_in_groups(std::size_t local, const Kernel& kernel, std::size_t items, const Arguments&... arguments) {
    if (items == 0) return;
    cl_uint slot = 0;
    (set_argument(kernel, slot, arguments), ...);
    enqueue(kernel, items, local);
  }
  void set_raw_argument(const Kernel& kernel, cl_uint slot, std::size_t bytes, const void* value);
  void set_buffer_argument(const Kernel& kernel, cl_uint slot, const Buffer& buffer);
  void enqueue(const Kernel& kernel, std::size_t items, std::size_t local);
  void drive(const Kernel& kernel, std::size_t groups, std::size_t local);
  /// Runs so many groups from the given item on in the calling thread and returns how many seconds that took.
  double run_groups(const Kernel& kernel, std::size_t first_item, std::size_t groups, std::size_t local);
  void copy(const char* name, void* to, const void* from, std::size_t bytes);
  /// Of a command that is about to be enqueued.
  cl_event* event_slot(const char* track, const std::string& name);
  void collect_events();

  DeviceInfo info_;
  cl_device_id id_ = nullptr;
  cl_context context_ = nullptr;  // shared by all Devices of this process, never released
  Queue queue_;
  bool driven_ = false;
  tbb::enumerable_thread_specific<Queue> thread_queue_;  // of a driven device
  std::size_t local_size_ = 64;
  std::size_t packet_local_size_ = 64;
  std::size_t share_local_size_ = 64;
  std::multimap<std::size_t, Block> free_;
  std::size_t pooled_bytes_ = 0;
  bool busy_ = false;  // something was enqueued since the last finish()
  bool profile_ = false;
  std::vector<Pending> pending_;
  std::chrono::steady_clock::time_point host_zero_{};
  cl_ulong device_zero_ = 0;
};

/// Typed device memory from the pool; grows, never shrinks. Contents are lost when it grows.
template <class T>
class Array {
public:
  explicit Array(Device& device) : device_(&device) {}
  ~Array() {
    if (block_.bytes > 0) device_->release(std::move(block_));
  }
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;

  void resize(std::size_t n) {
    size_ = n;
    // Never an empty buffer, and room behind the end so that whole-packet reads stay inside.
    const std::size_t bytes = n * sizeof(T) + kSlack;
    if (bytes <= block_.bytes) return;
    if (block_.bytes > 0) device_->release(std::move(block_));
    block_ = device_->acquire(bytes);
  }
  /// Does not wait: `from` must stay as it is until Device::finish().
  void send(std::span<const T> from) {
    resize(from.size());
    if (!from.empty()) device_->write(memory(), from.data(), from.size_bytes());
  }
  void assign(std::span<const T> from) {
    send(from);
    device_->finish();
  }
  void clear() { device_->clear(memory(), (size_ * sizeof(T) + 3) / 4 * 4); }
  /// Does not wait: `to` is filled after Device::finish().
  void fetch(std::span<T> to) {
    if (!to.empty()) device_->read(memory(), to.data(), to.size_bytes());
  }
  void read(std::span<T> to) {
    fetch(to);
    device_->finish();
  }

  /// Gives its memory back; no command that uses it may be running.
  void let_go() {
    size_ = 0;
    if (block_.bytes > 0) device_->release(std::move(block_));
    block_ = {};
  }

  std::size_t size() const { return size_; }
  Buffer memory() const { return block_.buffer(); }
  Device& device() const { return *device_; }

private:
  static constexpr std::size_t kSlack = 256;
  Device* device_;
  Block block_;
  std::size_t size_ = 0;
};

/// Host access to an Array: mapped on CPU devices, copied on GPUs. span() waits for the kernels before.
template <class T>
class View {
public:
  View(Array<T>& array, Access access) : array_(&array), access_(access) {
    if (array.size() == 0) return;
    if (array.device().info().cpu) {
      mapped_ = static_cast<T*>(array.device().map(array.memory(), access, array.size() * sizeof(T)));
    } else {
      copy_.resize(array.size());
      if (access != Access::write) array.fetch(copy_);
    }
  }
  ~View() {
    Device& device = array_->device();
    if (mapped_) {
      device.unmap(array_->memory(), mapped_);
    } else if (!copy_.empty()) {
      if (access_ != Access::read) device.write(array_->memory(), copy_.data(), copy_.size() * sizeof(T));
      device.finish();
    }
  }
  View(const View&) = delete;
  View& operator=(const View&) = delete;

  std::span<T> span() {
    array_->device().finish();
    return mapped_ ? std::span<T>(mapped_, array_->size()) : std::span<T>(copy_);
  }

private:
  Array<T>* array_;
  Access access_;
  T* mapped_ = nullptr;
  std::vector<T> copy_;
};

/// The caller's memory as a kernel argument for as long as it is left alone: shared with a CPU device, copied to a GPU.
/// Kernels must not touch anything behind the end. After collect() and Device::finish() the caller sees what kernels
/// wrote; not to be destroyed before that.
class Borrowed {
public:
  Borrowed(Device& device, void* data, std::size_t bytes, Access access);
  Borrowed(Device& device, const void* data, std::size_t bytes)
      : Borrowed(device, const_cast<void*>(data), bytes, Access::read) {}
  ~Borrowed();
  Borrowed(const Borrowed&) = delete;
  Borrowed& operator=(const Borrowed&) = delete;

  Buffer memory() const { return block_.bytes > 0 ? block_.buffer() : Buffer{wrapped_.get(), data_}; }
  void collect();

private:
  Device* device_;
  void* data_;
  std::size_t bytes_;
  Access access_;
  Memory wrapped_;
  Block block_;
};

}  // namespace isoskin::opencl
