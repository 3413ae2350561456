// Folds smoothed out along the surface: where triangles of a refined skin overlap, the skin's vertices become averages
// of their neighbours.
#pragma once

#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"
#include "core/refine/refined_skin.h"

namespace isoskin {

struct UntangleOptions {
  int rings = 2;    // vertices so many edges from the triangles move
  int sweeps = 12;  // in which each goes to the middle of its neighbours, and onto the surface
};

/// What a refined skin has and should not have.
struct Faults {
  std::vector<Crossing> crossings;
  std::vector<Vec3> wrong;  // places on the wrong side
};

/// The parts of a skin about the triangles that overlap; what hangs together or overlaps is one part.
class Tangles {
public:
  Tangles(const TriangleMesh& skin, Faults faults, const UntangleOptions& options);

  /// Moves their vertices. What lies beside them stays and holds them: a map of a disc with a convex border in which
  /// each vertex is the mean of its neighbours has no folds (Tutte 1963). The backend must hold the field. Parallel and
  /// deterministic.
  void smooth(TriangleMesh& skin, Backend& backend, const ProjectOptions& project) const;

  /// Moves the vertices back of parts that now have no fewer crossings than at first, or more wrong places within
  /// `reach` (world units). Whether there were any.
  bool take_back(TriangleMesh& skin, const Faults& now, double reach) const;

private:
  void gather(const TriangleMesh& skin, int rings);
  void join_parts(const TriangleMesh& skin);
  std::vector<int> crossings_by_part(const TriangleMesh& skin, const std::vector<Crossing>& crossings) const;

  Faults faults_;
  UntangleOptions options_;
  std::vector<Index> vertex_;             // ascending
  std::vector<Index> row_;                // per vertex of the skin: of vertex_, kNone when it stays
  std::vector<std::vector<Index>> ring_;  // per row: the vertex's neighbours
  std::vector<Index> part_;               // per row: the first row of the part it belongs to
  std::vector<Vec3> before_;              // per row: where it was
};

/// Old and new vertices lie side by side on the seams of what was filled: edges much shorter than `fineness` (world
/// units) are collapsed, much longer ones split and others flipped about the vertices with ids from `first_new` on, and
/// what that has moved is projected. The backend must hold the field.
void mend_seams(TriangleMesh& skin, Index first_new, double fineness, Backend& backend, const ProjectOptions& project);

}  // namespace isoskin
