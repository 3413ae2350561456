#include "core/extract.h"

#include <fmt/format.h>

#include "core/topology/certificate.h"

namespace isoskin {
namespace {

/// The field, where it is asked for, and what its surface is like there.
struct Ground {
  const Field& field;
  Backend& backend;
  const TrackOptions& track;
  BrickLattice lattice;
  LatticeTopology topology;
};

void by_marching_cubes(const Ground& ground, Extraction& made) {
  const double spacing = ground.track.edge_length;
  const BrickLattice lattice = sample_lattice(ground.field, ground.backend, spacing);
  made.mesh = marching_cubes(lattice, lattice_topology(lattice));
  const ProjectReport projected = ground.backend.project(made.mesh.vertices.position, ground.track.project, {});
  made.mesh.vertices.rest = made.mesh.vertices.position;
  made.story = fmt::format("lattice of {:.4g}, {} of {} vertices not projected", spacing, projected.quasi_critical,
                           projected.points);
}

void by_particles(const Ground& ground, std::uint64_t seed, Extraction& made) {
  ParticleMeshOptions options;
  options.edge_length = ground.track.edge_length;
  options.seed = seed;
  ParticleMeshReport report;
  made.mesh = particle_mesh(ground.field, ground.backend, ground.lattice, ground.topology, ground.track.project,
                            options, &report);
  made.story = fmt::format("{} of {} particles arrived within {} steps, {} kept, {} added where they were too few",
                           report.fall.arrived, report.starts, report.fall.steps, report.spread, report.inserted);
}

void by_spring_lattice(const Ground& ground, Extraction& made) {
  SpringMeshOptions options;
  options.edge_length = ground.track.edge_length;
  SpringLatticeReport report;
  made.mesh = spring_lattice_mesh(ground.field, ground.backend, options, &report);
  made.story = fmt::format("lattice of {:.4g}, {} steps, the last of {:.3f} spacings, {} moves refused",
                           options.spacing * options.edge_length, report.steps, report.last_move, report.refused);
}

}  // namespace

Extraction extract_surface(const std::shared_ptr<const Field>& field, Backend& backend, const ExtractOptions& options) {
  backend.set_field(field);
  Ground ground{*field, backend, options.track, sample_lattice(*field, backend, options.track.lattice_spacing), {}};
  ground.topology = lattice_topology(ground.lattice);
  Extraction made;
  switch (options.method) {
    case ExtractMethod::marching_cubes:
      by_marching_cubes(ground, made);
      break;
    case ExtractMethod::particles:
      by_particles(ground, options.seed, made);
      break;
    case ExtractMethod::spring_lattice:
      by_spring_lattice(ground, made);
      break;
  }
  CertifyOptions certificate;
  certificate.tolerance = options.track.tolerance;
  made.certificate = certify(made.mesh, mesh_pieces(made.mesh), *field, ground.lattice, ground.topology, certificate);
  backend.set_mesh(made.mesh);
  made.normals.resize(made.mesh.vertex_count());
  backend.vertex_normals(made.normals);
  return made;
}

}  // namespace isoskin
