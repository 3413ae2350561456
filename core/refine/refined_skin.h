// A refined mesh that goes on from frame to frame: only what may come out otherwise than last time is refined again.
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <vector>

#include <tbb/parallel_sort.h>

#include "core/backend.h"
#include "core/field/field_changes.h"
#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/refine/refine.h"
#include "core/refine/row_pool.h"
#include "core/refine/shape_sums.h"

namespace isoskin {

struct RefinedSkinOptions {
  RefineOptions refine;
  ProjectOptions project;     // its reach must be finite for anything to be kept
  double voxel = 0.0;         // of the field; 0: it holds no distances
  double stray = 0.25;        // centroids farther from the surface than this are reported, world units
  double unit = 1.0;          // of statistics' sums, see ShapeSums; world units
  bool adds_changes = false;  // changed() goes on telling what it told before the update, too
};

/// How far from the surface a value of F is, by its slope there. Level sets hold distances, and their gradients vanish
/// inside thin sheets; other values are no lengths.
double distance_estimate(double value, double slope, double voxel);

/// Two triangles of a refined skin that overlap and have no vertex in common: triangles of the skin, a <= b, and which
/// of their children.
struct Crossing {
  Index a = kNone, child_a = kNone, b = kNone, child_b = kNone;
  auto operator<=>(const Crossing&) const = default;
};

/// Refines a skin again and again. A triangle's children depend on the field and on the triangles within a few steps of
/// it: those that are what they were, with the field that was about them, keep their children, bit for bit. About what
/// has changed some rings are refined with it; where the outermost of these come out as they were, all beyond does too,
/// else they are refined with more around them.
class RefinedSkin {
public:
  /// `changes`: of the field since the last call; null: anything. What comes of it depends on neither earlier calls nor
  /// `changes`: it is what refine() returns. All calls with the same options but for adds_changes.
  void update(const TriangleMesh& skin, const FieldChanges* changes, Backend& backend,
              const RefinedSkinOptions& options);

  /// Put in order when asked for after an update, which takes as long as a copy; the reference stays. Until then what
  /// has changed lies where there was room for it.
  const GeometricMesh& mesh() const;
  std::size_t triangle_count() const { return triangles_; }
  /// Of mesh(), without putting it in order; as ShapeSums tells them.
  ShapeStatistics statistics() const;
  /// The triangles of those of the skin whose triangles are reached together, each with corners of its own.
  template <class Reaches>
  TriangleMesh triangles_where(const Reaches& reaches) const;
  /// Centroids of `mesh` off the surface, in order of triangles.
  std::vector<Vec3> strays() const;
  /// Self-intersections of `mesh` as it was refined, ascending. Looked for about what has changed since the last call,
  /// and only when asked for. `skin`: that of the last update().
  const std::vector<Crossing>& crossings(const TriangleMesh& skin);
  /// As many as the last call of crossings() found.
  std::size_t crossing_count() const { return crossing_.size(); }
  /// Where the last update() changed the mesh, and those before it whose changes it was to add to; none: anywhere.
  const std::optional<std::vector<Box>>& changed() const { return changed_; }
  /// Triangles of the skin that the last update() refined.
  std::size_t refined_triangles() const { return refined_triangles_; }

  /// Moves the refined vertices near bad points (see flatten) until the next update().
  void flatten(const std::vector<Vec3>& bad, float radius);
  /// Whether flatten() has moved anything since then.
  bool is_flattened() const { return !lifted_.empty(); }

private:
  class Update;
  struct Stray {
    Index triangle, child;  // of the skin, and which of its children
    Vec3 point;
  };
  struct Bounds {
    Vec3 low{std::numeric_limits<float>::infinity()}, high{-std::numeric_limits<float>::infinity()};
    Vec3 axis{0.0f};        // about which the normals lie, unit; zero where they lie anywhere
    float one_side = 2.0f;  // a unit vector with a larger dot product with it has all of them on its side
    Box box() const { return {DVec3(low), DVec3(high)}; }
  };

  void refine_whole(const TriangleMesh& skin, Backend& backend, const RefinedSkinOptions& options);
  static void find_strays(const Refinement& refined, Index at, Index triangle, const RefinedSkinOptions& options,
                          std::vector<Stray>& found);
  void remember(const TriangleMesh& skin);
  bool is_new(Index row) const { return birth_[row].pass != 0; }
  const Vec3& position(Index row) const { return geometric_.mesh.vertices.position[row]; }
  std::array<Vec3, 3> corners(Index child) const;
  const Rows& child(Index triangle) const { return child_[slot_[triangle]]; }
  const Rows& fresh(Index triangle) const { return fresh_[slot_[triangle]]; }
  const Bounds& bounds(Index triangle) const { return bounds_[slot_[triangle]]; }
  Bounds find_bounds(Index triangle) const;
  template <class Reaches>
  std::vector<Index> triangles_reached(const Reaches& reaches) const;
  std::vector<Index> near_fresh(const std::vector<std::uint8_t>& fresh) const;
  void update_blocks(std::vector<Index> blocks);
  std::vector<Crossing> find_crossings(const TriangleMesh& skin, const std::vector<std::uint8_t>& fresh) const;
  std::vector<std::array<Index, 3>> plain_corners(const TriangleMesh& skin, const std::vector<Index>& some) const;
  Index new_slot();
  void count_shapes(const std::vector<Index>& slots, int times) const;
  void put_in_order() const;
  void carry_attributes() const;
  void replace_normals() const;

  // What mesh() shows; until it is asked for with rows in any order and gaps between them, and without attributes.
  mutable GeometricMesh geometric_;
  mutable std::vector<Birth> birth_;  // per row of vertices, pass 0: the skin's
  // What is kept by triangle of the skin lies in slots, which stay where edits change numbers.
  std::vector<Index> slot_;  // per triangle of the skin
  std::vector<Index> free_slots_;
  std::vector<Index> triangle_;              // per slot: of the skin, kNone where it is free
  mutable std::vector<Rows> child_, fresh_;  // per slot: its children and the new vertices it owns
  std::vector<Bounds> bounds_;               // per slot: of its children
  static constexpr Index kBlockSlots = 64;
  std::vector<Box> block_;             // per so many slots: about their bounds
  mutable std::vector<Index> corner_;  // per vertex of the skin: its row
  mutable RowPool free_children_, free_vertices_;
  mutable bool ordered_ = true, carried_ = true, normals_replaced_ = true;
  mutable std::vector<Index> without_normal_;  // rows where the gradient vanishes, once their normals are replaced
  mutable ShapeSums shape_;
  // Per slot: what its children have added to them, nothing where they are not among them; empty until asked for.
  mutable std::vector<ShapeSums::Sum> counted_;
  mutable std::vector<Index> uncounted_;           // slots, perhaps repeating, when some are counted
  mutable std::vector<std::uint16_t> angle_step_;  // per row of triangles that are among them

  VertexTable skin_;  // its vertices, without positions
  Index skin_next_id_ = 0;
  std::vector<Index> vertex_;           // of the skin: 3 a triangle
  std::size_t triangles_ = 0;           // of mesh()
  std::vector<Stray> stray_;            // in order
  std::vector<Crossing> crossing_;      // of triangles that have been looked at
  std::vector<std::uint8_t> unlooked_;  // per triangle of the skin; empty: all have been
  std::vector<Vec3> lifted_;            // positions before they were flattened, empty when they were not
  std::optional<std::vector<Box>> changed_;
  std::size_t refined_triangles_ = 0;
  double unit_ = 1.0;
};

/// Triangles of the skin whose boxes are reached, ascending. What is reached, any box about it is, too.
template <class Reaches>
std::vector<Index> RefinedSkin::triangles_reached(const Reaches& reaches) const {
  constexpr std::size_t kFew = 8;  // blocks
  const std::vector<Index> blocks = indices_where(block_.size(), [&](Index b) { return reaches(block_[b]); });
  std::vector<Index> reached = collect(blocks.size(), kFew, [&](Index i, std::vector<Index>& list) {
    const Index first = kBlockSlots * blocks[i], end = std::min(first + kBlockSlots, Index(bounds_.size()));
    for (Index s = first; s < end; ++s)
      if (triangle_[s] != kNone && reaches(bounds_[s].box())) list.push_back(triangle_[s]);
  });
  tbb::parallel_sort(reached.begin(), reached.end());
  return reached;
}

template <class Reaches>
TriangleMesh RefinedSkin::triangles_where(const Reaches& reaches) const {
  const std::vector<Index> reached = triangles_reached(reaches);
  std::vector<std::size_t> first(reached.size() + 1, 0);
  for (std::size_t i = 0; i < reached.size(); ++i) first[i + 1] = first[i] + 3 * std::size_t{child(reached[i]).count};
  TriangleMesh out;
  out.vertex.resize(first.back());
  out.vertices.position.resize(first.back());
  for_each_index(reached.size(), [&](std::size_t i) {
    const Rows children = child(reached[i]);
    std::size_t at = first[i];
    for (Index c = children.first; c < children.first + children.count; ++c)
      for (const Vec3& p : corners(c)) {
        out.vertex[at] = Index(at);
        out.vertices.position[at++] = p;
      }
  });
  return out;
}

}  // namespace isoskin
