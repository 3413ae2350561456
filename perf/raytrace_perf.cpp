#include "render/raytrace.h"

#include <benchmark/benchmark.h>

#include <cmath>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "render/rasterize.h"
#include "render/shade.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

// n metaballs on a sphere, overlapping a little.
SkeletonField balls(int n, Potential potential) {
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < n; ++i) {
    const double angle = 2.399963 * i, z = (2.0 * i + 1.0) / n - 1.0, r = std::sqrt(1.0 - z * z);
    const DVec3 a(r * std::cos(angle), r * std::sin(angle), z);
    elements.push_back({a, a, 3.2 / std::sqrt(n), 1.0, 2.0, potential});
  }
  return SkeletonField(elements, 0.3);
}

void report(benchmark::State& state, const RaytraceReport& report) {
  state.counters["boxes"] = static_cast<double>(report.boxes);
  state.counters["hits"] = static_cast<double>(report.hits);
  state.counters["build_ms"] = report.build_ms;
  state.counters["trace_ms"] = report.trace_ms;
}

void raytrace_skeleton(benchmark::State& state) {
  const SkeletonField field = balls(static_cast<int>(state.range(0)), static_cast<Potential>(state.range(1)));
  const Camera camera = frame_box(field.bounds(), 512, 512);
  RaytraceReport last;
  for (auto _ : state) last = raytrace(field, camera).report;
  report(state, last);
}
BENCHMARK(raytrace_skeleton)
    ->Args({7, static_cast<int>(Potential::metaball)})
    ->Args({60, static_cast<int>(Potential::metaball)})
    ->Args({60, static_cast<int>(Potential::blinn)})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

void raytrace_grid(benchmark::State& state) {
  // A bumpy ball of radius 0.4 * voxels in bricks of exact spline taps.
  auto grid = std::make_shared<BrickGrid>();
  const int blocks = static_cast<int>(state.range(0)) / BrickGrid::kBrick;
  const double radius = 0.4 * BrickGrid::kBrick * blocks, center = 0.5 * BrickGrid::kBrick * blocks;
  grid->table_size = IVec3(blocks);
  grid->outside = -1.0f;
  for (int b = 0; b < blocks * blocks * blocks; ++b) {
    const IVec3 brick(b / (blocks * blocks), b / blocks % blocks, b % blocks);
    grid->table.push_back(b);
    grid->brick_coordinate.push_back(brick);
    for (int t = 0; t < BrickGrid::kTapValues; ++t) {
      const IVec3 tap(t / (BrickGrid::kTaps * BrickGrid::kTaps), t / BrickGrid::kTaps % BrickGrid::kTaps,
                      t % BrickGrid::kTaps);
      const DVec3 p = DVec3(brick * BrickGrid::kBrick + tap - 1) - center;
      grid->tap.push_back(static_cast<float>(radius - glm::length(p) + std::sin(p.x) * std::sin(p.y) * std::sin(p.z)));
    }
  }
  const GridField field(grid);
  const Camera camera = frame_box(field.bounds(), 512, 512);
  RaytraceReport last;
  for (auto _ : state) last = raytrace(field, camera).report;
  report(state, last);
}
BENCHMARK(raytrace_grid)->Arg(64)->Arg(128)->Unit(benchmark::kMillisecond)->UseRealTime();

const TriangleMesh& torus() {
  static const TriangleMesh mesh = test_meshes::torus(1000, 500);
  return mesh;
}

void raytrace_mesh(benchmark::State& state) {
  const Camera camera = frame_box({DVec3(-1.4), DVec3(1.4)}, 1024, 1024);
  RaytraceReport last;
  for (auto _ : state) last = raytrace(torus(), {}, camera).report;
  report(state, last);
}
BENCHMARK(raytrace_mesh)->Unit(benchmark::kMillisecond)->UseRealTime();

void rasterize_mesh(benchmark::State& state) {
  const Camera camera = frame_box({DVec3(-1.4), DVec3(1.4)}, 1024, 1024);
  for (auto _ : state) benchmark::DoNotOptimize(rasterize(torus(), {}, camera));
}
BENCHMARK(rasterize_mesh)->Unit(benchmark::kMillisecond)->UseRealTime();

void shade_mesh(benchmark::State& state) {
  const Camera camera = frame_box({DVec3(-1.4), DVec3(1.4)}, 1024, 1024);
  Image image = rasterize(torus(), {}, camera);
  for (auto _ : state) shade(image, camera, {.pattern = Pattern::noise});
}
BENCHMARK(shade_mesh)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
