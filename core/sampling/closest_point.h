// Nearest point of a triangle mesh: how attributes are carried to a new surface from the old one (design 8).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// A point on a mesh: triangle and barycentric weights of its three corners.
struct SurfacePoint {
  Index triangle = kNone;
  Vec3 weight{0.0f};
  float distance = 0.0f;
};

/// Bounding volume tree over a mesh's triangles; the mesh must outlive it. Queries are thread safe.
class ClosestPoint {
public:
  explicit ClosestPoint(const TriangleMesh& mesh);
  ~ClosestPoint();
  /// Where the answers to the last question were.
  struct Neighbour {
    std::size_t nearest = static_cast<std::size_t>(-1), agreeing = static_cast<std::size_t>(-1);
  };
  /// Nearest point to `p` (ties: the smallest triangle index). triangle == kNone for an empty mesh. `side`, when not
  /// zero, is a direction: triangles whose normal points against it are passed over, unless nothing else lies within
  /// `max_distance`; then the nearest of all is taken, however far. `neighbour`, handed from question to question,
  /// makes points that follow each other closely cheaper; the answer does not depend on it.
  SurfacePoint nearest(const Vec3& p, const Vec3& side = Vec3(0.0f),
                       float max_distance = std::numeric_limits<float>::infinity(),
                       Neighbour* neighbour = nullptr) const;

private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

/// Fills rest and velocity of vertices [first, vertex_count) of `mesh` from the nearest points of `old` (sides agree,
/// within eight mean edges). With `old` empty the vertices keep what they have.
void carry_attributes(TriangleMesh& mesh, Index first, const TriangleMesh& old, Backend& backend);

}  // namespace isoskin
