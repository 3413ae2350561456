// Two sheets that face each other across a saddle are joined by a tube.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <set>
#include <vector>

#include "core/mechanics/project.h"
#include "core/topology/mesh_probe.h"
#include "core/topology/surgery_theatre.h"

namespace isoskin::surgery {
namespace {

/// The two hits on both sides of the gap at the critical point: the line leaves matter at the first and enters it again
/// at the second. The gap that holds the point, else the nearest one within `search`.
std::optional<std::pair<LineHit, LineHit>> gap_along(const TriangleMesh& mesh, const Theatre& theatre) {
  const auto hits = line_hits(mesh, theatre.site.before.position, theatre.axis_before(), theatre.reach());
  const bool leaving = theatre.matter == Matter::solid;
  std::optional<std::pair<LineHit, LineHit>> best;
  double least = theatre.options.search * theatre.e();
  for (std::size_t i = 0; i + 1 < hits.size(); ++i) {
    if (hits[i].along != leaving || hits[i + 1].along == leaving) continue;
    const double away = std::max({hits[i].distance, -hits[i + 1].distance, 0.0});
    if (away <= least && (!best || away < least)) {
      best = {hits[i], hits[i + 1]};
      least = away;
    }
  }
  return best;
}

/// Radius of the waist of the new tube in `count` directions about the axis.
std::vector<double> waist(const Theatre& theatre, int count) {
  const auto [u, v] = theatre.across_after();
  const double least = theatre.options.least_ring * theatre.e();
  const double unknown = theatre.options.fall_back_ring * theatre.e();
  const bool open = theatre.filled(theatre.site.after.position) > 0.0;
  std::vector<double> radius;
  for (int i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    const auto distance = open ? theatre.surface_along(std::cos(angle) * u + std::sin(angle) * v) : std::nullopt;
    radius.push_back(std::max(least, distance.value_or(unknown)));
  }
  return radius;
}

using Loop = std::vector<Index>;

/// Triangles between the hole's border `loop` and the ring, both the same way round: of all ways to step along both
/// from a common start, the one whose crossing edges have the least sum of squares (Fuchs, Kedem and Uselton 1977). `p`
/// and `q` are their positions.
void weave(MeshPatch& patch, const Loop& loop, const std::vector<DVec3>& p, const Loop& ring,
           const std::vector<DVec3>& q) {
  const std::size_t n = loop.size(), m = ring.size();
  const auto cost = [&](std::size_t i, std::size_t j) {
    const DVec3 d = p[i % n] - q[j % m];
    return glm::dot(d, d);
  };
  constexpr double kNever = std::numeric_limits<double>::infinity();
  std::vector<std::uint8_t> best_steps;
  std::size_t best_start = 0;
  double best = kNever;
  std::vector<double> sum((n + 1) * (m + 1));
  std::vector<std::uint8_t> from_loop(sum.size());
  for (std::size_t start = 0; start < m; ++start) {
    for (std::size_t i = 0; i <= n; ++i)
      for (std::size_t j = 0; j <= m; ++j) {
        const std::size_t at = i * (m + 1) + j;
        // No edge is made twice: what hangs on the common start is before the middle when it is seen first and after it
        // when it is seen last.
        const bool first_half_j = 2 * j < m, first_half_i = 2 * i < n;
        const bool twice = (i == 0 && !first_half_j) || (i == n && first_half_j) || (j == 0 && !first_half_i) ||
                           (j == m && first_half_i);
        if (i + j == 0) {
          sum[at] = cost(0, start);
          continue;
        }
        const double along_loop = i > 0 ? sum[at - (m + 1)] : kNever, along_ring = j > 0 ? sum[at - 1] : kNever;
        from_loop[at] = along_loop <= along_ring;
        sum[at] = twice ? kNever : std::min(along_loop, along_ring) + cost(i, start + j);
      }
    if (!(sum.back() < best)) continue;
    best = sum.back();
    best_start = start;
    best_steps.clear();
    for (std::size_t i = n, j = m; i + j > 0;) {
      best_steps.push_back(from_loop[i * (m + 1) + j]);
      --(best_steps.back() ? i : j);
    }
  }
  std::size_t i = 0, j = best_start;
  for (auto step = best_steps.rbegin(); step != best_steps.rend(); ++step) {
    if (*step) {
      patch.add_triangle(loop[i % n], loop[(i + 1) % n], ring[j % m]);
      ++i;
    } else {
      patch.add_triangle(ring[(j + 1) % m], ring[j % m], loop[i % n]);
      ++j;
    }
  }
}

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

/// Where the vertex will be once it has been projected onto the field to follow.
DVec3 settled_position(const TriangleMesh& mesh, const Theatre& theatre, Index v) {
  ProjectOptions project;
  project.tolerance = float(1e-3 * theatre.e());
  project.max_step = float(0.5 * theatre.e());
  return project_point(theatre.field, DVec3(mesh.position(v)), project).point;
}

/// The hit triangle and what touches the new tube's inside: triangles with a corner nearer to the axis than `radius`.
std::vector<Index> disc_about(const TriangleMesh& mesh, const Theatre& theatre, Index seed, double radius) {
  const DVec3 origin = theatre.site.before.position, axis = theatre.axis_before();
  return grow_disc(mesh, {seed}, [&](Index t) {
    double nearest = std::numeric_limits<double>::infinity();
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      const DVec3 x = DVec3(mesh.position(mesh.vertex[h])) - origin;
      if (glm::length(x) > theatre.reach()) return false;
      nearest = std::min(nearest, glm::length(x - glm::dot(x, axis) * axis));
    }
    return nearest < radius;
  });
}

}  // namespace

SurgeryReport join(TriangleMesh& mesh, const Theatre& theatre) {
  const auto gap = gap_along(mesh, theatre);
  if (!gap) return refused("no two sheets face each other across the critical point");
  constexpr int kProbes = 8, kMost = 48;
  const std::vector<double> probe = waist(theatre, kProbes);
  const double radius = std::accumulate(probe.begin(), probe.end(), 0.0) / kProbes;
  const double disc_radius = std::min(radius, theatre.options.widest_disc * theatre.e());

  std::vector<Index> disc[2];
  for (const double r : {disc_radius, 0.0}) {
    disc[0] = disc_about(mesh, theatre, gap->first.triangle, r);
    disc[1] = disc_about(mesh, theatre, gap->second.triangle, r);
    if (!share_a_vertex(mesh, disc[0], disc[1])) break;
  }
  if (share_a_vertex(mesh, disc[0], disc[1])) return refused("the two sheets share a vertex");

  Loop loop[2];
  for (int side = 0; side < 2; ++side) loop[side] = vertices_of(mesh, disc_border(mesh, disc[side]));
  const int count = std::clamp(int(std::lround(2.0 * std::numbers::pi * radius / theatre.e())), 3, kMost);
  const std::vector<double> r = waist(theatre, count);
  const auto [u, v] = theatre.across_after();
  Loop around = loop[0];
  around.insert(around.end(), loop[1].begin(), loop[1].end());
  MeshPatch patch(mesh);
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
    for (const Index w : loop[side]) loop_position.push_back(settled_position(mesh, theatre, w));
    weave(patch, loop[side], loop_position, ring, ring_position);
    patch.remove(disc[side]);
  }
  return applied(mesh, patch);
}

}  // namespace isoskin::surgery
