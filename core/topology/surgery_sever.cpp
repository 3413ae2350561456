// The ring of triangles about a saddle is taken away and both sides are capped.
#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "core/parallel.h"
#include "core/topology/mesh_probe.h"
#include "core/topology/surgery_theatre.h"

namespace isoskin::surgery {
namespace {

DVec3 middle_of(const Section& section) {
  DVec3 sum(0.0);
  for (const DVec3& p : section.point) sum += p;
  return sum / double(section.point.size());
}

double farthest(const Section& section, const DVec3& from) {
  double most = 0.0;
  for (const DVec3& p : section.point) most = std::max(most, glm::distance(p, from));
  return most;
}

/// All sections of the plane that pass the critical point within reach, each once. Halfedges in order, so the result
/// is.
std::vector<Section> sections_within_reach(const TriangleMesh& mesh, const Theatre& theatre, const Plane& plane) {
  constexpr std::size_t kLongest = 4096;
  std::vector<std::uint8_t> crossed(mesh.vertex.size());
  const double reach2 = theatre.reach() * theatre.reach();
  for_each_index(crossed.size(), [&](std::size_t h) {
    const Vec3& p = mesh.position(mesh.from(Index(h)));
    const DVec3 x = DVec3(p) - plane.origin;
    crossed[h] =
        glm::dot(x, x) <= reach2 && plane.height(p) >= 0.0 && plane.height(mesh.position(mesh.to(Index(h)))) < 0.0;
  });
  std::vector<Section> sections;
  std::set<Index> seen;
  for (Index h = 0; h < crossed.size(); ++h) {
    if (!crossed[h] || seen.count(h)) continue;
    sections.push_back(cut_section(mesh, plane, TriangleMesh::triangle(h), kLongest));
    if (sections.back().halfedge.empty()) {
      sections.pop_back();
      continue;
    }
    seen.insert(sections.back().halfedge.begin(), sections.back().halfedge.end());
  }
  return sections;
}

/// True when the field to follow leaves the curve, moved along with the critical point: its matter is gone there, at
/// least half as clearly as at the critical point, which is the last to go in its plane. Other curves lie on surfaces
/// that stay.
bool is_left(const Section& section, const Theatre& theatre) {
  const double there = theatre.filled(theatre.site.after.position);
  if (there > 0.0) return true;  // it has come back meanwhile: the field says nothing
  const DVec3 motion = theatre.site.after.position - theatre.site.before.position;
  return std::all_of(section.point.begin(), section.point.end(),
                     [&](const DVec3& p) { return theatre.filled(p + motion) <= 0.5 * there; });
}

/// The curve of triangles about the critical point in the plane across the axis: it goes round matter, round the point
/// (or, on a coarse mesh, where a thin neck may have strayed from it, not farther than `search` from it), and is left.
/// Of several the one that stays nearest.
Section section_about(const TriangleMesh& mesh, const Theatre& theatre, const Plane& plane) {
  const double search = theatre.options.search * theatre.e();
  Section best;
  bool best_encloses = false;
  double least = theatre.reach();
  for (Section& section : sections_within_reach(mesh, theatre, plane)) {
    const double far = farthest(section, plane.origin);
    Plane own = plane;
    own.origin = middle_of(section);
    const bool encloses = winding(section, plane) == int(theatre.matter);
    if (!encloses && (far > search || winding(section, own) != int(theatre.matter))) continue;
    if (encloses < best_encloses || (encloses == best_encloses && far >= least) || far > theatre.reach()) continue;
    if (!is_left(section, theatre)) continue;
    best = std::move(section);
    best_encloses = encloses;
    least = far;
  }
  return best;
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

/// Where the cap's tip goes, `side` 1 above the plane, -1 below: on the new surface along the axis. That must be nearer
/// than the end of the matter that is there now, else all of this matter is about to go and half way to its end does.
struct Tip {
  DVec3 position{0.0};
  double height = 0.0;  // above the plane, positive on either side
  bool on_surface = false;
};

Tip tip_on(const TriangleMesh& mesh, const Theatre& theatre, const Section& section, double side) {
  const DVec3 up = side * theatre.axis_after();
  const auto hits = line_hits(mesh, theatre.site.before.position, side * theatre.axis_before(), theatre.reach());
  const auto end = std::find_if(hits.begin(), hits.end(), [](const LineHit& hit) { return hit.distance > 0.0; });
  const double matter = end == hits.end() ? theatre.reach() : end->distance;
  const bool open = theatre.filled(theatre.site.after.position) <= 0.0;
  const auto distance = open ? theatre.surface_along(up) : std::nullopt;
  if (distance && *distance < matter) return {theatre.site.after.position + *distance * up, *distance, true};
  const double height = std::min(theatre.options.fall_back_ring * theatre.e(), 0.5 * matter);
  return {middle_of(section) + height * up, height, false};
}

/// Takes the cap's fan about the vertex `tip_id` farther out, over the stump that the new surface leaves behind:
/// triangles with a corner less than `height` from the plane on this side, not farther from the axis than the section
/// and as much again as the height.
void widen_cap(TriangleMesh& mesh, const Theatre& theatre, const Plane& plane, Index tip_id, double side, double height,
               double section_radius, SurgeryReport& report) {
  const auto& ids = mesh.vertices.id;
  const Index tip = Index(std::find(ids.begin(), ids.end(), tip_id) - ids.begin());
  std::vector<Index> fan;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (mesh.vertex[h] == tip) fan.push_back(TriangleMesh::triangle(h));
  const std::size_t before = fan.size();
  const std::vector<Index> disc = grow_disc(mesh, std::move(fan), [&](Index t) {
    bool left = false;
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      const DVec3 x = DVec3(mesh.position(mesh.vertex[h])) - plane.origin;
      const double above = glm::dot(x, plane.normal);
      if (glm::length(x) > theatre.reach()) return false;
      left |= side * above < height && glm::length(x - above * plane.normal) < section_radius + height;
    }
    return left;
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
  MeshPatch patch(mesh);
  const Tip tip[2] = {tip_on(mesh, theatre, section, 1.0), tip_on(mesh, theatre, section, -1.0)};
  const CapSide high = cap_side(mesh, patch, section, true, tip[0].position);
  const CapSide low = cap_side(mesh, patch, section, false, tip[1].position);
  fill_cut(mesh, patch, section, high, low);
  std::vector<Index> ring;
  for (const Index h : section.halfedge) ring.push_back(TriangleMesh::triangle(h));
  patch.remove(ring);
  const Index high_id = mesh.next_id + high.tip - Index(mesh.vertex_count());
  const Index low_id = mesh.next_id + low.tip - Index(mesh.vertex_count());
  SurgeryReport report = applied(mesh, patch);
  if (!report) return report;
  const double radius = farthest(section, plane.origin);
  if (tip[0].on_surface) widen_cap(mesh, theatre, plane, high_id, 1.0, tip[0].height, radius, report);
  if (tip[1].on_surface) widen_cap(mesh, theatre, plane, low_id, -1.0, tip[1].height, radius, report);
  return report;
}

}  // namespace isoskin::surgery
