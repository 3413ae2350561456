// What isoskin-bench measures beside isoskin: other programs' meshers, each from a grid that is in memory.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin::perf {

/// A grid in memory, as OpenVDB has it.
struct PeerGrid;

/// The first grid of floats in the file. Throws InputError where there is none.
std::shared_ptr<const PeerGrid> read_peer_grid(const std::string& path);

/// A way to a mesh of a grid. Meshes have positions and corners; their other columns are blank.
struct Peer {
  std::string name;
  /// Meshes the level set 0 of the grid; edges are 1.5 voxels where the peer can be told. Runs what counts as its work
  /// through `clocked`; conversions to and from its types are outside.
  std::function<TriangleMesh(const PeerGrid& grid, const std::function<void(const std::function<void()>&)>& clocked)>
      mesh;
};

/// OpenVDB's volumeToMesh (adaptivity 0, quads split) and, where the build has them (ISOSKIN_PEERS), VTK's Flying Edges
/// on the dense box about the surface and volumeToMesh followed by CGAL's isotropic remeshing (3 passes, one thread).
std::vector<Peer> peers();

}  // namespace isoskin::perf
