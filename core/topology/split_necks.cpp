#include "core/topology/split_necks.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <unordered_set>

#include "core/mechanics/project.h"
#include "core/topology/critical_points.h"
#include "core/topology/section_cut.h"
#include "core/topology/weave.h"

namespace isoskin {
namespace {

DVec3 corner(const TriangleMesh& mesh, Index t, Index k) {
  return DVec3(mesh.position(mesh.vertex[3 * t + k]));
}

DVec3 centroid(const TriangleMesh& mesh, Index t) {
  return (corner(mesh, t, 0) + corner(mesh, t, 1) + corner(mesh, t, 2)) / 3.0;
}

/// How clearly all that the ring encloses is on `side` of the field: the mean of samples along its spokes; 0 when one
/// of them is not.
double clearance(const Section& section, int side, const Field& field) {
  const DVec3 middle = middle_of(section);
  if (side * field.value(middle) <= 0.0) return 0.0;
  constexpr double kAlong[] = {0.3, 0.6, 0.9};
  double sum = 0.0;
  for (const DVec3& p : section.point)
    for (const double along : kAlong) {
      const double clear = side * field.value(glm::mix(middle, p, along));
      if (clear <= 0.0) return 0.0;
      sum += clear;
    }
  return sum / double(std::size(kAlong) * section.point.size());
}

struct Ring {
  Section section;
  Plane plane;
  double clearance = 0.0;
};

/// Replaces `best` by the clearest ring about the neck in one plane, of those that pass through the cluster's
/// triangles.
void look_in(const Plane& plane, const TriangleMesh& mesh, const QuasiCritical& cluster, const Field& field,
             const SplitOptions& options, Ring& best) {
  std::unordered_set<Index> seen;
  for (const Index t : cluster.triangles) {
    if (seen.count(t)) continue;
    Section section = cut_section(mesh, plane, t, std::size_t(options.longest));
    for (const Index h : section.halfedge) seen.insert(TriangleMesh::triangle(h));
    if (section.halfedge.size() < 3) continue;
    Plane own = plane;
    own.origin = middle_of(section);
    if (winding(section, own) != -cluster.side) continue;
    const double clear = clearance(section, cluster.side, field);
    if (clear > best.clearance) best = {std::move(section), plane, clear};
  }
}

/// The flattest direction of points.
DVec3 plane_normal(const std::vector<DVec3>& points, const DVec3& middle) {
  DMat3 sum(0.0);
  for (const DVec3& p : points) sum += glm::outerProduct(p - middle, p - middle);
  return symmetric_eigen(sum).vectors[0];
}

/// The clearest of the rings in several planes along the likely axes; without a section when there is none.
Ring clearest_ring(const TriangleMesh& mesh, const QuasiCritical& cluster, const Field& field,
                   const SplitOptions& options) {
  DVec3 middle(0.0);
  for (const DVec3& p : cluster.points) middle += p / double(cluster.points.size());
  Ring best;
  for (const DVec3& axis : {neck_axis(mesh, cluster.triangles), plane_normal(cluster.points, middle)}) {
    double farthest = 0.0;
    for (const Index t : cluster.triangles)
      farthest = std::max(farthest, std::abs(glm::dot(centroid(mesh, t) - middle, axis)));
    for (int i = 0; i < options.planes; ++i) {
      const double height = farthest * ((2.0 * i + 2.0) / (options.planes + 1.0) - 1.0);
      look_in({middle + height * axis, axis}, mesh, cluster, field, options, best);
    }
  }
  return best;
}

/// Where the new surface lies along `direction`; `otherwise` when it is not in reach.
DVec3 tip_along(const DVec3& origin, const DVec3& direction, int side, const Field& field, double reach,
                const DVec3& otherwise) {
  constexpr int kSteps = 64, kHalvings = 30;
  for (int i = 1; i <= kSteps; ++i) {
    double far = reach * i / kSteps, near = reach * (i - 1) / kSteps;
    if (side * field.value(origin + far * direction) > 0.0) continue;
    for (int k = 0; k < kHalvings; ++k) {
      const double half = 0.5 * (near + far);
      (side * field.value(origin + half * direction) > 0.0 ? near : far) = half;
    }
    return origin + 0.5 * (near + far) * direction;
  }
  return otherwise;
}

/// The ring with all triangles that hang together with it and are `wanted`.
std::vector<Index> grown_ring(const TriangleMesh& mesh, const Section& ring,
                              const std::function<bool(Index triangle)>& wanted) {
  std::unordered_set<Index> seen;
  std::vector<Index> band;
  for (const Index h : ring.halfedge)
    if (seen.insert(TriangleMesh::triangle(h)).second) band.push_back(TriangleMesh::triangle(h));
  for (std::size_t i = 0; i < band.size(); ++i)
    for (Index k = 0; k < 3; ++k) {
      const Index t = TriangleMesh::triangle(mesh.twin[3 * band[i] + k]);
      if (seen.insert(t).second && wanted(t)) band.push_back(t);
    }
  std::sort(band.begin(), band.end());
  return band;
}

/// The ring and the triangles about it that lie on the cluster's side of the new field, farther than e from its
/// surface, and no farther from the ring's middle than half as much again as the ring: what is left of the neck.
std::vector<Index> left_band(const TriangleMesh& mesh, const Section& ring, int side, const Field& field, double e) {
  constexpr double kAround = 1.5;
  const DVec3 middle = middle_of(ring);
  double radius = 0.0;
  for (const DVec3& p : ring.point) radius = std::max(radius, glm::distance(p, middle));
  return grown_ring(mesh, ring, [&](Index t) {
    const DVec3 c = centroid(mesh, t);
    if (glm::distance(c, middle) > kAround * radius + e) return false;
    const FieldSample at = field.sample(c);
    return side * at.value > e * glm::length(at.gradient);
  });
}

DVec3 middle_of(const TriangleMesh& mesh, const std::vector<Index>& border) {
  DVec3 sum(0.0);
  for (const Index h : border) sum += DVec3(mesh.position(mesh.from(h))) / double(border.size());
  return sum;
}

/// Points on a closed line, evenly spaced along it, the first on its first point.
std::vector<DVec3> resampled(const std::vector<DVec3>& line, std::size_t count) {
  std::vector<double> along(line.size() + 1, 0.0);
  for (std::size_t i = 0; i < line.size(); ++i)
    along[i + 1] = along[i] + glm::distance(line[i], line[(i + 1) % line.size()]);
  std::vector<DVec3> points;
  std::size_t i = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const double at = along.back() * double(k) / double(count);
    while (i + 1 < line.size() && along[i + 1] <= at) ++i;
    const double step = along[i + 1] - along[i];
    points.push_back(glm::mix(line[i], line[(i + 1) % line.size()], step > 0.0 ? (at - along[i]) / step : 0.0));
  }
  return points;
}

/// One side of the plane between two new surfaces, seen from there.
struct Outlook {
  DVec3 origin, direction;
  DVec3 tip;  // on the new surface above the origin, or a place near it
  double reach;
  int side;
};

/// Where a vertex will be once it has been projected onto the new surface.
DVec3 settled(const DVec3& p, const Field& field, double edge_length) {
  ProjectOptions project;
  project.tolerance = float(1e-3 * edge_length);
  project.max_step = float(0.5 * edge_length);
  return project_point(field, p, project).point;
}

/// Closes a border: rings about an edge apart, each with vertices about an edge apart, then a fan about the tip. All
/// lie on the new surface as it is seen from the plane.
void cap(const TriangleMesh& mesh, MeshPatch& patch, const std::vector<Index>& border, const Outlook& outlook,
         const Field& field, double e) {
  constexpr std::size_t kLeast = 5, kMostRings = 64;
  std::vector<Index> rim;
  std::vector<DVec3> rim_position;
  double radius = 0.0, length = 0.0;
  for (const Index h : border) {
    rim.push_back(mesh.from(h));
    rim_position.push_back(settled(DVec3(mesh.position(mesh.from(h))), field, e));
    radius += glm::distance(rim_position.back(), outlook.tip) / double(border.size());
  }
  for (std::size_t i = 0; i < rim.size(); ++i)
    length += glm::distance(rim_position[i], rim_position[(i + 1) % rim.size()]);
  std::vector<Index> line = rim;
  std::vector<DVec3> position = rim_position;
  const std::size_t rings = std::clamp<std::size_t>(std::size_t(std::lround(radius / e)), 1, kMostRings);
  for (std::size_t k = 1; k < rings; ++k) {
    const double inward = double(k) / double(rings);
    const std::size_t wanted = std::size_t(std::lround((1.0 - inward) * length / e));
    std::vector<DVec3> ring_position =
        resampled(rim_position, std::clamp(wanted, kLeast, std::max(kLeast, rim.size())));
    std::vector<Index> ring;
    for (DVec3& p : ring_position) {
      const DVec3 straight = glm::mix(p, outlook.tip, inward);
      const DVec3 below = straight - glm::dot(straight - outlook.origin, outlook.direction) * outlook.direction;
      p = tip_along(below, outlook.direction, outlook.side, field, outlook.reach, straight);
      ring.push_back(patch.add_vertex(p, rim, true));
    }
    weave(patch, line, position, ring, ring_position, 1);
    line = std::move(ring);
    position = std::move(ring_position);
  }
  const Index top = patch.add_vertex(outlook.tip, rim, true);
  for (std::size_t i = 0; i < line.size(); ++i) patch.add_triangle(line[i], line[(i + 1) % line.size()], top);
}

/// Erases an annulus and caps its borders, the one above the plane with what is seen in outlook[0].
std::optional<MeshPatch> cap_annulus(const TriangleMesh& mesh, const std::vector<Index>& annulus,
                                     const Outlook (&outlook)[2], const Field& field, double edge_length) {
  const auto borders = find_borders(mesh, annulus);
  if (borders.size() != 2 || euler_of(mesh, annulus) != 0) return std::nullopt;
  const auto above = [&](const auto& border) {
    return glm::dot(middle_of(mesh, border) - outlook[0].origin, outlook[0].direction) > 0.0;
  };
  if (above(borders[0]) == above(borders[1])) return std::nullopt;
  MeshPatch patch(mesh);
  patch.remove(annulus);
  for (const auto& border : borders) cap(mesh, patch, border, outlook[above(border) ? 0 : 1], field, edge_length);
  if (!patch.fits(mesh) || patch.euler_change(mesh) != 2) return std::nullopt;
  return patch;
}

}  // namespace

DVec3 neck_axis(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  DMat3 sum(0.0);
  for (const Index t : triangles) {
    const DVec3 n = glm::cross(corner(mesh, t, 1) - corner(mesh, t, 0), corner(mesh, t, 2) - corner(mesh, t, 0));
    const double area = glm::length(n);
    if (area > 0.0) sum += glm::outerProduct(n, n) / area;
  }
  return symmetric_eigen(sum).vectors[0];
}

PlannedPatch plan_split(const TriangleMesh& mesh, const QuasiCritical& cluster, const Field& field,
                        const SplitOptions& options) {
  const auto [section, plane, clear] = clearest_ring(mesh, cluster, field, options);
  if (section.halfedge.empty()) return {std::nullopt, "no ring of triangles goes around what the surface has left"};
  const DVec3 middle = middle_of(section);
  const double e = options.edge_length, reach = options.reach * e;
  constexpr double kHalfGap = 0.25;  // of e, between caps that find no surface
  Outlook outlook[2];
  for (const int k : {0, 1}) {
    const DVec3 up = k == 0 ? plane.normal : -plane.normal;
    const DVec3 tip = tip_along(middle, up, cluster.side, field, reach, middle + kHalfGap * e * up);
    outlook[k] = {middle, up, tip, reach, cluster.side};
  }
  const std::unordered_set<Index> of_cluster(cluster.triangles.begin(), cluster.triangles.end());
  const std::vector<Index> bands[] = {left_band(mesh, section, cluster.side, field, e),
                                      grown_ring(mesh, section, [&](Index t) { return of_cluster.count(t) > 0; })};
  for (std::vector<Index> erased : bands)
    for (int grown = 0; grown <= options.growths; ++grown, erased = with_neighbours(mesh, erased))
      if (auto patch = cap_annulus(mesh, erased, outlook, field, e)) return {std::move(patch), {}};
  MeshPatch patch(mesh);
  cut_and_cap(mesh, patch, section, outlook[0].tip, outlook[1].tip);
  if (!patch.fits(mesh) || patch.euler_change(mesh) != 2) return {std::nullopt, "the caps do not fit"};
  return {std::move(patch), {}};
}

}  // namespace isoskin
