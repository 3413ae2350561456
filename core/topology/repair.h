// Tier 3 of design 8: pieces that fail the certificate are extracted anew and their attributes carried over. Always
// succeeds, so a frame is never finished wrong.
#pragma once

#include <string>
#include <vector>

#include "core/backend.h"
#include "core/mechanics/project.h"
#include "core/mechanics/relax.h"
#include "core/topology/certificate.h"

namespace isoskin {

struct RepairReport {
  std::size_t pieces_removed = 0;
  std::size_t pieces_extracted = 0;
  double area_reextracted = 0.0;  // world units^2, of the new pieces
};

/// Removes the failed mesh pieces, extracts the failed lattice pieces (see certify), carries attributes over from the
/// old mesh, coarsens to edge length `e` and relaxes to near-equilateral triangles without changing topology, and
/// projects. New vertices get fresh ids.
RepairReport reextract(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                       const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                       const RelaxOptions& relax, const ProjectOptions& project);

}  // namespace isoskin
