// Bad sites that pieces and the shape of the mesh tell, where no corner of the lattice does.
#pragma once

#include <vector>

#include "core/topology/bad_sites.h"
#include "core/topology/certificate.h"

namespace isoskin {

/// Vertices by piece.
std::vector<std::size_t> sizes_of(const MeshPieces& pieces);

/// All of a small piece that failed is a bad site: a droplet may lie folded on the surface, where no lattice corner and
/// no distance gives it away.
void add_small_pieces(const TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                      std::size_t most_vertices, BadSites& sites);

/// What merges pieces may be hidden from every corner of the lattice.
void add_bridges(const TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                 const BrickLattice& lattice, const LatticeTopology& topology, BadSites& sites);

/// Where a piece with another topology is one triangle around, a handle or neck may be that no lattice corner tells of.
void add_necks(const TriangleMesh& mesh, const std::vector<std::uint8_t>& failed, BadSites& sites);

/// Skin crumpled up in many layers lies on the surface everywhere, so nothing else tells; left alone it grows, and no
/// seam fits about it.
void add_crumples(const TriangleMesh& mesh, double edge_length, Backend& backend, BadSites& sites);

}  // namespace isoskin
