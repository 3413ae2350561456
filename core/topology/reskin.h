// Tier 2 of design 8: the mesh about bad sites is emptied and filled with marching cubes of the field, stitched to the
// skin that stays (after Wojtan et al. 2009; simpler here, because the field itself says what is right).
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/mechanics/alter.h"
#include "core/sampling/brick_lattice.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/bad_sites.h"
#include "core/topology/certificate.h"
#include "core/topology/growing_filling.h"

namespace isoskin {

/// How holes are cut down to where they are needed.
struct NarrowOptions {
  int rounds = 2;         // each with other cubes that what is emptied is cut to, and asked for itself
  double width = 5.0;     // of a cube, in units of e
  double apart = 7.0;     // cubes that are asked at once, in units of e; the others lie half as far from those
  double shift = 0.167;   // of a round's cubes against the one's before, along the space diagonal, in units of `apart`
  std::size_t from = 24;  // vertices: smaller holes are not asked
  int growths = 3;        // times holes that have become smaller are grown until their seams fit
};

struct ReskinOptions {
  double edge_length = 1.0;    // e, world units
  double radius = 1.0;         // triangles with a vertex nearer than this to a bad site are replaced, in units of e
  double margin = 2.0;         // how far beyond the emptied region the lattice's surface is built, in units of e
  double least_margin = 1.0;   // the same, of holes that have grown before more is built
  int growths = 8;             // times a hole whose seam fails is grown before it is given up
  bool suspects_only = false;  // odd sites are left alone until a seam nearer than `spread` fails
  double spread = 1.0;         // units of e
  bool alike_only = false;     // only holes whose filling has the topology of what it fills: that of the mesh stays
  bool spare_sound = false;    // skin that lies on the surface as it should stays where seams fit without taking it out
  double off_surface = 0.5;    // how far it may be off the surface, in lattice spacings
  NarrowOptions narrow;
  bool replace_all = false;  // all holes are filled anew, also those whose filling has the topology of what it fills
  bool carry = true;         // rest and velocity of new vertices come from the old surface, else they are unset
  AlterOptions alter;        // how the lattice's triangles are coarsened to near e, vertices that stay left alone
  int collapse_passes = 3;   // calls of alter() for it
};

struct ReskinReport {
  std::size_t seams = 0;  // closed curves along which new and old surface were welded
  std::size_t triangles_removed = 0;
  std::size_t triangles_added = 0;
  std::size_t holes_given_up = 0;  // their seams would not close; the mesh there is as it was
  std::size_t holes_alike = 0;     // left as they were because the lattice has the same topology there
  Index first_new_vertex = 0;      // vertices from here on are new: age 1
};

/// Empties the neighbourhood of `sites` on the pieces that failed the certificate (where their topology is right, of
/// the sure ones, unless all is replaced), and what is folded beside it, cuts
/// the lattice's surface along paths between the vertices of the borders that remain (each border vertex snapped to the
/// nearest lattice vertex of the same side, neighbours joined by shortest paths), keeps the part that faces the hole
/// and welds it. Closed pieces of the lattice's surface that failed and have no mesh any more are added, emptied pieces
/// of mesh are not; pieces that passed are not touched. The result is a closed, oriented 2-manifold; vertices that stay
/// are not moved and keep their ids and their order; new ones come last. The filling is dense and is coarsened here;
/// alter() and relax() of the part about it (core/mesh/mesh_part.h) make it near-equilateral. The backend must hold the
/// field. Deterministic. `shared`: of the same lattice, topology and backend; tries for one field make it once.
ReskinReport reskin(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate, const BadSites& sites,
                    const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                    const ReskinOptions& options, GrowingFilling* shared = nullptr);

}  // namespace isoskin
