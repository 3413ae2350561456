// The geometric mesh: the mechanical mesh subdivided where normals turn (design 7; Bouthors-Nesme 3).
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct RefineOptions {
  float angle = 18.0f;    // alpha_r, degrees: split where normals differ by more
  int passes = 4;         // N_p, at most
  float sagitta = 0.0f;   // split what lies farther beside the surface, world units; 0: by angle alone
  float shortest = 0.0f;  // no edge shorter than this is split, world units
};

struct RefineReport {
  int passes = 0;
  std::size_t triangles = 0;
  std::size_t new_vertices = 0;
  std::size_t quasi_critical = 0;  // new points that stayed on their edge because projection failed
};

/// The vertices of the mesh that was refined come first, in order; then the new ones by the triangle they came from (of
/// an edge the lower-numbered of the two), then in the order in which they came: parents before children. Triangles lie
/// in the order of those they came from. So what is refined as in another mesh lies in one piece. Every vertex knows
/// the two it came between, and every triangle the one it came from, so attributes carry through. mesh.vertices.rest
/// and .velocity are interpolated; ids of new vertices are fresh but not persistent (from mesh.next_id on).
struct GeometricMesh {
  TriangleMesh mesh;
  std::vector<Vec3> normal;                       // outward unit field normals, one a vertex
  std::vector<Index> parent_triangle;             // per triangle: the one it came from
  std::vector<std::array<Index, 2>> parent_edge;  // per vertex: the two vertices (of this mesh) whose midpoint it was;
                                                  // itself twice for one that was there before
};

/// How a new vertex came to be.
struct Birth {
  std::uint16_t pass = 0;      // from 1 on
  std::uint16_t put_back = 0;  // 1: onto its edge, where it would have folded a triangle
  bool operator==(const Birth&) const = default;
};

/// F and |grad F| at a triangle's centroid.
struct CentroidSample {
  float value = 0.0f, slope = 0.0f;
};

/// A refined mesh and where the parts of it are.
struct Refinement {
  GeometricMesh geometric;
  std::vector<Index> first_child;        // per triangle that was refined, and one more: its children in `geometric`
  std::vector<Index> first_vertex;       // the same: the new vertices it owns, counted from the first new one
  std::vector<Birth> birth;              // per new vertex
  std::vector<CentroidSample> centroid;  // per triangle of `geometric`
};

/// An edge that is split. Vertices have names where it is known from.
struct KnownSplit {
  Index a = kNone, b = kNone;  // its ends, a < b
  Index middle = kNone;
  int pass = 0;
};

/// Such edges by their ends.
class SplitTable {
public:
  /// Once for each edge counts.
  void add(const KnownSplit& split);
  /// Null where there is none.
  const KnownSplit* find(Index a, Index b) const;

private:
  std::size_t slot(Index a, Index b) const;
  void grow();

  std::vector<KnownSplit> split_;  // open addressing, a power of two, at most half of it full
  std::size_t count_ = 0;
};

/// Of a part of a mesh: how triangles about its border are split, known from another refinement.
struct KnownSplits {
  SplitTable split;
  std::vector<std::uint8_t> triangle;  // of the part: 1 where these and no other edges are split
  std::vector<Index> name;             // of the part's vertices, kNone without one
};

/// Marks edges whose ends' normals differ by more than the angle, or tell (as those of a circle do) that the middle
/// lies farther beside the surface than the sagitta; the other edges of two neighbours whose centroids' normals differ
/// by more than the angle; and all edges of a triangle whose centroid lies farther off than those of a sphere's
/// triangles do with such edges. Splits 1-to-2, 1-to-3 (the diagonal that follows lower curvature) and 1-to-4,
/// projects; no T-vertices. A new point that would fold a triangle over (normal against the field's at all corners)
/// stays on its edge.
GeometricMesh refine(const TriangleMesh& mechanical, Backend& backend, const RefineOptions& options,
                     const ProjectOptions& project, RefineReport* report = nullptr);

/// refine() pass by pass, for who looks at the mesh between passes. `backend` must outlive it.
class Refiner {
public:
  Refiner(const TriangleMesh& mechanical, Backend& backend, const RefineOptions& options,
          const ProjectOptions& project);
  /// Of a part of a mesh with borders, which must be edges of triangles whose splits are known. To be taken through all
  /// its passes, even after one that splits nothing: a later one may come from outside.
  Refiner(const TriangleMesh& part, const KnownSplits& known, Backend& backend, const RefineOptions& options,
          const ProjectOptions& project);
  ~Refiner();

  /// One pass; false when nothing was left to split.
  bool pass();
  const RefineReport& report() const { return report_; }

  const TriangleMesh& mesh() const;
  CentroidSample centroid(std::size_t triangle) const;

  /// Ends it; normals where the field has none stay zero.
  Refinement finish();

private:
  class Passes;
  std::unique_ptr<Passes> passes_;
  RefineReport report_;
};

/// Where the gradient vanishes the triangles around say where outside is.
void replace_zero_normals(GeometricMesh& geometric);

/// Puts refined vertices within `radius` of a bad point back on the mesh they came from (the middle of their parent
/// edge), so that the surface there is that mesh's; topology stays. Parents come before children, so one pass does.
void flatten(GeometricMesh& geometric, const std::vector<Vec3>& bad, float radius);

}  // namespace isoskin
