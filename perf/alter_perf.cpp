#include "core/mechanics/alter.h"

#include <benchmark/benchmark.h>

#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

/// About 1.3 million near-equilateral triangles in the order a tracker keeps them; mean edge length in `edge`.
const TriangleMesh& fine_sphere(float& edge) {
  static const TriangleMesh mesh = [] {
    TriangleMesh m = test_meshes::icosphere(8);
    reorder(m);
    return m;
  }();
  static const float mean = float(shape_statistics(mesh).mean_edge);
  edge = mean;
  return mesh;
}

AlterOptions options_for(float edge) {
  AlterOptions options;
  options.edge_length = edge;
  options.respect_locks = false;
  return options;
}

void run(benchmark::State& state, const TriangleMesh& start, float edge) {
  AlterReport report;
  for (auto _ : state) {
    state.PauseTiming();
    TriangleMesh mesh = start;
    state.ResumeTiming();
    report = alter(mesh, options_for(edge));
  }
  state.counters["triangles"] = double(start.triangle_count());
  state.counters["splits"] = double(report.splits);
  state.counters["collapses"] = double(report.collapses);
  state.counters["flips"] = double(report.flips);
}

void nothing_to_do(benchmark::State& state) {
  float edge = 0;
  const TriangleMesh& mesh = fine_sphere(edge);
  run(state, mesh, edge);
}

/// What a frame of ordinary motion leaves: a few edges in a hundred are out of range.
void ordinary_frame(benchmark::State& state) {
  float edge = 0;
  TriangleMesh mesh = fine_sphere(edge);
  test_meshes::jitter(mesh, 0.3f * edge, 1);
  run(state, mesh, edge);
}

/// A freshly extracted surface: edges a third of the wanted length.
void far_too_fine(benchmark::State& state) {
  float edge = 0;
  TriangleMesh mesh = fine_sphere(edge);
  test_meshes::jitter(mesh, 0.2f * edge, 1);
  run(state, mesh, 3 * edge);
}

void too_coarse(benchmark::State& state) {
  TriangleMesh mesh = test_meshes::icosphere(6);
  run(state, mesh, float(shape_statistics(mesh).mean_edge / 3));
}

BENCHMARK(nothing_to_do)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(ordinary_frame)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(far_too_fine)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(too_coarse)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
