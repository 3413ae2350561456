// Two sheets that face each other across a saddle are joined by a tube.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <set>
#include <vector>

#include "core/mechanics/project.h"
#include "core/topology/mesh_probe.h"
#include "core/topology/surgery_theatre.h"
#include "core/topology/weave.h"

namespace isoskin::surgery {
namespace {

/// True when the field to follow fills the line between two hits, moved along with the critical point, which is the
/// last to be filled on its axis.
bool is_bridged(const LineHit& first, const LineHit& second, const Theatre& theatre) {
  if (theatre.filled(theatre.site.after.position) <= 0.0) return true;  // gone again: the field says nothing
  constexpr int kProbes = 16;
  for (int i = 0; i < kProbes; ++i) {
    const double t = glm::mix(first.distance, second.distance, (i + 0.5) / kProbes);
    if (theatre.filled(theatre.site.after.position + t * theatre.axis_after()) <= 0.0) return false;
  }
  return true;
}

/// The two hits on both sides of the gap at the critical point: the line leaves matter at the first and enters it again
/// at the second, and the gap is bridged. The gap that holds the point, else the nearest one within `search`.
std::optional<std::pair<LineHit, LineHit>> gap_along(const TriangleMesh& mesh, const Theatre& theatre) {
  const auto hits = line_hits(mesh, theatre.site.before.position, theatre.axis_before(), theatre.reach());
  const bool leaving = theatre.matter == Matter::solid;
  std::optional<std::pair<LineHit, LineHit>> best;
  double least = theatre.options.search * theatre.e();
  for (std::size_t i = 0; i + 1 < hits.size(); ++i) {
    if (hits[i].along != leaving || hits[i + 1].along == leaving) continue;
    const double away = std::max({hits[i].distance, -hits[i + 1].distance, 0.0});
    if (away > least || (best && away == least) || !is_bridged(hits[i], hits[i + 1], theatre)) continue;
    best = {hits[i], hits[i + 1]};
    least = away;
  }
  return best;
}

/// Distances from the critical point to the waist of the new tube, in `count` directions about the axis. Where the tube
/// has no side there, or a far one, because what it joins meets anew beside it, the median stands in.
std::vector<double> waist(const Theatre& theatre, int count) {
  constexpr double kFar = 3.0;  // medians
  const auto [u, v] = theatre.across_after();
  const bool open = theatre.filled(theatre.site.after.position) > 0.0;
  std::vector<double> radius(std::size_t(count), std::numeric_limits<double>::infinity());
  for (int i = 0; open && i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    radius[i] = theatre.surface_along(std::cos(angle) * u + std::sin(angle) * v).value_or(radius[i]);
  }
  std::vector<double> sorted = radius;
  std::sort(sorted.begin(), sorted.end());
  double median = sorted[(sorted.size() - 1) / 2];
  if (!std::isfinite(median)) median = theatre.options.fall_back_ring * theatre.e();
  const double least = theatre.options.least_ring * theatre.e();
  for (double& r : radius) r = std::max(least, r <= kFar * median ? r : median);
  return radius;
}

using Loop = std::vector<Index>;

Loop vertices_of(const TriangleMesh& mesh, const std::vector<Index>& border) {
  Loop loop;
  for (const Index h : border) loop.push_back(mesh.from(h));
  return loop;
}

bool share_a_vertex(const TriangleMesh& mesh, const std::vector<Index>& a, const std::vector<Index>& b) {
  std::set<Index> vertices;
  for (const Index t : a) vertices.insert({mesh.vertex[3 * t], mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]});
  return std::any_of(b.begin(), b.end(), [&](Index t) {
    return vertices.count(mesh.vertex[3 * t]) + vertices.count(mesh.vertex[3 * t + 1]) +
               vertices.count(mesh.vertex[3 * t + 2]) >
           0;
  });
}

/// Where a vertex will be once it has been projected onto the field to follow.
DVec3 settled_position(const Theatre& theatre, const DVec3& p) {
  ProjectOptions project;
  project.tolerance = float(1e-3 * theatre.e());
  project.max_step = float(0.5 * theatre.e());
  return project_point(theatre.field, p, project).point;
}

/// Distance from the origin to the segment p q.
double distance_to_segment(const glm::dvec2& p, const glm::dvec2& q) {
  const glm::dvec2 d = q - p;
  const double length2 = glm::dot(d, d), t = length2 > 0.0 ? std::clamp(-glm::dot(p, d) / length2, 0.0, 1.0) : 0.0;
  return glm::length(p + t * d);
}

/// The hit triangle and what reaches into the new tube: triangles nearer to the axis than `radius`. Corners alone would
/// leave borders with edges that the axis passes on the wrong side, and the tube would fold.
std::vector<Index> disc_about(const TriangleMesh& mesh, const Theatre& theatre, Index seed, double radius) {
  const DVec3 origin = theatre.site.before.position, axis = theatre.axis_before();
  const DVec3 u = theatre.site.before.hessian.vectors[1], v = glm::cross(axis, u);
  return grow_disc(mesh, {seed}, [&](Index t) {
    glm::dvec2 corner[3];
    for (Index k = 0; k < 3; ++k) {
      const DVec3 x = DVec3(mesh.position(mesh.vertex[3 * t + k])) - origin;
      if (glm::length(x) > theatre.reach()) return false;
      corner[k] = {glm::dot(x, u), glm::dot(x, v)};
    }
    return std::min({distance_to_segment(corner[0], corner[1]), distance_to_segment(corner[1], corner[2]),
                     distance_to_segment(corner[2], corner[0])}) < radius;
  });
}

/// Cuts a smaller triangle out of the middle of a triangle with corners `outer`, for sheets so near that their
/// triangles share a vertex: the window's corners are its own. Returns them in the same order.
Loop window_in(const TriangleMesh& mesh, MeshPatch& patch, const Loop& outer) {
  DVec3 middle(0.0);
  for (const Index v : outer) middle += DVec3(mesh.position(v)) / double(outer.size());
  Loop inner;
  for (const Index v : outer) inner.push_back(patch.add_vertex(0.5 * (DVec3(mesh.position(v)) + middle), {v}));
  for (std::size_t k = 0; k < outer.size(); ++k) {
    const std::size_t next = (k + 1) % outer.size();
    patch.add_triangle(outer[k], outer[next], inner[next]);
    patch.add_triangle(outer[k], inner[next], inner[k]);
  }
  return inner;
}

}  // namespace

SurgeryReport join(TriangleMesh& mesh, const Theatre& theatre) {
  const auto gap = gap_along(mesh, theatre);
  if (!gap) return refused("no two sheets face each other across the critical point");
  constexpr int kProbes = 8, kLeast = 6, kMost = 48;
  const std::vector<double> probe = waist(theatre, kProbes);
  const double radius = std::accumulate(probe.begin(), probe.end(), 0.0) / kProbes;
  MeshPatch patch(mesh);
  std::vector<Index> disc[2];
  const double disc_radius =
      std::clamp(radius, theatre.options.least_disc * theatre.e(), theatre.options.widest_disc * theatre.e());
  for (const double r : {disc_radius, 0.0}) {
    disc[0] = disc_about(mesh, theatre, gap->first.triangle, r);
    disc[1] = disc_about(mesh, theatre, gap->second.triangle, r);
    if (!share_a_vertex(mesh, disc[0], disc[1])) break;
  }
  const bool touching = share_a_vertex(mesh, disc[0], disc[1]);
  Loop loop[2];
  for (int side = 0; side < 2; ++side) {
    loop[side] = vertices_of(mesh, disc_border(mesh, disc[side]));
    if (touching) loop[side] = window_in(mesh, patch, loop[side]);
    patch.remove(disc[side]);
  }
  const int count = std::clamp(int(std::lround(2.0 * std::numbers::pi * radius / theatre.e())), kLeast, kMost);
  const std::vector<double> r = waist(theatre, count);
  const auto [u, v] = theatre.across_after();
  Loop around = vertices_of(mesh, disc_border(mesh, disc[0]));
  for (const Index h : disc_border(mesh, disc[1])) around.push_back(mesh.from(h));
  Loop ring;
  std::vector<DVec3> ring_position;
  for (int i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    ring_position.push_back(theatre.site.after.position + r[i] * (std::cos(angle) * u + std::sin(angle) * v));
    ring.push_back(patch.add_vertex(ring_position.back(), around));
  }
  // The first sheet's border turns about the axis as the ring does where its outside looks along the axis (a solid),
  // the second sheet's always the other way.
  for (int side = 0; side < 2; ++side) {
    if (side == 1 || theatre.matter == Matter::hollow) {
      std::reverse(ring.begin(), ring.end());
      std::reverse(ring_position.begin(), ring_position.end());
    }
    std::vector<DVec3> loop_position;
    for (const Index w : loop[side]) loop_position.push_back(settled_position(theatre, patch.position(mesh, w)));
    weave(patch, loop[side], loop_position, ring, ring_position, ring.size());
  }
  return applied(mesh, patch);
}

}  // namespace isoskin::surgery
