#include "core/refine/refine.h"

#include <benchmark/benchmark.h>

#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

using namespace isoskin;

// Refinement on a field that costs next to nothing: what remains is the host's part.
static void refine_torus(benchmark::State& state) {
  const TriangleMesh mesh = test_meshes::torus(320, 160);
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(std::make_shared<analytic::TorusField>(1.0, 0.4));
  RefineOptions options;
  options.angle = float(state.range(0)) / 10.0f;
  const ProjectOptions project{1e-6f, 0.05f, 16, 24};
  RefineReport report;
  for (auto _ : state) benchmark::DoNotOptimize(refine(mesh, *backend, options, project, &report));
  state.counters["mechanical"] = double(mesh.triangle_count());
  state.counters["geometric"] = double(report.triangles);
  state.counters["passes"] = report.passes;
}
BENCHMARK(refine_torus)
    ->ArgName("tenths_of_a_degree")
    ->Arg(100)
    ->Arg(20)
    ->Arg(10)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
