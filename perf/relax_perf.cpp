#include "core/mechanics/relax.h"

#include <benchmark/benchmark.h>

#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

using namespace isoskin;

// Two quasi-static steps of the float64 definition, ten conjugate gradient iterations each.
static void relax_torus(benchmark::State& state, Mechanics mechanics) {
  TriangleMesh mesh = test_meshes::torus(320, 160);
  test_meshes::jitter(mesh, 0.005f, 1);
  const SkinTopology topology = skin_topology(mesh);
  const analytic::TorusField field(1.0, 0.4);
  RelaxOptions options;
  options.mechanics = mechanics;
  options.edge_length = float(shape_statistics(mesh).mean_edge);
  options.cg_tolerance = 0.0f;
  const ProjectOptions project{1e-6f, 0.01f, 16, 24};
  std::vector<ProjectStatus> status(mesh.vertex_count());
  for (auto _ : state) {
    std::vector<Vec3> positions = mesh.vertices.position;
    relax_skin(topology, field, options, project, positions, status);
    benchmark::DoNotOptimize(positions.data());
  }
  state.counters["triangles"] = double(mesh.triangle_count());
}
BENCHMARK_CAPTURE(relax_torus, fem, Mechanics::fem)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(relax_torus, springs, Mechanics::springs)->Unit(benchmark::kMillisecond)->UseRealTime();
