// Quasi-static relaxation of the elastic skin: (I - dt df/dx) dx = dt f by filtered conjugate gradients (design 5;
// Bouthors-Nesme 2.2-2.5, Nesme-Bouthors 2.1-2.5).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/field/field.h"
#include "core/mechanics/element.h"
#include "core/mechanics/project.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

enum class Mechanics { fem, springs };

struct RelaxOptions {
  Mechanics mechanics = Mechanics::fem;
  float edge_length = 1.0f;    // e, rest edge of every element, world units
  float young = 1000.0f;       // E; in 2D independent of e
  float poisson = 0.3f;        // nu
  float spring = 100.0f;       // k, mass-spring mode only
  float dt = 0.04f;            // quasi-static time step, seconds
  int steps = 2;               // quasi-static steps, each followed by a projection
  int cg_iterations = 10;      // at most, per step
  float cg_tolerance = 1e-2f;  // stop when |r| <= cg_tolerance * |r0|; 0 runs all iterations
  float max_move = 0.5f;       // longest move of a vertex in one step, in units of e
  bool sharp = false;          // pull vertices onto sharp features after each step (design 5, errata)
  int sharp_pulls = 3;         // pulls a step, each followed by a projection; one halves the distance to a feature
};

/// Throws std::invalid_argument for an option out of its range.
void check(const RelaxOptions& options);

struct RelaxReport {
  int steps = 0;
  int cg_iterations = 0;           // summed over steps
  double residual = 0.0;           // |r| / |r0| of the last step
  std::size_t inverted = 0;        // inverted triangles seen at the start of the last step
  std::size_t quasi_critical = 0;  // vertices left unprojected by the last projection
};

/// The topology a skin is gathered over.
struct SkinTopology {
  std::vector<Index> vertex;  // 3 a triangle, as TriangleMesh::vertex
  VertexCorners corners;

  std::size_t triangle_count() const { return vertex.size() / 3; }
  std::size_t vertex_count() const { return corners.first.size() - 1; }
};
SkinTopology skin_topology(const TriangleMesh& mesh);

/// The linearised skin at one set of positions: forces, and the stiffness with all rotations frozen. Sums are gathered
/// per vertex in the order of its corners, so they do not depend on the number of threads.
class Skin {
public:
  /// `normals`: outward, unit or zero, one a vertex. `inverted`: one byte a triangle. `pinned`: one byte a vertex, or
  /// none. All are referred to, not copied.
  Skin(const SkinTopology& topology, std::span<const DVec3> positions, std::span<const DVec3> normals,
       std::span<const std::uint8_t> inverted, const RelaxOptions& options, std::span<const std::uint8_t> pinned = {});

  /// f(x), one a vertex.
  std::vector<DVec3> forces() const;
  /// K d = -df/dx d, one a vertex.
  void stiffness_times(std::span<const DVec3> d, std::span<DVec3> product) const;
  /// S d with S = I - n n^T at each vertex, 0 where it is pinned.
  void filter(std::span<DVec3> d) const;

  std::size_t vertex_count() const { return positions_.size(); }

private:
  template <class ElementFunction>
  void gather(std::span<DVec3> sums, const ElementFunction& element) const;

  const SkinTopology& topology_;
  std::span<const DVec3> positions_, normals_;
  std::span<const std::uint8_t> pinned_;
  Mechanics mechanics_;
  ElementMaterial material_;
  std::vector<ElementFrame> frames_;  // fem only
  mutable std::vector<Corners> corner_values_;
};

struct QuasiStaticMove {
  std::vector<DVec3> move;  // dx, one a vertex, tangential; not clamped yet
  int iterations = 0;
  double residual = 0.0;  // |r| / |r0|, 0 when the skin was at rest
};

/// Solves (I + dt K) dx = dt f by conjugate gradients filtered with S, from dx = 0 (Baraff and Witkin 1998).
QuasiStaticMove quasi_static_move(const Skin& skin, const RelaxOptions& options);

/// Outward unit normals -grad F / |grad F| at `positions`, zero where the gradient vanishes.
void field_normals(const Field& field, std::span<const DVec3> positions, std::span<DVec3> normals);

/// 1 for each triangle whose normal has a positive dot product with grad F (a negative one with the outward normal) at
/// all three corners. A corner without a normal makes a triangle not inverted.
void mark_inverted(std::span<const Index> vertex, std::span<const DVec3> positions, std::span<const DVec3> normals,
                   std::span<std::uint8_t> inverted);

/// The pull toward the planes through incident centroids, p += sum A [(c - p).m] m / sum A, with c projected and m the
/// unit gradient at c (Ohtake, Belyaev, Pasko 2003; design 5 and 14). Each pull is at most `max_pull` long.
void pull_to_sharp_features(const SkinTopology& topology, const Field& field, const ProjectOptions& project,
                            double max_pull, std::span<DVec3> positions);

/// Projects every position; `status` one a position.
ProjectReport project_points(const Field& field, const ProjectOptions& options, std::span<Vec3> points,
                             std::span<ProjectStatus> status);

/// Float64 definition of Backend::relax on `positions`. Each step: normals and inversions, quasi_static_move, moves
/// clamped to max_move e, projection; then, if wanted, sharp_pulls times the sharp pull and projection. A vertex that
/// is not projected keeps its moved place. `pinned` as in Skin. Throws std::invalid_argument for options out of range.
RelaxReport relax_skin(const SkinTopology& topology, const Field& field, const RelaxOptions& relax,
                       const ProjectOptions& project, std::span<Vec3> positions, std::span<ProjectStatus> status,
                       std::span<const std::uint8_t> pinned = {});

}  // namespace isoskin
