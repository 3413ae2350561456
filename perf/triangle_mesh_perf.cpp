#include "core/mesh/triangle_mesh.h"

#include <benchmark/benchmark.h>

#include "core/mesh/validate.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

/// One million triangles in the order a tracker keeps them.
const TriangleMesh& million() {
  static const TriangleMesh mesh = [] {
    TriangleMesh m = test_meshes::torus(1000, 500);
    reorder(m);
    return m;
  }();
  return mesh;
}

void link(benchmark::State& state) {
  TriangleMesh mesh = million();
  for (auto _ : state) link_twins(mesh);
}
void corners(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(vertex_corners(million()));
}
void pieces(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(mesh_pieces(million()));
}
void renumber(benchmark::State& state) {
  TriangleMesh mesh = million();
  for (auto _ : state) reorder(mesh);
}
void shape(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(shape_statistics(million()));
}
void check(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(validate(million()));
}

BENCHMARK(link)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(corners)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(pieces)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(renumber)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(shape)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(check)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
