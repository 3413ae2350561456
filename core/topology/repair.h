// Tier 3 of design 8: pieces that fail the certificate are extracted anew and their attributes carried over. Always
// succeeds, so a frame is never finished wrong.
#pragma once

#include <string>
#include <vector>

#include "core/backend.h"
#include "core/mechanics/alter.h"
#include "core/mechanics/project.h"
#include "core/mechanics/relax.h"
#include "core/topology/certificate.h"

namespace isoskin {

/// How an extracted surface becomes a mechanical mesh.
struct SettleOptions {
  float coarsening = 1.0f;  // wanted edge length in units of e; 0 keeps the extracted triangles as they are
  int collapse_passes = 6;  // alter() calls before the first relaxation
  int rounds = 10;          // alter + relax rounds after it
};

struct RepairReport {
  std::size_t pieces_removed = 0;
  std::size_t pieces_extracted = 0;
  double area_reextracted = 0.0;  // world units^2, of the new pieces
};

/// Removes the failed mesh pieces, extracts the failed lattice pieces (see certify), coarsens them to edge length
/// settle.coarsening * e and relaxes to near-equilateral triangles without changing topology, projects, carries
/// attributes over from the old mesh, and appends them to the pieces that stay, which are not touched. New vertices get
/// fresh ids. An empty `mesh` extracts everything: this is also how a first frame starts.
RepairReport reextract(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                       const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                       const AlterOptions& alter, const RelaxOptions& relax, const ProjectOptions& project,
                       const SettleOptions& settle = {});

}  // namespace isoskin
