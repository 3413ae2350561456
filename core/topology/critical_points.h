// Critical points of a C2 field: where grad F = 0, what kind they are, and a fast search for them near a mesh (design
// 8; Rumiano 2007, section 3.3).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/backend.h"
#include "core/field/field.h"
#include "core/field/field_changes.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// By the signs of the Hessian's eigenvalues: --- maximum, --+ two_saddle, -++ one_saddle, +++ minimum (Rumiano, figure
/// 5). degenerate: an eigenvalue vanishes, so Morse theory says nothing.
enum class CriticalKind : std::uint8_t { maximum, two_saddle, one_saddle, minimum, degenerate };
const char* name(CriticalKind kind);

/// Eigenvalues ascending; column i of `vectors` is the unit eigenvector of values[i]; the columns are right-handed.
struct SymmetricEigen {
  DVec3 values{0.0};
  DMat3 vectors{1.0};
};

/// Cyclic Jacobi rotations in float64. `m` must be symmetric; finite.
SymmetricEigen symmetric_eigen(const DMat3& m);

struct CriticalPoint {
  DVec3 position{0.0};
  double value = 0.0;  // F there
  SymmetricEigen hessian;
  CriticalKind kind = CriticalKind::degenerate;
};

/// The kind told by eigenvalues in ascending order: degenerate when the smallest |eigenvalue| is at most `ratio` times
/// the largest.
CriticalKind classify(const DVec3& eigenvalues, double ratio);

struct CriticalOptions {
  double edge_length = 1.0;        // e, world units: the measure of the lengths below
  double reach = 4.0;              // a search is given up farther than this from where it started; units of e
  double max_step = 0.5;           // longest Newton step; units of e
  int iterations = 30;             // evaluations a seed may take before it is given up
  std::size_t few_seeds = 512;     // so many are searched from on the host: rounds of batches would only wait
  double settled = 1e-3;           // the search for where there are any ends with a Newton step this short; units of e
  double exact = 1e-8;             // the float64 polish ends with a Newton step this short; units of e
  double merge = 1e-2;             // critical points nearer than this are one; units of e
  double degenerate_ratio = 1e-5;  // smallest |eigenvalue| over the largest
};

/// Critical points in order of position (x, then y, then z), no two nearer than `merge`, and what became of the seeds.
struct CriticalSearch {
  std::vector<CriticalPoint> points;
  std::size_t seeds = 0;
  std::size_t rejected = 0;    // seeds that diverged, ran out of iterations or met a flat region (F constant)
  std::size_t degenerate = 0;  // points of kind degenerate
};

/// Value, Hessian and kind at `p`, whatever the gradient there.
CriticalPoint describe_critical_point(const Field& field, const DVec3& p, const CriticalOptions& options);

/// Damped Newton on grad F in float64 from `seed`: each step is limited to max_step and halved while |grad F| does not
/// fall. Nothing when it does not settle within the iterations or the reach. At a degenerate point Newton converges
/// slowly; it is reported as degenerate once |grad F| explains less than `settled` e of motion.
std::optional<CriticalPoint> refine_critical_point(const Field& field, const DVec3& seed,
                                                   const CriticalOptions& options);

/// The same from many seeds at once: from more than few_seeds in batches of Backend::evaluate and evaluate_hessian in
/// float32, else in float64; then the float64 polish. `field` must be the backend's current one. The result does not
/// depend on the number of threads.
CriticalSearch find_critical_points(const Field& field, Backend& backend, std::span<const DVec3> seeds,
                                    const CriticalOptions& options);

/// Vertices within `about` whose |grad F| is no larger than that of any neighbour in the mesh (Rumiano 3.3.1),
/// ascending.
std::vector<DVec3> least_gradient_vertices(const TriangleMesh& mesh, Backend& backend,
                                           const ChangeMask& about = {{true, {}}, 0.0});

/// The order of critical points: of x, then of y, then of z.
bool before_in_space(const DVec3& a, const DVec3& b);

/// Sorts by position and keeps the first of every cluster of points nearer to it than `distance`.
void merge_critical_points(std::vector<CriticalPoint>& points, double distance);

}  // namespace isoskin
