// The OpenCL layer: listing, errors, the buffer pool, and that results depend neither on the work-group size, nor on
// the number of threads, nor on whose they are. Some cases run this program again in another environment, as a
// DISABLED_ test that prints.
#include "kernels/device.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "core/field/skeleton_field.h"
#include "core/trace.h"
#include "kernels/device_field.h"
#include "kernels/evaluate.h"
#include "kernels/relax.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using testing::HasSubstr;

namespace {

std::shared_ptr<const SkeletonField> blob() {
  std::vector<SkeletonElement> elements(12);
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const double u = double(i);
    elements[i].a = 0.6 * DVec3(std::sin(u), std::cos(2 * u), std::sin(3 * u));
    elements[i].b = elements[i].a + 0.1 * double(i % 2) * DVec3(1, 1, 0);
    elements[i].potential = i % 3 ? Potential::metaball : Potential::cauchy;
    elements[i].radius = i % 3 ? 0.9 : 0.1;
  }
  return std::make_shared<SkeletonField>(elements, 0.8);
}

/// FNV-1a.
void digest(std::uint64_t& hash, const void* data, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) hash = (hash ^ static_cast<const unsigned char*>(data)[i]) * 0x100000001b3u;
}

struct Everything {
  std::vector<float> values;
  std::vector<Vec3> gradients, positions;
  RelaxReport report;

  std::uint64_t bits() const {
    std::uint64_t hash = 0xcbf29ce484222325u;
    digest(hash, values.data(), values.size() * sizeof(float));
    digest(hash, gradients.data(), gradients.size() * sizeof(Vec3));
    digest(hash, positions.data(), positions.size() * sizeof(Vec3));
    digest(hash, &report.residual, sizeof report.residual);
    digest(hash, &report.cg_iterations, sizeof report.cg_iterations);
    return hash;
  }
};

/// Field values and a relaxed mesh.
Everything run_everything(opencl::Device& device) {
  const auto field = opencl::make_skeleton_device_field(device);
  field->upload(*blob());
  opencl::Evaluator evaluator(device);
  opencl::Projector projector(device);
  opencl::Normals normals(device);
  opencl::Relaxer relaxer(device);
  opencl::ResidentMesh mesh(device);
  TriangleMesh host = test_meshes::icosphere(5);
  test_meshes::jitter(host, 0.02f, 3);
  mesh.set(host);

  Everything all;
  all.values.resize(host.vertex_count());
  all.gradients.resize(host.vertex_count());
  all.positions.resize(host.vertex_count());
  evaluator.evaluate(*field, host.vertices.position, all.values, all.gradients);
  RelaxOptions relax;
  relax.edge_length = 0.05f;
  relax.sharp = true;
  relax.cg_tolerance = 0.0f;
  relaxer.launch(*field, mesh, projector, normals, relax, ProjectOptions{5e-6f, 0.02f, 16, 24});
  all.report = relaxer.report();
  mesh.positions.read(all.positions);
  return all;
}

/// The default work-group size when `local` is 0.
std::uint64_t bits_of_everything(std::size_t local) {
  opencl::Device device{OpenClOptions{}};
  if (local) device.set_local_size(local);
  return run_everything(device).bits();
}

/// Output of `test` (a DISABLED_ one) of this program run again with `environment` set.
std::string run_again(const std::string& environment, const std::string& test) {
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  const std::string command =
      "env " + environment + " '" + self + "' --gtest_also_run_disabled_tests --gtest_filter='" + test + "' 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  std::string output;
  std::array<char, 4096> piece;
  while (const std::size_t n = fread(piece.data(), 1, piece.size(), pipe)) output.append(piece.data(), n);
  pclose(pipe);
  return output;
}

/// What follows `mark` on its line.
std::string after(const std::string& text, const std::string& mark) {
  const std::size_t at = text.find(mark);
  if (at == std::string::npos) return "(no '" + mark + "' in: " + text + ")";
  return text.substr(at + mark.size(), text.find('\n', at) - at - mark.size());
}

}  // namespace

TEST(Device, ListIsTheSameTwiceAndNumbered) {
  const std::vector<DeviceInfo> once = list_devices(), twice = list_devices();
  ASSERT_FALSE(once.empty());
  ASSERT_EQ(once.size(), twice.size());
  for (std::size_t i = 0; i < once.size(); ++i) {
    EXPECT_EQ(once[i].index, int(i));
    EXPECT_EQ(once[i].name, twice[i].name);
    EXPECT_FALSE(once[i].name.empty() || once[i].platform.empty() || once[i].version.empty());
    EXPECT_GT(once[i].compute_units, 0u);
    EXPECT_GT(once[i].global_bytes, 1u << 20);
  }
}

TEST(Device, UnknownIndexIsOneLine) {
  for (const int index : {99, -2}) {
    try {
      make_opencl_backend({.device = index});
      FAIL() << index;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("no such device; expected 0 to"));
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
}

TEST(Device, ABuildThatFailsShowsItsLog) {
  opencl::Device device{OpenClOptions{}};
  try {
    device.kernel({"kernel void broken(global int* a) { a[0] = no_such_thing; }"}, "-DFLAG=1", "broken");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("clBuildProgram(-cl-std=CL1.2 -DFLAG=1): CL_BUILD_PROGRAM_FAILURE (-11)"));
    EXPECT_THAT(error.what(), HasSubstr("no_such_thing"));
  }
}

TEST(Device, ErrorsNameTheCall) {
  opencl::Device device{OpenClOptions{}};
  const opencl::Kernel kernel = device.kernel({"kernel void one(int a) {}"}, "", "one");
  try {
    device.launch(kernel, 1, 1.0);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("clSetKernelArg(one, 0): CL_INVALID_ARG_SIZE"));
  }
  EXPECT_THROW(device.kernel({"kernel void one(int a) {}"}, "", "two"), std::runtime_error);
}

TEST(Device, PoolGivesBlocksAgain) {
  opencl::Device device{OpenClOptions{}};
  const auto use = [&](std::size_t n) {
    opencl::Array<float> array(device);
    array.assign(std::vector<float>(n, 1.0f));
  };
  use(100000);
  const std::size_t bytes = device.pooled_bytes();
  for (const std::size_t n : {99000u, 100000u, 98765u}) use(n);
  EXPECT_EQ(device.pooled_bytes(), bytes);
  use(1000000);
  EXPECT_GT(device.pooled_bytes(), bytes);
}

TEST(Device, ArraysHoldWhatIsWrittenAtEverySize) {
  opencl::Device device{OpenClOptions{}};
  opencl::Array<int> array(device);
  for (const int n : {0, 1, 7, 93, 4096, 100003}) {
    std::vector<int> data(n), back(n);
    for (int i = 0; i < n; ++i) data[i] = 3 * i + n;
    array.assign(data);
    array.read(back);
    EXPECT_EQ(back, data);
    for (int& i : opencl::View<int>(array, opencl::Access::read_write).span()) ++i;
    for (int& i : data) ++i;
    const opencl::View<int> view(array, opencl::Access::read);
    EXPECT_TRUE(std::ranges::equal(const_cast<opencl::View<int>&>(view).span(), data));
  }
}

TEST(Device, BitsDoNotDependOnTheWorkGroupSize) {
  const std::uint64_t once = bits_of_everything(0);
  for (const std::size_t local : {16u, 256u}) EXPECT_EQ(bits_of_everything(local), once) << local;
}

TEST(Device, TheWayOfGpusGivesTheSame) {
  opencl::Device cpu{OpenClOptions{}}, gpu{OpenClOptions{}, true};
  ASSERT_EQ(gpu.vector_width(), 1);
  const Everything a = run_everything(cpu), b = run_everything(gpu);
  EXPECT_EQ(a.report.cg_iterations, b.report.cg_iterations);
  EXPECT_EQ(a.report.inverted, b.report.inverted);
  std::size_t apart = 0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    ASSERT_NEAR(a.values[i], b.values[i], 1e-5f);
    ASSERT_LE(glm::length(a.gradients[i] - b.gradients[i]), 1e-4f);
    apart += !(glm::length(a.positions[i] - b.positions[i]) <= 1e-4f);  // 0.2 % of an edge
  }
  // The sums of CG have another tree; where that decides whether a projection converges the vertex goes elsewhere.
  EXPECT_LE(apart, a.positions.size() / 100);
}

TEST(DISABLED_Child, OpensADevice) {
  try {
    printf("devices=%zu\n", list_devices().size());
    make_opencl_backend();
    printf("message=none\n");
  } catch (const InputError& error) {
    printf("message=%s\n", error.what());
  }
}

TEST(Device, BitsDoNotDependOnTheNumberOfThreads) {
  const auto bits = [](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return bits_of_everything(0);
  };
  EXPECT_EQ(bits(1), bits(4));
}

/// A device that runs kernels in its own time, or -1.
int queued_device() {
  for (const DeviceInfo& info : list_devices())
    if (!opencl::Device(OpenClOptions{info.index}).driven()) return info.index;
  return -1;
}

/// Values and gradients of a thousand points one after the other.
std::vector<float> samples(int device, bool trace) {
  const auto backend = make_opencl_backend({.device = device, .trace = trace});
  backend->set_field(blob());
  std::vector<Vec3> points, gradients(1000);
  for (int i = 0; i < 1000; ++i) points.push_back(Vec3(std::sin(i), std::cos(2 * i), std::sin(3 * i)));
  std::vector<float> values(points.size());
  backend->evaluate(points, values, gradients);
  for (const Vec3& g : gradients) values.insert(values.end(), {g.x, g.y, g.z});
  return values;
}

TEST(Device, HostThreadsAndPoclsGiveTheSameBits) {
  if (queued_device() < 0) GTEST_SKIP() << "this driver has one device only";
  ASSERT_TRUE(opencl::Device(OpenClOptions{}).driven());
  const std::vector<float> one = samples(-1, false), other = samples(queued_device(), false);
  EXPECT_EQ(std::memcmp(one.data(), other.data(), one.size() * sizeof(float)), 0);
}

TEST(Device, AThousandSmallLaunchesAndLargeOnesInTurns) {
  opencl::Device device{OpenClOptions{}};
  const opencl::Kernel kernel = device.kernel(
      {"kernel void add(global int* a, int by, uint n) { const uint i = ITEM; if (i < n) a[i] += by; }"}, "", "add");
  constexpr cl_uint kLarge = 300000;
  opencl::Array<int> array(device);
  array.assign(std::vector<int>(kLarge, 0));
  int sum = 0;
  for (int i = 0; i < 1000; ++i) {
    device.launch(kernel, i % 50 ? 7 : kLarge, array, i, i % 50 ? cl_uint{7} : kLarge);
    if (i % 50 == 0) sum += i;
  }
  std::vector<int> back(kLarge);
  array.read(back);
  for (cl_uint i = 0; i < kLarge; ++i) ASSERT_EQ(back[i], i < 7 ? 499500 : sum) << i;
}

TEST(Device, NoDriverIsOneClearLine) {
  const std::filesystem::path empty = std::filesystem::temp_directory_path() / "isoskin_no_vendors";
  std::filesystem::create_directories(empty);
  const std::string output = run_again("OCL_ICD_VENDORS='" + empty.string() + "/'", "DISABLED_Child.OpensADevice");
  std::filesystem::remove(empty);
  EXPECT_EQ(after(output, "devices="), "0");
  EXPECT_THAT(after(output, "message="), HasSubstr("no OpenCL device: expected a GPU driver or PoCL (install"));
}

TEST(Device, UnwritableCacheIsOneClearLine) {
  const std::string output = run_again("POCL_CACHE_DIR=/proc/isoskin/cache", "DISABLED_Child.OpensADevice");
  EXPECT_EQ(after(output, "devices="), "0");
  EXPECT_THAT(after(output, "message="),
              HasSubstr("no OpenCL device: the kernel cache folder /proc/isoskin/cache cannot be written"));
}

TEST(Device, TracingRecordsKernelsCopiesAndLaunches) {
  trace::enable(true);
  for (const int device : {-1, queued_device()}) {
    const double before = trace::total_seconds("kernel");
    const auto begin = std::chrono::steady_clock::now();
    samples(device, true);
    const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    EXPECT_GT(trace::total_seconds("kernel"), before) << device;
    EXPECT_LE(trace::total_seconds("kernel") - before, wall) << device;
    EXPECT_GT(trace::total_seconds("copy"), 0.0) << device;
  }
  EXPECT_GT(trace::total_seconds("launch"), 0.0);
  trace::enable(false);
  const auto path = std::filesystem::temp_directory_path() / "isoskin_device_trace.json";
  trace::write(path);
  std::filesystem::remove(path);
}
