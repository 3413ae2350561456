// Self-intersections of a sphere and a torus through it, 25,600 to 1,640,000 triangles: time, grid entries and
// candidate pairs grow with the triangles.
#include "core/topology/triangle_pairs.h"

#include <benchmark/benchmark.h>

#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

TriangleMesh sphere_and_torus(int level) {
  TriangleMesh mesh = test_meshes::icosphere(level);
  append(mesh, test_meshes::torus(40 << (level - 4), 16 << (level - 4)));
  reorder(mesh);
  return mesh;
}

void self_intersections(benchmark::State& state) {
  const TriangleMesh mesh = sphere_and_torus(int(state.range(0)));
  const double triangles = double(mesh.triangle_count());
  PairStatistics statistics;
  std::size_t pairs = 0;
  for (auto _ : state) pairs = overlapping_pairs(mesh, &statistics).size();
  state.counters["triangles"] = triangles;
  state.counters["entries_per_triangle"] = double(statistics.entries) / triangles;
  state.counters["candidates_per_triangle"] = double(statistics.candidates) / triangles;
  state.counters["pairs"] = double(pairs);
  state.counters["time_per_triangle"] =
      benchmark::Counter(triangles, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

BENCHMARK(self_intersections)->DenseRange(5, 8)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
