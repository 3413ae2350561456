// One mesh of one field, by any of the methods that know how to make one; each can start tracking (Tracker::start).
#pragma once

#include <string>

#include "core/lattice_springs/spring_lattice.h"
#include "core/particles/particle_mesh.h"
#include "core/tracker.h"

namespace isoskin {

enum class ExtractMethod {
  marching_cubes,  // of a lattice of spacing e, topology as the lattice says; vertices projected
  particles,       // particle_mesh()
  spring_lattice,  // spring_lattice_mesh()
};

struct ExtractOptions {
  ExtractMethod method = ExtractMethod::marching_cubes;
  TrackOptions track;  // resolved(): edge length, projection, and the lattice and tolerance of the certificate
  std::uint64_t seed = 1992;
};

struct Extraction {
  TriangleMesh mesh;
  std::vector<Vec3> normals;  // outward, of the field, one a vertex
  Certificate certificate;    // against the field, as at the end of a tracked frame
  std::string story;          // one line: what the method did
};

/// Makes `field` the backend's. Throws InputError where the method finds no closed mesh at this edge length.
Extraction extract_surface(const std::shared_ptr<const Field>& field, Backend& backend, const ExtractOptions& options);

}  // namespace isoskin
