// The ring of triangles about a saddle is taken away and both sides are capped.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <vector>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/annulus.h"
#include "core/topology/mesh_probe.h"
#include "core/topology/section_cut.h"
#include "core/topology/surgery_theatre.h"

namespace isoskin::surgery {
namespace {

double farthest(const Section& section, const DVec3& from) {
  double most = 0.0;
  for (const DVec3& p : section.point) most = std::max(most, glm::distance(p, from));
  return most;
}

/// Those that leave a vertex no farther than this from the point, ascending.
std::vector<Index> halfedges_about(const TriangleMesh& mesh, const DVec3& point, double distance) {
  return indices_where(mesh.vertex.size(), [&](Index h) {
    const DVec3 x = DVec3(mesh.position(mesh.from(h))) - point;
    return glm::dot(x, x) <= distance * distance;
  });
}

/// All sections of the plane through halfedges `about` within reach of its origin, each once, in their order.
std::vector<Section> sections_within_reach(const TriangleMesh& mesh, const std::vector<Index>& about,
                                           const Theatre& theatre, const Plane& plane) {
  constexpr std::size_t kLongest = 4096;
  const double reach2 = theatre.reach() * theatre.reach();
  std::vector<Section> sections;
  std::set<Index> seen;
  for (const Index h : about) {
    const Vec3& p = mesh.position(mesh.from(h));
    const DVec3 x = DVec3(p) - plane.origin;
    const bool crossed =
        glm::dot(x, x) <= reach2 && plane.height(p) >= 0.0 && plane.height(mesh.position(mesh.to(h))) < 0.0;
    if (!crossed || seen.count(h)) continue;
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
/// Of several the one that stays nearest. `about`: as sections_within_reach() has it.
Section section_about(const TriangleMesh& mesh, const std::vector<Index>& about, const Theatre& theatre,
                      const Plane& plane) {
  const double search = theatre.options.search * theatre.e();
  Section best;
  bool best_encloses = false;
  double least = theatre.reach();
  for (Section& section : sections_within_reach(mesh, about, theatre, plane)) {
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

/// True when nothing is left of what the curve encloses in the field to follow, seen along its spokes.
bool is_clear(const Section& section, const Theatre& theatre) {
  constexpr double kAlong[] = {0.3, 0.6, 0.9};
  const DVec3 &from = theatre.site.before.position, &to = theatre.site.after.position;
  return std::all_of(section.point.begin(), section.point.end(), [&](const DVec3& p) {
    return std::all_of(std::begin(kAlong), std::end(kAlong),
                       [&](double along) { return theatre.filled(to + along * (p - from)) <= 0.0; });
  });
}

struct Cut {
  Plane plane;
  Section section;
  bool straight = true;  // the plane is the one across the axis
};

/// In the plane across the axis, else in the planes tilted out of it or moved along it a little whose curve stays
/// nearest: beside a neck just short of breaking runs a gap that the plane may leave where it bends.
Cut cut_about(const TriangleMesh& mesh, const Theatre& theatre) {
  constexpr double kTilts[] = {0.25, 0.5, 0.8}, kShifts[] = {0.0, -0.25, 0.25, -0.5, 0.5};  // tangents; of e
  constexpr int kDirections = 8;
  constexpr double kFarthest = 4.0, kLongestEdge = 2.0;  // of e
  const DVec3 origin = theatre.site.before.position, axis = theatre.axis_before();
  Cut best{{origin, axis}, {}};
  best.section = section_about(mesh, halfedges_about(mesh, origin, theatre.reach()), theatre, best.plane);
  if (!best.section.halfedge.empty()) return best;
  const DVec3 u = theatre.site.before.hessian.vectors[1], v = glm::cross(axis, u);
  std::vector<Plane> planes;
  for (const double shift : kShifts) {
    const DVec3 moved = origin + shift * theatre.e() * axis;
    if (shift != 0.0) planes.push_back({moved, axis});
    for (const double tilt : kTilts)
      for (int i = 0; i < kDirections; ++i) {
        const double angle = 2.0 * std::numbers::pi * i / kDirections;
        planes.push_back({moved, glm::normalize(axis + tilt * (std::cos(angle) * u + std::sin(angle) * v))});
      }
  }
  const std::vector<Index> about = halfedges_about(mesh, origin, (kFarthest + kLongestEdge) * theatre.e());
  std::vector<Section> sections(planes.size());
  std::vector<double> far(planes.size(), kFarthest * theatre.e());
  for_each_heavy(planes.size(), [&](std::size_t i) {
    sections[i] = section_about(mesh, about, theatre, planes[i]);
    const bool goes_round = !sections[i].halfedge.empty() && farthest(sections[i], origin) < far[i] &&
                            winding(sections[i], planes[i]) == int(theatre.matter) && is_clear(sections[i], theatre);
    if (goes_round) far[i] = farthest(sections[i], origin);
  });
  const std::size_t nearest = std::size_t(std::min_element(far.begin(), far.end()) - far.begin());
  if (far[nearest] < kFarthest * theatre.e()) best = {planes[nearest], std::move(sections[nearest]), false};
  return best;
}

/// Where the cap's tip goes, `side` 1 above the plane, -1 below: on the new surface along the axis. That must be nearer
/// than the end of the matter that is there now, else all of this matter is about to go and half way to its end from
/// the `middle` of the cut does.
struct Tip {
  DVec3 position{0.0};
  double height = 0.0;  // above the plane, positive on either side
  bool on_surface = false;
};

Tip tip_on(const TriangleMesh& mesh, const Theatre& theatre, const DVec3& middle, double side) {
  const DVec3 up = side * theatre.axis_after();
  const auto hits = line_hits(mesh, theatre.site.before.position, side * theatre.axis_before(), theatre.reach());
  const auto end = std::find_if(hits.begin(), hits.end(), [](const LineHit& hit) { return hit.distance > 0.0; });
  const double matter = end == hits.end() ? theatre.reach() : end->distance;
  const bool open = theatre.filled(theatre.site.after.position) <= 0.0;
  const auto distance = open ? theatre.surface_along(up) : std::nullopt;
  if (distance && *distance < matter) return {theatre.site.after.position + *distance * up, *distance, true};
  const double height = std::min(theatre.options.fall_back_ring * theatre.e(), 0.5 * matter);
  return {middle + height * up, height, false};
}

/// Whether the section goes round the plane's origin, or passes it within `distance`.
bool is_about(const Section& section, const Plane& plane, double distance) {
  const std::vector<DVec3>& points = section.point;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const DVec3 p = points[k] - plane.origin, d = points[(k + 1) % points.size()] - points[k];
    const double length2 = glm::dot(d, d), t = length2 > 0.0 ? std::clamp(-glm::dot(p, d) / length2, 0.0, 1.0) : 0.0;
    if (glm::length(p + t * d) < distance) return true;
  }
  return winding(section, plane) != 0;
}

/// Takes the cap's fan about the vertex `tip_id` farther out, over the stump that the new surface leaves behind:
/// triangles with a corner less than `height` from the plane on this side that lies, seen along the axis, within the
/// section or no farther beside it than the height. A tunnel may be a long slit.
void widen_cap(TriangleMesh& mesh, const Theatre& theatre, const Plane& plane, const Section& section, Index tip_id,
               double side, double height, SurgeryReport& report) {
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
      left |=
          side * above < height && is_about(section, {plane.origin + x - above * plane.normal, plane.normal}, height);
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

/// Where the skin round the critical point is crumpled, or hangs over into what lies beside it, no plane goes round it:
/// all that is about the point is taken away, and the borders left are closed.
SurgeryReport sever_crumpled(TriangleMesh& mesh, const Theatre& theatre) {
  constexpr double kNearest = 0.5, kFarthest = 3.0, kStep = 0.25;  // of e
  std::vector<double> radii;
  for (double radius = kNearest; radius <= kFarthest; radius += kStep) radii.push_back(radius * theatre.e());
  const auto annulus =
      annulus_about(mesh, {theatre.site.before.position, theatre.axis_before()}, int(theatre.matter), radii);
  if (!annulus) return refused("no ring of triangles goes around the critical point");
  MeshPatch patch(mesh);
  patch.remove(annulus->triangle);
  for (const double side : {1.0, -1.0}) {
    std::vector<Index> around;
    DVec3 sum(0.0);
    for (const Index h : annulus->border[side < 0.0]) {
      around.push_back(mesh.from(h));
      sum += DVec3(mesh.position(mesh.from(h)));
    }
    const Tip tip = tip_on(mesh, theatre, sum / double(around.size()), side);
    const Index centre = patch.add_vertex(tip.position, around);
    for (const Index h : annulus->border[side < 0.0]) patch.add_triangle(mesh.from(h), mesh.to(h), centre);
  }
  return applied(mesh, patch);
}

}  // namespace

SurgeryReport sever(TriangleMesh& mesh, const Theatre& theatre) {
  const auto [plane, section, straight] = cut_about(mesh, theatre);
  if (section.halfedge.empty()) return sever_crumpled(mesh, theatre);
  MeshPatch patch(mesh);
  const Tip tip[2] = {tip_on(mesh, theatre, middle_of(section), 1.0), tip_on(mesh, theatre, middle_of(section), -1.0)};
  const auto [high, low] = cut_and_cap(mesh, patch, section, tip[0].position, tip[1].position);
  const Index high_id = mesh.next_id + high - Index(mesh.vertex_count());
  const Index low_id = mesh.next_id + low - Index(mesh.vertex_count());
  SurgeryReport report = applied(mesh, patch);
  if (!report) return report;
  if (!straight) return report;  // the caps are large already
  if (tip[0].on_surface) widen_cap(mesh, theatre, plane, section, high_id, 1.0, tip[0].height, report);
  if (tip[1].on_surface) widen_cap(mesh, theatre, plane, section, low_id, -1.0, tip[1].height, report);
  return report;
}

}  // namespace isoskin::surgery
