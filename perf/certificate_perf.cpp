#include "core/topology/certificate.h"

#include <benchmark/benchmark.h>

#include "core/io/sequence.h"
#include "core/topology/repair.h"

using namespace isoskin;

namespace {

/// A frame of a fluid, its lattice at half voxels and its mechanical mesh at one and a half.
struct Fluid {
  std::shared_ptr<const GridField> field = load_grid(ISOSKIN_TEST_DATA "/dam_break/dam_break.0050.vdb", {});
  std::unique_ptr<Backend> backend = make_reference_backend();
  double h = field->resolution();
  BrickLattice lattice = sample_lattice(*field, *backend, 0.5 * h);
  LatticeTopology topology = lattice_topology(lattice);
  TriangleMesh mesh;

  Fluid() {
    backend->set_field(field);
    extract(mesh);
  }
  RepairReport extract(TriangleMesh& to) const {
    AlterOptions alter;
    RelaxOptions relax;
    ProjectOptions project;
    alter.edge_length = relax.edge_length = float(1.5 * h);
    project.tolerance = float(1.5e-4 * h);
    project.max_step = float(0.75 * h);
    Certificate nothing;
    nothing.lattice_piece.assign(topology.piece_count(), Fault::missing);
    return reextract(to, mesh_pieces(to), nothing, lattice, topology, *backend, alter, relax, project);
  }
};

const Fluid& fluid() {
  static const Fluid frame;
  return frame;
}

void certificate(benchmark::State& state) {
  const Fluid& f = fluid();
  const MeshPieces pieces = mesh_pieces(f.mesh);
  const CertifyOptions options{.tolerance = f.h, .least_piece = 27.0 * f.h * f.h * f.h};
  for (auto _ : state) {
    const Certificate c = certify(f.mesh, pieces, *f.field, f.lattice, f.topology, options);
    if (!c.passed) state.SkipWithError(c.summary().c_str());
  }
  state.counters["triangles"] = static_cast<double>(f.mesh.triangle_count());
  state.counters["bricks"] = static_cast<double>(f.lattice.brick_count());
}

void winding(benchmark::State& state) {
  const Fluid& f = fluid();
  for (auto _ : state) benchmark::DoNotOptimize(winding_numbers(f.mesh, f.lattice).size());
}

void first_extraction(benchmark::State& state) {
  const Fluid& f = fluid();
  for (auto _ : state) {
    TriangleMesh mesh;
    f.extract(mesh);
    state.counters["triangles"] = static_cast<double>(mesh.triangle_count());
  }
}

}  // namespace

BENCHMARK(certificate)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(winding)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(first_extraction)->UseRealTime()->Unit(benchmark::kMillisecond);
