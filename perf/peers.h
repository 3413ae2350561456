// What isoskin-bench measures beside isoskin: other programs' meshers, each from a grid that is in memory.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <openvdb/openvdb.h>

#include "core/mesh/triangle_mesh.h"

namespace isoskin::perf {

/// A way to a mesh of a grid. Meshes have positions and corners; other columns are blank: shape_statistics() reads.
struct Peer {
  std::string name;
  /// Meshes the level set 0 of the grid, edges about as long as `edge` where the peer can be told. Runs `clocked` with
  /// what counts as its work, once; conversions to and from its types are outside.
  std::function<TriangleMesh(const openvdb::FloatGrid& grid, double edge,
                             const std::function<void(const std::function<void()>&)>& clocked)>
      mesh;
};

/// OpenVDB's volumeToMesh (adaptivity 0, quads split) and, where the build has them (ISOSKIN_PEERS), VTK's Flying Edges
/// on the dense box about the surface and volumeToMesh followed by CGAL's isotropic remeshing (3 passes, one thread).
std::vector<Peer> peers();

/// The first grid of floats in the file, or null.
openvdb::FloatGrid::Ptr read_float_grid(const std::string& path);

}  // namespace isoskin::perf
