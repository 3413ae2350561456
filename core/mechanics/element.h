// One element of the elastic skin: a rotated linear (corotational) triangle of equilateral rest shape, or three springs
// (design 5; Nesme-Bouthors 2.3, Bouthors-Nesme 2.3-2.6). The float64 definition of what relax kernels compute.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "core/types.h"

namespace isoskin {

/// Material of every element. All share the rest triangle (0,0), (e,0), (e/2, e sqrt(3)/2).
struct ElementMaterial {
  double edge_length = 1.0;  // e, world units
  double young = 1000.0;     // E, plane stress; in 2D the stiffness does not depend on e
  double poisson = 0.3;      // nu
  double spring = 100.0;     // k, springs only
};

using Corners = std::array<DVec3, 3>;

/// Where the rest triangle's plane lies in the world: `x` and `y` are the images of its axes under frame times rotation
/// R. Orthonormal, or both zero for a triangle collapsed to a point (then it has neither force nor stiffness).
struct ElementFrame {
  DVec3 x{0.0}, y{0.0};
};

inline constexpr double kSqrt3 = 1.7320508075688772935;

/// Of two edges, the later one counts as longer only by more than this (relative to squared length), so that float32
/// and float64 agree on an equilateral triangle.
inline constexpr double kEdgeTie = 1e-5;
/// The rotation of G is ambiguous when its two singular values cancel to less than this share (an equilateral inverted
/// triangle, every direction is as good): then the frame itself is taken.
inline constexpr double kRotationTie = 1e-3;
/// A triangle whose height is below this share of its longest edge has no normal of its own.
inline constexpr double kFlat = 1e-6;

/// Some unit vector normal to the unit vector `a`.
inline DVec3 any_normal(const DVec3& a) {
  const DVec3 b = glm::abs(a);
  const DVec3 axis = b.x <= b.y && b.x <= b.z ? DVec3(1, 0, 0) : b.y <= b.z ? DVec3(0, 1, 0) : DVec3(0, 0, 1);
  return glm::normalize(glm::cross(a, axis));
}

/// Index k of the longest edge p[k] p[k+1]; the corner k+2 has the smallest height over it.
inline int longest_edge(const Corners& p) {
  int longest = 0;
  double best = 0.0;
  for (int k = 0; k < 3; ++k) {
    const DVec3 d = p[(k + 1) % 3] - p[k];
    const double squared = glm::dot(d, d);
    if (squared > best * (1.0 + kEdgeTie)) {
      longest = k;
      best = squared;
    }
  }
  return longest;
}

/// Frame of the triangle `p`, counter-clockwise. `inverted`: the triangle faces the inside; its height is then taken
/// negative (it is seen from outside, so it is pushed back through itself). `outward`: any vector to the outside, not
/// unit, used only where the triangle is so flat that it has no normal.
///
/// Local axes: first along the longest edge u v, second to the third corner w (away from it when inverted); then
/// turned by R, the rotation of the polar decomposition of G = Ds Dm^-1, in closed form, and by -120 degrees times the
/// number of the longest edge so that corner 0 is the rest triangle's origin whichever edge was taken.
inline ElementFrame element_frame(const Corners& p, bool inverted, const DVec3& outward) {
  const int k = longest_edge(p);
  const DVec3 uv = p[(k + 1) % 3] - p[k];
  const DVec3 uw = p[(k + 2) % 3] - p[k];
  const double length = glm::length(uv);
  if (!(length > 0.0)) return {};
  const DVec3 first = uv / length;

  DVec3 normal = glm::cross(uv, uw);
  double height = glm::length(normal) / length;
  if (height > kFlat * length) {
    normal = (inverted ? -1.0 : 1.0) * glm::normalize(normal);
    height = inverted ? -height : height;
  } else {
    normal = outward - glm::dot(outward, first) * first;
    const double size = glm::length(normal);
    normal = size > kFlat * glm::length(outward) ? normal / size : any_normal(first);
    height = 0.0;
  }
  const DVec3 second = glm::cross(normal, first);

  // e G for rest edge e: columns v and (2 w - v) / sqrt(3) of the local corners v = (length, 0), w = (along, height).
  const double along = glm::dot(uw, first);
  const double g00 = length, g01 = (2.0 * along - length) / kSqrt3, g11 = 2.0 * height / kSqrt3;
  const double trace = g00 + g11, spin = -g01;
  const double norm = std::hypot(trace, spin);
  const bool ambiguous = norm <= kRotationTie * (std::abs(g00) + std::abs(g01) + std::abs(g11));
  double c = ambiguous ? 1.0 : trace / norm, s = ambiguous ? 0.0 : spin / norm;

  constexpr double kCos[3] = {1.0, -0.5, -0.5}, kSin[3] = {0.0, -0.5 * kSqrt3, 0.5 * kSqrt3};  // of -120 k degrees
  const double turned = c * kCos[k] - s * kSin[k];
  s = s * kCos[k] + c * kSin[k];
  c = turned;
  return {c * first + s * second, c * second - s * first};
}

/// Symmetric 2x2: a strain or a stress in the rest triangle's axes.
struct Symmetric2 {
  double xx = 0.0, yy = 0.0, xy = 0.0;
};

/// Plane stress of a strain: E / (1 - nu^2) [xx + nu yy, yy + nu xx, (1 - nu) xy].
inline Symmetric2 plane_stress(const Symmetric2& strain, const ElementMaterial& material) {
  const double scale = material.young / (1.0 - material.poisson * material.poisson);
  return {scale * (strain.xx + material.poisson * strain.yy), scale * (strain.yy + material.poisson * strain.xx),
          scale * (1.0 - material.poisson) * strain.xy};
}

/// sym(R^T D Dm^-1) of corner positions or displacements `p`: the strain plus I, or the strain's change.
inline Symmetric2 symmetric_gradient(const ElementFrame& frame, const Corners& p, double edge_length) {
  const DVec3 d1 = p[1] - p[0], d2 = p[2] - p[0];
  const DVec3 column0 = d1 / edge_length, column1 = (2.0 * d2 - d1) / (kSqrt3 * edge_length);
  return {glm::dot(frame.x, column0), glm::dot(frame.y, column1),
          0.5 * (glm::dot(frame.x, column1) + glm::dot(frame.y, column0))};
}

/// A0 R stress Dm^-T at the three corners (corner 0: minus the sum of the others).
inline Corners stress_at_corners(const ElementFrame& frame, const Symmetric2& stress, double edge_length) {
  const double scale = 0.25 * kSqrt3 * edge_length;  // A0 / e
  const DVec3 column0 = stress.xx * frame.x + stress.xy * frame.y;
  const DVec3 column1 = stress.xy * frame.x + stress.yy * frame.y;
  const DVec3 at1 = scale * (column0 - column1 / kSqrt3);
  const DVec3 at2 = scale * (2.0 / kSqrt3) * column1;
  return {-(at1 + at2), at1, at2};
}

/// Elastic forces on the corners: -A0 R sigma Dm^-T with sigma of eps = sym(R^T G) - I.
inline Corners element_forces(const ElementFrame& frame, const Corners& p, const ElementMaterial& material) {
  if (frame.x == DVec3(0.0)) return {DVec3(0.0), DVec3(0.0), DVec3(0.0)};
  Symmetric2 strain = symmetric_gradient(frame, p, material.edge_length);
  strain.xx -= 1.0;
  strain.yy -= 1.0;
  const Corners k = stress_at_corners(frame, plane_stress(strain, material), material.edge_length);
  return {-k[0], -k[1], -k[2]};
}

/// K dx = R K0 R^T dx, the negated change of the forces with the frame frozen. Symmetric, positive semi-definite.
inline Corners element_stiffness_times(const ElementFrame& frame, const Corners& dx, const ElementMaterial& material) {
  const Symmetric2 strain = symmetric_gradient(frame, dx, material.edge_length);
  return stress_at_corners(frame, plane_stress(strain, material), material.edge_length);
}

/// Forces of the springs on the triangle's edges, rest length e. Each has half of k: every edge has two triangles.
inline Corners spring_forces(const Corners& p, const ElementMaterial& material) {
  Corners force{DVec3(0.0), DVec3(0.0), DVec3(0.0)};
  for (int k = 0; k < 3; ++k) {
    const int to = (k + 1) % 3;
    const DVec3 d = p[to] - p[k];
    const double length = glm::length(d);
    if (!(length > 0.0)) continue;  // no direction to push in
    const DVec3 pull = 0.5 * material.spring * (length - material.edge_length) / length * d;
    force[k] += pull;
    force[to] -= pull;
  }
  return force;
}

/// Stiffness of the springs at `p` times dx: k/2 (a a^T + max(0, 1 - e/l) (I - a a^T)) an edge of direction a and
/// length l; the clamp projects it to be positive semi-definite where a spring is compressed.
inline Corners spring_stiffness_times(const Corners& p, const Corners& dx, const ElementMaterial& material) {
  Corners out{DVec3(0.0), DVec3(0.0), DVec3(0.0)};
  for (int k = 0; k < 3; ++k) {
    const int to = (k + 1) % 3;
    const DVec3 d = p[to] - p[k];
    const double length = glm::length(d);
    if (!(length > 0.0)) continue;
    const DVec3 a = d / length, change = dx[to] - dx[k];
    const double sideways = std::max(0.0, 1.0 - material.edge_length / length);
    const DVec3 along = glm::dot(a, change) * a;
    const DVec3 product = 0.5 * material.spring * (along + sideways * (change - along));
    out[k] -= product;
    out[to] += product;
  }
  return out;
}

}  // namespace isoskin
