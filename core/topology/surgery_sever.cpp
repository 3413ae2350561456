// The ring of triangles about a saddle is taken away and both sides are capped.
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <vector>

#include "core/topology/mesh_probe.h"
#include "core/topology/surgery_theatre.h"

namespace isoskin::surgery {
namespace {

DVec3 middle_of(const Section& section) {
  DVec3 sum(0.0);
  for (const DVec3& p : section.point) sum += p;
  return sum / double(section.point.size());
}

constexpr std::size_t kLongestSection = 4096;

/// The plane's section through the triangle or, where the plane just misses it, through one that touches it.
Section section_at(const TriangleMesh& mesh, const Plane& plane, Index triangle) {
  Section section = cut_section(mesh, plane, triangle, kLongestSection);
  for (Index h = 3 * triangle; h < 3 * triangle + 3; ++h)
    for (Index k = mesh.turn(h); k != h && section.halfedge.empty(); k = mesh.turn(k))
      section = cut_section(mesh, plane, TriangleMesh::triangle(k), kLongestSection);
  return section;
}

/// The nearest section within `search` that goes round matter as it should, though not about the critical point: on a
/// coarse mesh a thin neck may have strayed from it.
Section section_near(const TriangleMesh& mesh, const Theatre& theatre, const Plane& plane) {
  const double search = theatre.options.search * theatre.e();
  const auto farthest = [&](const Section& section) {
    double most = 0.0;
    for (const DVec3& p : section.point) most = std::max(most, glm::distance(p, plane.origin));
    return most;
  };
  std::set<Index> seen;
  Section best;
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    const Vec3& p = mesh.position(mesh.from(h));
    if (plane.height(p) < 0.0 || glm::distance(DVec3(p), plane.origin) > search) continue;
    if (plane.height(mesh.position(mesh.to(h))) >= 0.0 || seen.count(h)) continue;
    Section section = cut_section(mesh, plane, TriangleMesh::triangle(h), kLongestSection);
    seen.insert(section.halfedge.begin(), section.halfedge.end());
    if (section.halfedge.empty() || farthest(section) > search) continue;
    Plane own = plane;
    own.origin = middle_of(section);
    if (winding(section, own) != int(theatre.matter)) continue;
    if (best.halfedge.empty() || farthest(section) < farthest(best)) best = std::move(section);
  }
  return best;
}

/// The closed curve of triangles about the critical point in the plane across the axis.
Section section_about(const TriangleMesh& mesh, const Theatre& theatre, const Plane& plane) {
  constexpr int kRays = 8;
  const DVec3 u = theatre.site.before.hessian.vectors[1], v = glm::cross(plane.normal, u);
  const bool leaving = theatre.matter == Matter::solid;
  for (int i = 0; i < kRays; ++i) {
    const double angle = std::numbers::pi * i / kRays;
    const auto hits = line_hits(mesh, plane.origin, std::cos(angle) * u + std::sin(angle) * v, theatre.reach());
    const auto ahead = std::find_if(hits.begin(), hits.end(), [](const LineHit& hit) { return hit.distance > 0.0; });
    if (ahead != hits.end() && ahead->along == leaving) {
      Section section = section_at(mesh, plane, ahead->triangle);
      if (winding(section, plane) == int(theatre.matter)) return section;
    }
    if (ahead != hits.begin() && (ahead - 1)->along != leaving) {
      Section section = section_at(mesh, plane, (ahead - 1)->triangle);
      if (winding(section, plane) == int(theatre.matter)) return section;
    }
  }
  return section_near(mesh, theatre, plane);
}

/// One side of the cut: the vertex along which each crossing's border runs, and the tip of the cap.
struct CapSide {
  std::vector<Index> slot;  // a crossing
  Index tip = kNone;
};

/// The section's ends on one side: the vertex each crossing halfedge leaves from (or arrives at), and the number of the
/// run of equal ones it belongs to.
struct Runs {
  std::vector<Index> vertex;
  std::vector<std::size_t> run;
  std::size_t count = 0;
  bool simple = false;  // no vertex belongs to two runs
};

Runs runs_of(const TriangleMesh& mesh, const Section& section, bool above) {
  Runs runs;
  const std::size_t n = section.halfedge.size();
  for (const Index h : section.halfedge) runs.vertex.push_back(above ? mesh.from(h) : mesh.to(h));
  for (std::size_t k = 0; k < n; ++k) {
    if (k > 0 && runs.vertex[k] != runs.vertex[k - 1]) ++runs.count;
    runs.run.push_back(runs.count);
  }
  if (runs.vertex.front() == runs.vertex.back()) {  // the last run goes on in the first
    for (std::size_t& r : runs.run)
      if (r == runs.count) r = 0;
  } else {
    ++runs.count;
  }
  runs.count = std::max<std::size_t>(runs.count, 1);
  const std::set<Index> distinct(runs.vertex.begin(), runs.vertex.end());
  runs.simple = distinct.size() == runs.count;
  return runs;
}

/// Border of one side of the cut: the vertices there are, where they make a simple curve; else a new one for each of
/// their turns, or for each crossing where even those are too few.
CapSide cap_side(const TriangleMesh& mesh, MeshPatch& patch, const Section& section, bool above, const DVec3& tip) {
  const Runs runs = runs_of(mesh, section, above);
  CapSide side;
  if (runs.count >= 3 && runs.simple) {
    side.slot = runs.vertex;
  } else {
    std::map<std::size_t, Index> of_slot;
    for (std::size_t k = 0; k < runs.vertex.size(); ++k) {
      const std::size_t slot = runs.count >= 3 ? runs.run[k] : k;
      const auto [it, fresh] = of_slot.try_emplace(slot, kNone);
      if (fresh) it->second = patch.add_vertex(0.5 * (section.point[k] + tip), {runs.vertex[k]});
      side.slot.push_back(it->second);
    }
  }
  side.tip = patch.add_vertex(tip, runs.vertex);
  return side;
}

/// The crossed triangles cut along the slots, and the fans.
void fill_cut(const TriangleMesh& mesh, MeshPatch& patch, const Section& section, const CapSide& high,
              const CapSide& low) {
  const std::size_t n = section.halfedge.size();
  for (std::size_t k = 0; k < n; ++k) {
    const Index h = section.halfedge[k], entered = section.halfedge[(k + 1) % n];
    const Index p = mesh.from(h), m = mesh.to(h), third = mesh.from(TriangleMesh::prev(h));
    const Index a = high.slot[k], a_next = high.slot[(k + 1) % n];
    const Index b = low.slot[k], b_next = low.slot[(k + 1) % n];
    if (mesh.from(entered) == third) {  // the third corner is above
      patch.add_triangle(p, a, a_next);
      patch.add_triangle(p, a_next, third);
      patch.add_triangle(b, m, b_next);
    } else {
      patch.add_triangle(p, a, a_next);
      patch.add_triangle(b, m, third);
      patch.add_triangle(b, third, b_next);
    }
    patch.add_triangle(a_next, a, high.tip);
    patch.add_triangle(b, b_next, low.tip);
  }
}

/// Where the cap's tip goes: on the surface along the axis, or the middle of the curve, a little to its side.
DVec3 tip_position(const Theatre& theatre, const Section& section, const DVec3& direction) {
  const bool open = theatre.filled(theatre.site.after.position) <= 0.0;
  const auto distance = open ? theatre.surface_along(direction) : std::nullopt;
  if (distance) return theatre.site.after.position + *distance * direction;
  return middle_of(section) + theatre.options.fall_back_ring * theatre.e() * direction;
}

/// Takes the cap's fan about the vertex `tip_id` farther out, over what the new surface leaves behind: triangles with a
/// corner less than `height` above the plane (or below it, for a negative one).
void widen_cap(TriangleMesh& mesh, const Theatre& theatre, const Plane& plane, Index tip_id, double height,
               SurgeryReport& report) {
  const auto& ids = mesh.vertices.id;
  const Index tip = Index(std::find(ids.begin(), ids.end(), tip_id) - ids.begin());
  std::vector<Index> fan;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (mesh.vertex[h] == tip) fan.push_back(TriangleMesh::triangle(h));
  const std::size_t before = fan.size();
  const std::vector<Index> disc = grow_disc(mesh, std::move(fan), [&](Index t) {
    double least = std::numeric_limits<double>::infinity();
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      const Vec3& p = mesh.position(mesh.vertex[h]);
      if (glm::distance(DVec3(p), plane.origin) > theatre.reach()) return false;
      least = std::min(least, plane.height(p) / height);
    }
    return least < 1.0;
  });
  if (disc.size() == before) return;
  MeshPatch patch(mesh);
  patch.remove(disc);
  for (const Index h : disc_border(mesh, disc)) patch.add_triangle(mesh.from(h), mesh.to(h), tip);
  if (!patch.apply(mesh)) return;
  report.triangles_removed += patch.triangles_removed();
  report.triangles_added += patch.triangles_added();
}

}  // namespace

SurgeryReport sever(TriangleMesh& mesh, const Theatre& theatre) {
  const Plane plane{theatre.site.before.position, theatre.axis_before()};
  const Section section = section_about(mesh, theatre, plane);
  if (section.halfedge.empty()) return refused("no ring of triangles goes around the critical point");
  const bool wide = std::any_of(section.point.begin(), section.point.end(),
                                [&](const DVec3& p) { return glm::distance(p, plane.origin) > theatre.reach(); });
  if (wide) return refused("the ring about the critical point is wider than the reach");
  MeshPatch patch(mesh);
  const DVec3 up = theatre.axis_after(), high_tip = tip_position(theatre, section, up),
              low_tip = tip_position(theatre, section, -up);
  const CapSide high = cap_side(mesh, patch, section, true, high_tip);
  const CapSide low = cap_side(mesh, patch, section, false, low_tip);
  fill_cut(mesh, patch, section, high, low);
  std::vector<Index> ring;
  for (const Index h : section.halfedge) ring.push_back(TriangleMesh::triangle(h));
  patch.remove(ring);
  const Index high_id = mesh.next_id + high.tip - Index(mesh.vertex_count());
  const Index low_id = mesh.next_id + low.tip - Index(mesh.vertex_count());
  SurgeryReport report = applied(mesh, patch);
  if (!report) return report;
  const DVec3 after = theatre.site.after.position;
  widen_cap(mesh, theatre, plane, high_id, glm::dot(high_tip - after, up), report);
  widen_cap(mesh, theatre, plane, low_id, glm::dot(low_tip - after, up), report);
  return report;
}

}  // namespace isoskin::surgery
