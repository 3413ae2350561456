#include "core/sampling/marching_cubes.h"

#include <benchmark/benchmark.h>

#include "core/io/sequence.h"

using namespace isoskin;

namespace {

struct Fluid {
  std::shared_ptr<const GridField> field = load_grid(ISOSKIN_TEST_DATA "/dam_break/dam_break.0050.vdb", {});
  std::unique_ptr<Backend> backend = make_reference_backend();
  BrickLattice lattice = sample_lattice(*field, *backend, field->resolution() / 2);
  LatticeTopology topology = lattice_topology(lattice);
};

const Fluid& fluid() {
  static const Fluid frame;
  return frame;
}

void sample(benchmark::State& state) {
  const Fluid& f = fluid();
  const double spacing = f.field->resolution() / static_cast<double>(state.range(0));
  std::size_t bricks = 0;
  for (auto _ : state) bricks = sample_lattice(*f.field, *f.backend, spacing).brick_count();
  state.counters["bricks"] = static_cast<double>(bricks);
}

void topology(benchmark::State& state) {
  const Fluid& f = fluid();
  for (auto _ : state) benchmark::DoNotOptimize(lattice_topology(f.lattice).piece_count());
  state.counters["crossings"] = static_cast<double>(f.topology.crossing_count);
}

void triangulate(benchmark::State& state) {
  const Fluid& f = fluid();
  std::size_t triangles = 0;
  for (auto _ : state) triangles = marching_cubes(f.lattice, f.topology).triangle_count();
  state.counters["triangles"] = static_cast<double>(triangles);
}

}  // namespace

BENCHMARK(sample)->Arg(1)->Arg(2)->Arg(4)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(topology)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(triangulate)->UseRealTime()->Unit(benchmark::kMillisecond);
