#include "core/field/skeleton_element.h"

#include <algorithm>
#include <cmath>

namespace isoskin {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

ElementOffset offset_from_segment(const DVec3& a, const DVec3& b, const DVec3& p) {
  const DVec3 ab = b - a;
  const double length2 = glm::dot(ab, ab);
  ElementOffset offset{p - a};
  if (!(length2 > 0.0)) return offset;
  const double t = glm::dot(p - a, ab) / length2;
  if (t <= 0.0) return offset;
  if (t >= 1.0) return {p - b};
  const DVec3 along = ab / std::sqrt(length2);
  offset.x -= glm::dot(offset.x, along) * along;
  offset.slide[offset.slides++] = along;
  return offset;
}

ElementOffset offset_from_triangle(const SkeletonElement& e, const DVec3& p) {
  const DVec3 ab = e.b - e.a, ac = e.c - e.a, normal = glm::cross(ab, ac), w = p - e.a;
  const double square = glm::dot(normal, normal);
  if (square > 0.0) {
    const double of_b = glm::dot(glm::cross(w, ac), normal) / square;
    const double of_c = glm::dot(glm::cross(ab, w), normal) / square;
    if (of_b > 0.0 && of_c > 0.0 && of_b + of_c < 1.0) {
      const DVec3 along = glm::normalize(ab);
      return {(glm::dot(w, normal) / square) * normal, {along, glm::normalize(glm::cross(normal, along))}, 2};
    }
  }
  ElementOffset best = offset_from_segment(e.a, e.b, p);
  for (const auto& [from, to] : {std::pair(e.b, e.c), std::pair(e.c, e.a)}) {
    const ElementOffset other = offset_from_segment(from, to, p);
    if (glm::dot(other.x, other.x) < glm::dot(best.x, best.x)) best = other;
  }
  return best;
}

ElementOffset offset_from_box(const SkeletonElement& e, const DVec3& p) {
  ElementOffset offset{p - e.a};
  for (const DVec3& corner : {e.b, e.c, e.d}) {
    const DVec3 edge = corner - e.a;
    const double length2 = glm::dot(edge, edge);
    const double t = length2 > 0.0 ? glm::dot(p - e.a, edge) / length2 : 0.0;
    if (t >= 1.0) {
      offset.x -= edge;
    } else if (!(t <= 0.0)) {
      const DVec3 along = edge / std::sqrt(length2);
      offset.x -= glm::dot(offset.x, along) * along;
      offset.slide[offset.slides++] = along;
    }
  }
  if (offset.slides == 3) offset.x = DVec3(0.0);
  return offset;
}

// The squared distance is convex along the segment, with a piecewise linear slope that breaks where the segment meets a
// slab.
double segment_to_box(const SkeletonElement& e, const Box& box) {
  const DVec3 ab = e.b - e.a;
  const auto gap = [&](double t) {
    const DVec3 c = e.a + t * ab;
    return glm::max(c - box.high, DVec3(0.0)) - glm::max(box.low - c, DVec3(0.0));
  };
  const auto slope = [&](double t) { return glm::dot(gap(t), ab); };
  std::array<double, 8> knot{0.0, 1.0};
  for (int i = 0; i < 3; ++i) {
    const double low = (box.low[i] - e.a[i]) / ab[i], high = (box.high[i] - e.a[i]) / ab[i];
    knot[2 + 2 * i] = low > 0.0 && low < 1.0 ? low : 0.0;
    knot[3 + 2 * i] = high > 0.0 && high < 1.0 ? high : 0.0;
  }
  std::sort(knot.begin(), knot.end());
  std::size_t after = 1;
  while (after + 1 < knot.size() && slope(knot[after]) < 0.0) ++after;
  const double t0 = knot[after - 1], t1 = knot[after];
  const double s0 = slope(t0), s1 = slope(t1);
  const double t = s0 >= 0.0 ? t0 : s1 <= 0.0 ? t1 : t0 + (t1 - t0) * s0 / (s0 - s1);
  return glm::length(gap(t));
}

// Between two convex sets: projections onto the one and the other in turn approach their nearest points, and each
// plane across the way from the one to the other, at the element, tells how far the box is at least.
double solid_to_box(const SkeletonElement& e, const Box& box) {
  constexpr int kRounds = 8;
  double least = 0.0;
  DVec3 q = glm::clamp(e.a, box.low, box.high);
  for (int round = 0; round < kRounds; ++round) {
    const DVec3 x = offset_from(e, q).x;
    const double d = glm::length(x);
    if (!(d > 0.0)) return least;
    double beyond = 0.0;  // of the plane through the nearest point, in units of d
    for (int i = 0; i < 3; ++i)
      if (x[i] != 0.0) beyond += x[i] * ((x[i] > 0.0 ? box.low[i] : box.high[i]) - (q[i] - x[i]));
    least = std::max(least, beyond / d);
    q = glm::clamp(q - x, box.low, box.high);
  }
  return least;
}

}  // namespace

bool is_compact(const SkeletonElement& e) {
  return e.potential == Potential::metaball || e.potential == Potential::wyvill;
}

bool is_point(const SkeletonElement& e) {
  return e.shape == Shape::segment && e.a == e.b;
}

Corners8 corners_of(const SkeletonElement& e) {
  if (is_point(e)) return {{e.a}, 1};
  if (e.shape == Shape::segment) return {{e.a, e.b}, 2};
  if (e.shape == Shape::triangle) return {{e.a, e.b, e.c}, 3};
  const DVec3 bc = e.b + (e.c - e.a), up = e.d - e.a;
  return {{e.a, e.b, e.c, bc, e.d, e.b + up, e.c + up, bc + up}, 8};
}

Box extent(const SkeletonElement& e) {
  const Corners8 corners = corners_of(e);
  Box box;
  for (int i = 0; i < corners.count; ++i) box.add(corners.at[i]);
  return box;
}

DVec3 center(const SkeletonElement& e) {
  const Corners8 corners = corners_of(e);
  DVec3 sum(0.0);
  for (int i = 0; i < corners.count; ++i) sum += corners.at[i];
  return sum / double(corners.count);
}

ElementOffset offset_from(const SkeletonElement& e, const DVec3& p) {
  if (e.shape == Shape::triangle) return offset_from_triangle(e, p);
  if (e.shape == Shape::box) return offset_from_box(e, p);
  return offset_from_segment(e.a, e.b, p);
}

Interval euclidean_distance(const SkeletonElement& e, const Box& box) {
  Interval distance{e.shape == Shape::segment ? segment_to_box(e, box) : solid_to_box(e, box), 0.0};
  for (int corner = 0; corner < 8; ++corner) {  // the distance to a convex set is convex: its maximum is at a corner
    const DVec3 p(corner & 1 ? box.high.x : box.low.x, corner & 2 ? box.high.y : box.low.y,
                  corner & 4 ? box.high.z : box.low.z);
    const double d = glm::length(offset_from(e, p).x);
    distance.high = std::max(distance.high, std::isfinite(d) ? d : kInfinity);
  }
  return distance;
}

void check(const SkeletonElement& e, std::size_t index) {
  const auto fail = [&](const char* what) {
    throw InputError("skeleton element " + std::to_string(index) + ": " + what);
  };
  const Corners8 corners = corners_of(e);
  for (int corner = 0; corner < corners.count; ++corner)
    for (int i = 0; i < 3; ++i)
      if (!std::isfinite(corners.at[corner][i])) fail("position must be finite");
  if (!(e.radius > 0.0) || !std::isnormal(e.radius * e.radius)) fail("radius must be positive and finite");
  if (!std::isfinite(e.weight)) fail("weight must be finite");
  if (!(e.norm > 0.0) || !std::isfinite(e.norm)) fail("norm must be positive and finite");
  if (e.shape != Shape::box) return;
  constexpr double kPerpendicular = 1e-6;
  const std::array edge{e.b - e.a, e.c - e.a, e.d - e.a};
  for (int i = 0; i < 3; ++i) {
    const DVec3 &u = edge[i], &v = edge[(i + 1) % 3];
    if (std::abs(glm::dot(u, v)) > kPerpendicular * glm::length(u) * glm::length(v))
      fail("edges of a box must be perpendicular");
  }
}

}  // namespace isoskin
