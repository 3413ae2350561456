// The skin's stiffness product and one CG iteration on a million triangles: OpenCL kernels beside the same loops in C++
// with oneTBB, float32. Also how much of a whole relaxation is launches and copies.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>

#include "core/field/skeleton_field.h"
#include "core/trace.h"
#include "kernels/cg.h"
#include "kernels/element.h"
#include "perf/side_by_side.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

constexpr float kOverSqrt3 = 0.57735027f;

/// Vertices in the order of the torus' rows: neighbours are near in memory.
const TriangleMesh& million() {
  static const TriangleMesh mesh = test_meshes::torus(1000, 500);
  return mesh;
}

RelaxOptions options_of(const TriangleMesh& mesh) {
  RelaxOptions options;
  options.edge_length = float(shape_statistics(mesh).mean_edge);
  options.cg_tolerance = 0.0f;
  return options;
}

/// The device's skin, frozen at the mesh's positions.
struct DeviceSkin {
  opencl::Device device{OpenClOptions{}};
  opencl::ResidentMesh mesh{device};
  opencl::Array<Vec3> normals{device};
  opencl::Array<std::uint8_t> inverted{device};
  opencl::Elements elements{device};
  opencl::ConjugateGradients cg{device};

  explicit DeviceSkin(const TriangleMesh& host) {
    mesh.set(host);
    normals.assign(std::vector<Vec3>(host.vertex_count(), Vec3(0)));
    inverted.assign(std::vector<std::uint8_t>(host.triangle_count(), 0));
    elements.forces(mesh, normals, inverted, options_of(host));
  }
};

struct Frame {
  Vec3 x;
  float unused0;
  Vec3 y;
  float unused1;
};

/// The same loops over arrays of the same layout.
struct HostSkin {
  const TriangleMesh& mesh;
  VertexCorners corners;
  std::vector<Frame> frames;
  std::vector<Vec3> slots, normals, x, r, p, q;
  std::vector<float> partial;
  float stiffness, poisson = 0.3f, dt = 0.04f;
  static constexpr std::size_t kShare = 1024;

  explicit HostSkin(const TriangleMesh& host) : mesh(host), corners(vertex_corners(host)) {
    const std::size_t n = host.vertex_count();
    frames.assign(host.triangle_count(), {Vec3(1, 0, 0), 0, Vec3(0, 1, 0), 0});
    slots.resize(3 * host.triangle_count());
    for (auto* v : {&x, &r, &p, &q}) v->assign((n + kShare - 1) / kShare * kShare, Vec3(0.01f));
    normals.assign(n, Vec3(0));
    partial.resize((n + kShare - 1) / kShare);
    stiffness = float(0.25 * kSqrt3 * 1000.0 / (1.0 - 0.09));
  }

  void product_of(std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const Index* v = &mesh.vertex[3 * t];
      const Vec3 d0 = p[v[0]], d1 = p[v[1]] - d0, d2 = p[v[2]] - d0;
      const Frame& f = frames[t];
      const Vec3 c1 = (2.0f * d2 - d1) * kOverSqrt3;
      const float xx = glm::dot(f.x, d1), yy = glm::dot(f.y, c1), xy = 0.5f * (glm::dot(f.x, c1) + glm::dot(f.y, d1));
      const float sxx = stiffness * (xx + poisson * yy), syy = stiffness * (yy + poisson * xx),
                  sxy = stiffness * (1.0f - poisson) * xy;
      const Vec3 column0 = sxx * f.x + sxy * f.y, column1 = sxy * f.x + syy * f.y;
      const Vec3 at1 = column0 - column1 * kOverSqrt3, at2 = column1 * (2.0f * kOverSqrt3);
      slots[3 * t] = -(at1 + at2);
      slots[3 * t + 1] = at1;
      slots[3 * t + 2] = at2;
    }
  }

  void product() {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, mesh.triangle_count(), 1024),
                      [&](const auto& range) { product_of(range.begin(), range.end()); });
  }

  template <class Body>
  void for_each_share(const Body& body) {
    tbb::parallel_for(std::size_t{0}, partial.size(), body);
  }

  float gather_share(std::size_t begin, std::size_t end) {
    float sum = 0;
    for (std::size_t v = begin; v < end; ++v) {
      Vec3 a(0);
      for (Index i = corners.first[v]; i < corners.first[v + 1]; ++i) a += slots[corners.corner[i]];
      a = p[v] + dt * a;
      a -= glm::dot(normals[v], a) * normals[v];
      q[v] = a;
      sum += glm::dot(p[v], a);
    }
    return sum;
  }

  static float advance_share(float* x, float* r, const float* p, const float* q, float alpha) {
    float lane[16] = {};
    for (std::size_t i = 0; i < 3 * kShare; i += 16)
      for (std::size_t k = 0; k < 16; ++k) {
        x[i + k] += alpha * p[i + k];
        r[i + k] -= alpha * q[i + k];
        lane[k] += r[i + k] * r[i + k];
      }
    float sum = 0;
    for (const float l : lane) sum += l;
    return sum;
  }

  static void turn_share(float* p, const float* r, float beta) {
    for (std::size_t i = 0; i < 3 * kShare; ++i) p[i] = r[i] + beta * p[i];
  }

  float total() const {
    double sum = 0;
    for (const float s : partial) sum += s;
    return float(sum);
  }

  void iterate() {
    product();
    for_each_share(
        [&](std::size_t s) { partial[s] = gather_share(s * kShare, std::min(mesh.vertex_count(), (s + 1) * kShare)); });
    const float alpha = 1e-3f * total();
    for_each_share([&](std::size_t s) {
      const std::size_t at = s * kShare;
      partial[s] = advance_share(&x[at].x, &r[at].x, &p[at].x, &q[at].x, alpha);
    });
    const float beta = 1e-9f * total();
    for_each_share([&](std::size_t s) { turn_share(&p[s * kShare].x, &r[s * kShare].x, beta); });
  }
};

/// Of stiffness products and of the rest of CG iterations. Written lines are not counted as read first.
perf::Work work_of(double products, double iterations) {
  const double triangles = double(million().triangle_count()), vertices = double(million().vertex_count());
  constexpr double kSlots = 36, kFrame = 32, kCorners = 12, kVector = 12;  // bytes
  const double product = triangles * (kFrame + kCorners + kSlots) + vertices * kVector;
  const double gather = triangles * (kSlots + kCorners) + vertices * (4 + 3 * kVector);  // p, normal; q
  const double advance_and_turn = vertices * (6 + 3) * kVector;                          // x r p q; x r. r p; p
  return {products * product + iterations * (gather + advance_and_turn),
          products * triangles * 85 + iterations * vertices * 60};
}

void BM_stiffness_product(benchmark::State& state) {
  const RelaxOptions options = options_of(million());
  DeviceSkin skin(million());
  HostSkin host(million());
  opencl::Array<float> d(skin.device);
  d.assign(std::vector<float>(3 * million().vertex_count(), 0.01f));
  opencl::Array<int> done(skin.device);
  done.assign(std::vector<int>{0});
  perf::side_by_side(
      state, work_of(1, 0),
      [&] {
        skin.elements.product(skin.mesh, d, done, options);
        skin.device.finish();
      },
      [&] { host.product(); });
}

/// Forces and ten iterations.
void BM_cg_iterations(benchmark::State& state) {
  RelaxOptions options = options_of(million());
  options.cg_iterations = 10;
  DeviceSkin skin(million());
  HostSkin host(million());
  perf::side_by_side(
      state, work_of(options.cg_iterations + 1, options.cg_iterations),
      [&] {
        skin.elements.forces(skin.mesh, skin.normals, skin.inverted, options);
        skin.cg.solve(skin.mesh, skin.normals, skin.elements, options);
        skin.device.finish();
      },
      [&] {
        host.product();
        for (int i = 0; i < options.cg_iterations; ++i) host.iterate();
      });
}

/// Two steps of ten iterations on 100 thousand triangles; launch_share and copy_share are parts of the wall time.
void BM_relax(benchmark::State& state) {
  const TriangleMesh mesh = test_meshes::torus(320, 160);
  RelaxOptions relax = options_of(mesh);
  relax.cg_iterations = 10;
  ProjectOptions project;
  project.tolerance = 1e-4f * relax.edge_length;
  project.max_step = 0.5f * relax.edge_length;
  std::vector<SkeletonElement> ring(24);
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const double u = 6.283185307179586 * double(i) / double(ring.size());
    ring[i].a = ring[i].b = DVec3(std::cos(u), std::sin(u), 0);
    ring[i].radius = 0.9;
  }
  const auto backend = make_opencl_backend({.trace = true});
  backend->set_field(std::make_shared<SkeletonField>(ring, 1.0));
  backend->set_mesh(mesh);
  backend->relax(relax, project);
  trace::enable(true);
  const double launch = trace::total_seconds("launch"), copy = trace::total_seconds("copy");
  const double kernel = trace::total_seconds("kernel"), host = trace::total_seconds("host");
  for (auto _ : state) backend->relax(relax, project);
  const double wall = trace::total_seconds("host") - host;
  state.counters["launch_share"] = (trace::total_seconds("launch") - launch) / wall;
  state.counters["copy_share"] = (trace::total_seconds("copy") - copy) / wall;
  state.counters["kernel_share"] = (trace::total_seconds("kernel") - kernel) / wall;
  trace::enable(false);
}

}  // namespace

BENCHMARK(BM_stiffness_product)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_cg_iterations)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_relax)->UseRealTime()->Unit(benchmark::kMillisecond);
