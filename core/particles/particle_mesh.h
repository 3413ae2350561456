// A mesh of F = 0 from particles: fall, spread, join (Figueiredo et al. 1992, section 3).
#pragma once

#include "core/particles/particle_system.h"
#include "core/particles/spread.h"
#include "core/sampling/marching_cubes.h"

namespace isoskin {

struct ParticleMeshOptions {
  double edge_length = 1.0;  // e, world units: the particles' spacing
  std::uint64_t seed = 1992;
  double starts = 6.0;          // random starts on e^2 of surface
  int most_draws = 8;           // of a start that finds no gradient
  int most_insertions = 16;     // rounds of added particles where they are too few to be joined
  double insertion_gap = 0.25;  // no particle is added nearer to another than this, e
  ParticleOptions particles;
  SpreadOptions spread;  // spacing is filled in
};

struct ParticleMeshReport {
  ParticleReport fall;
  std::size_t starts = 0;
  std::size_t spread = 0;    // particles that were kept and spread
  std::size_t inserted = 0;  // added where the polygonization was not a closed manifold
  int insertions = 0;        // rounds of that
};

/// Starts are random points of the bricks that the surface crosses. After falling and spreading, particles are joined
/// by restricted_delaunay(); where that is no closed manifold, points of the surface are added at the largest dual
/// crossings, as Chew (1993) and Boissonnat and Oudot (2005) refine. The backend's field must be `field`, `topology`
/// the lattice's. Same seed, same bytes, whatever the number of threads. Throws InputError where the insertions do not
/// end in a closed manifold: the particles are too few for the surface's detail.
TriangleMesh particle_mesh(const Field& field, Backend& backend, const BrickLattice& lattice,
                           const LatticeTopology& topology, const ProjectOptions& project,
                           const ParticleMeshOptions& options, ParticleMeshReport* report = nullptr);

}  // namespace isoskin
