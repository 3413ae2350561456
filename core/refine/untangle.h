// Folds smoothed out along the surface: where triangles of a refined skin overlap, the skin's vertices become averages
// of their neighbours.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "core/backend.h"
#include "core/disjoint_sets.h"
#include "core/mesh/mesh_part.h"
#include "core/mesh/triangle_mesh.h"
#include "core/refine/refined_skin.h"

namespace isoskin {

struct UntangleOptions {
  int rings = 2;  // vertices so many edges from the triangles move; one more after each try in vain
  std::array<int, 3> sweeps{12, 40, 4};  // a try's, in which each goes to the middle of its neighbours, and onto the
                                         // surface: what many drag over a rim may lie well after few
};

/// Where triangles of a skin overlap, tried in turn. Costs what the places do. The skin's triangles stay what they are;
/// all calls with the same skin.
class Tangles {
public:
  explicit Tangles(const TriangleMesh& skin, const UntangleOptions& options = {})
      : options_(options), tried_(skin.triangle_count(), 0), row_(skin.vertex_count(), kNone) {}

  /// Moves the vertices about crossings that have not been tried too often; what hangs together or overlaps is one
  /// part. What lies beside them stays and holds them: a map of a disc with a convex border in which each vertex is the
  /// mean of its neighbours has no folds (Tutte 1963). Pieces with nothing beside them stay. False when there were
  /// none. The backend must hold the field. Parallel and deterministic.
  bool smooth(TriangleMesh& skin, const std::vector<Crossing>& crossings, Backend& backend,
              const ProjectOptions& project);

  /// After smooth(), whose crossings have become `now`: moves the vertices back of parts that have no fewer than
  /// before, or that were or are within `reach` (world units) of a place that they have `hidden`. Returns what the
  /// skin's crossings are then, ascending, those between parts aside.
  std::vector<Crossing> take_back(TriangleMesh& skin, const std::vector<Crossing>& now,
                                  const std::vector<Vec3>& hidden = {}, double reach = 0.0);

  /// Whether the last take_back() moved any.
  bool took_back() const { return took_back_; }

private:
  void gather(const TriangleMesh& skin);
  DisjointSets joined_by_edges() const;
  std::vector<Index> held(DisjointSets& sets) const;
  std::vector<int> sweeps(const TriangleMesh& skin) const;
  std::vector<Index> parts(const TriangleMesh& skin, DisjointSets sets) const;
  int times_tried(const Crossing& crossing) const { return std::max(tried_[crossing.a], tried_[crossing.b]); }
  bool is_tried(const Crossing& crossing) const { return times_tried(crossing) < int(options_.sweeps.size()); }
  Index row(const TriangleMesh& skin, Index triangle) const;

  UntangleOptions options_;
  std::vector<std::uint8_t> tried_;       // per triangle: how often in vain
  std::vector<Crossing> crossing_;        // before the last smooth()
  std::vector<Index> vertex_;             // that are moved, ascending
  std::vector<Index> row_;                // per vertex of the skin: of vertex_, kNone when it stays
  std::vector<std::vector<Index>> ring_;  // per row: the vertex's neighbours
  std::vector<Index> part_;               // per row: the first row of the part it belongs to
  std::vector<Vec3> before_;              // per row: where it was
  bool took_back_ = false;
};

/// Smooths a skin about those of its `open` triangles that overlap near where it is folded sharply, a few times.
/// Whether anything has moved; vertices beside what is open may have. The backend must hold the field. Parallel and
/// deterministic.
bool unfold(TriangleMesh& skin, const OpenSet& open, Backend& backend, const ProjectOptions& project);

/// Old and new vertices lie side by side on the seams of what was filled: edges much shorter than `fineness` (world
/// units) are collapsed, much longer ones split and others flipped about the vertices with ids from `first_new` on, and
/// what that has moved is projected. The backend must hold the field.
void mend_seams(TriangleMesh& skin, Index first_new, double fineness, Backend& backend, const ProjectOptions& project);

}  // namespace isoskin
