// A refined mesh that goes on from frame to frame: only what may come out otherwise than last time is refined again.
#pragma once

#include <optional>
#include <vector>

#include "core/backend.h"
#include "core/field/field_changes.h"
#include "core/refine/refine.h"

namespace isoskin {

struct RefinedSkinOptions {
  RefineOptions refine;
  ProjectOptions project;  // its reach must be finite for anything to be kept
  double voxel = 0.0;      // of the field; 0: it holds no distances
  double stray = 0.25;     // centroids farther from the surface than this are reported, world units
};

/// How far from the surface a value of F is, by its slope there. Level sets hold distances, and their gradients vanish
/// inside thin sheets; other values are no lengths.
double distance_estimate(double value, double slope, double voxel);

/// Refines a skin again and again. A triangle's children depend on the field and on the triangles within a few steps of
/// it: those that are what they were, with the field that was about them, keep their children, bit for bit. About what
/// has changed some rings are refined with it; where the outermost of these come out as they were, all beyond does too,
/// else they are refined with more around them.
class RefinedSkin {
public:
  /// `changes`: of the field since the last call; null: anything. What comes of it depends on neither earlier calls nor
  /// `changes`: it is what refine() returns. All calls with the same options.
  void update(const TriangleMesh& skin, const FieldChanges* changes, Backend& backend,
              const RefinedSkinOptions& options);

  const GeometricMesh& mesh() const { return refined_.geometric; }
  /// Centroids of `mesh` off the surface, in order of triangles.
  std::vector<Vec3> strays() const;
  /// Where the last update() changed the mesh; none: anywhere.
  const std::optional<std::vector<Box>>& changed() const { return changed_; }
  /// Triangles of the skin that the last update() refined.
  std::size_t refined_triangles() const { return refined_triangles_; }

  /// Moves the refined vertices near bad points (see flatten) until the next update().
  void flatten(const std::vector<Vec3>& bad, float radius);

private:
  class Update;
  struct Stray {
    Index triangle, child;  // of the skin, and which of its children
    Vec3 point;
  };

  void refine_whole(const TriangleMesh& skin, Backend& backend, const RefinedSkinOptions& options);
  static void find_strays(const Refinement& refined, Index at, Index triangle, const RefinedSkinOptions& options,
                          std::vector<Stray>& found);

  Refinement refined_;                 // without centroids
  std::vector<Index> vertex_;          // of the skin: 3 a triangle
  std::vector<Stray> stray_;           // in order
  std::vector<Index> without_normal_;  // vertices where the gradient vanishes
  std::vector<Vec3> lifted_;           // positions before they were flattened, empty when they were not
  std::optional<std::vector<Box>> changed_;
  std::size_t refined_triangles_ = 0;
};

}  // namespace isoskin
