#include "core/topology/surgery.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>

#include "core/topology/mesh_patch.h"
#include "core/topology/mesh_probe.h"

namespace isoskin {
namespace {

/// Which way round: `solid` as the operation's name says, `hollow` with inside and outside exchanged.
enum class Matter : int { solid = 1, hollow = -1 };

double sign(Matter matter) {
  return double(int(matter));
}

SurgeryReport refused(const char* reason) {
  SurgeryReport report;
  report.reason = reason;
  return report;
}

SurgeryReport applied(TriangleMesh& mesh, const MeshPatch& patch) {
  if (!patch.apply(mesh)) return refused("the new triangles do not fit");
  SurgeryReport report;
  report.done = true;
  report.vertices_added = patch.vertices_added();
  report.triangles_added = patch.triangles_added();
  report.triangles_removed = patch.triangles_removed();
  return report;
}

/// What all operations share: the site with its axis, the field, and lengths in world units.
struct Theatre {
  const SurgerySite& site;
  const Field& field;
  const SurgeryOptions& options;
  Matter matter;

  double e() const { return options.edge_length; }
  double reach() const { return options.reach * options.edge_length; }
  /// The eigenvector of the one eigenvalue whose sign differs from the other two.
  DVec3 axis(const CriticalPoint& point) const { return point.hessian.vectors[matter == Matter::solid ? 2 : 0]; }
  DVec3 axis_before() const { return axis(site.before); }
  DVec3 axis_after() const {
    const DVec3 a = axis(site.after);
    return glm::dot(a, axis_before()) < 0.0 ? -a : a;
  }
  /// Two unit vectors across the axis after; with the axis they are right-handed.
  std::pair<DVec3, DVec3> across_after() const {
    const DVec3 u = site.after.hessian.vectors[1];
    return {u, glm::cross(axis_after(), u)};
  }
  /// Positive where there is matter: inside for solid, outside for hollow.
  double filled(const DVec3& p) const { return sign(matter) * field.value(p); }
  /// Distance from the critical point after, along `direction`, to the surface; nothing within reach.
  std::optional<double> surface_along(const DVec3& direction) const {
    constexpr double kStep = 0.1;  // of e
    constexpr int kHalvings = 40;
    const DVec3& origin = site.after.position;
    const bool start = filled(origin) > 0.0;
    for (double far = kStep * e(); far <= reach(); far += kStep * e()) {
      if ((filled(origin + far * direction) > 0.0) == start) continue;
      double low = far - kStep * e(), high = far;
      for (int i = 0; i < kHalvings; ++i) {
        const double middle = 0.5 * (low + high);
        ((filled(origin + middle * direction) > 0.0) == start ? low : high) = middle;
      }
      return 0.5 * (low + high);
    }
    return std::nullopt;
  }
};

// ---- create and destroy -------------------------------------------------------------------------------------------

/// Directions of an octahedron's corners, each triangle cut in four `levels` times.
struct Octahedron {
  std::vector<DVec3> direction{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  std::vector<std::array<Index, 3>> triangle{{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                             {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};

  void subdivide() {
    std::map<std::pair<Index, Index>, Index> middles;
    const auto middle = [&](Index a, Index b) {
      const auto [it, fresh] = middles.try_emplace(std::minmax(a, b), Index(direction.size()));
      if (fresh) direction.push_back(glm::normalize(direction[a] + direction[b]));
      return it->second;
    };
    std::vector<std::array<Index, 3>> finer;
    for (const auto& [a, b, c] : triangle) {
      const Index ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    triangle = std::move(finer);
  }
};

/// Points of the surface in the octahedron's directions, turned to the Hessian's axes; nothing if one is out of reach.
std::optional<std::vector<DVec3>> shell_points(const Theatre& theatre, const Octahedron& shape) {
  std::vector<DVec3> points;
  for (const DVec3& d : shape.direction) {
    const DVec3 direction = theatre.site.after.hessian.vectors * d;
    const auto distance = theatre.surface_along(direction);
    if (!distance) return std::nullopt;
    points.push_back(theatre.site.after.position + *distance * direction);
  }
  return points;
}

double longest_edge_of(const Octahedron& shape, const std::vector<DVec3>& points) {
  double longest = 0.0;
  for (const auto& corner : shape.triangle)
    for (int k = 0; k < 3; ++k)
      longest = std::max(longest, glm::distance(points[corner[k]], points[corner[(k + 1) % 3]]));
  return longest;
}

SurgeryReport make_shell(TriangleMesh& mesh, const Theatre& theatre) {
  if (!(theatre.filled(theatre.site.after.position) > 0.0)) return refused("the new piece is gone again");
  constexpr double kLongest = 1.5;  // of e
  constexpr int kLevels = 5;
  Octahedron shape;
  auto points = shell_points(theatre, shape);
  for (int level = 0; points && level < kLevels && longest_edge_of(shape, *points) > kLongest * theatre.e(); ++level) {
    shape.subdivide();
    points = shell_points(theatre, shape);
  }
  if (!points) return refused("the new piece is larger than the reach");
  MeshPatch patch(mesh);
  std::vector<Index> vertex;
  for (const DVec3& p : *points) vertex.push_back(patch.add_vertex(p, {}));
  for (auto [a, b, c] : shape.triangle) {
    if (theatre.matter == Matter::hollow) std::swap(b, c);
    patch.add_triangle(vertex[a], vertex[b], vertex[c]);
  }
  return applied(mesh, patch);
}

/// The piece that encloses the critical point, told by two rays; kNone when none does. Returns one of its triangles.
Index enclosing_triangle(const TriangleMesh& mesh, const Theatre& theatre) {
  const bool leaving = theatre.matter == Matter::solid;
  for (int axis = 0; axis < 3; ++axis) {
    const auto hits =
        line_hits(mesh, theatre.site.before.position, theatre.site.before.hessian.vectors[axis], theatre.reach());
    const auto ahead = std::find_if(hits.begin(), hits.end(), [](const LineHit& hit) { return hit.distance > 0.0; });
    if (ahead == hits.begin() || ahead == hits.end()) continue;
    const LineHit &front = *ahead, &back = *(ahead - 1);
    if (front.along != leaving || back.along == leaving) continue;
    const std::vector<Index> piece = piece_of(mesh, front.triangle);
    if (std::binary_search(piece.begin(), piece.end(), back.triangle)) return front.triangle;
  }
  return kNone;
}

/// A triangle of the vertex nearest to the critical point: a piece a few triangles large may not enclose it.
Index nearest_triangle(const TriangleMesh& mesh, const Theatre& theatre) {
  const Vec3 at(theatre.site.before.position);
  Index nearest = kNone;
  float least = float(theatre.options.search * theatre.e());
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    const float distance = glm::distance(mesh.position(mesh.vertex[h]), at);
    if (distance < least) {
      least = distance;
      nearest = TriangleMesh::triangle(h);
    }
  }
  return nearest;
}

struct PieceShape {
  int euler = 0;
  double volume = 0.0;
  double diagonal = 0.0;
};

PieceShape shape_of(const TriangleMesh& mesh, const std::vector<Index>& piece) {
  PieceShape shape;
  std::set<Index> vertices;
  Box box;
  for (const Index t : piece) {
    DVec3 p[3];
    for (Index k = 0; k < 3; ++k) {
      const Index v = mesh.vertex[3 * t + k];
      vertices.insert(v);
      p[k] = DVec3(mesh.position(v));
      box.add(p[k]);
    }
    shape.volume += glm::dot(p[0], glm::cross(p[1], p[2])) / 6.0;
  }
  shape.euler = int(vertices.size()) - int(piece.size()) / 2;  // three halfedges a triangle, two an edge
  shape.diagonal = box.diagonal();
  return shape;
}

SurgeryReport remove_shell(TriangleMesh& mesh, const Theatre& theatre) {
  Index triangle = enclosing_triangle(mesh, theatre);
  const bool enclosed = triangle != kNone;
  if (!enclosed) triangle = nearest_triangle(mesh, theatre);
  if (triangle == kNone) return refused("no piece encloses the critical point");
  const std::vector<Index> piece = piece_of(mesh, triangle);
  const PieceShape shape = shape_of(mesh, piece);
  if (shape.euler != 2) return refused("the piece about the critical point is not a sphere");
  if (sign(theatre.matter) * shape.volume < 0.0) return refused("the piece about the critical point is inside out");
  const double small = 2.0 * theatre.options.search * theatre.e();
  if (!enclosed && shape.diagonal > small) return refused("no piece encloses the critical point");
  MeshPatch patch(mesh);
  patch.remove(piece);
  return applied(mesh, patch);
}

// ---- connect and pierce -------------------------------------------------------------------------------------------

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

/// Triangles between the hole's border `loop` and the ring, both the same way round; `at` gives positions with both
/// loops about the origin. Steps on both keep pace, from the start that keeps facing corners nearest.
template <class At>
void weave(MeshPatch& patch, const Loop& loop, const Loop& ring, const At& at) {
  const std::size_t n = loop.size(), m = ring.size();
  std::size_t start = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t s = 0; s < m; ++s) {
    double sum = 0.0;
    for (std::size_t i = 0; i < n; ++i) sum += glm::distance(at(loop[i]), at(ring[(s + i * m / n) % m]));
    if (sum < least) {
      least = sum;
      start = s;
    }
  }
  std::size_t i = 0, j = 0;
  while (i < n || j < m) {
    const Index p = loop[i % n], q = ring[(start + j) % m];
    if (j == m || (i < n && (i + 1) * m <= (j + 1) * n)) {
      patch.add_triangle(p, loop[(i + 1) % n], q);
      ++i;
    } else {
      patch.add_triangle(ring[(start + j + 1) % m], q, p);
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

DVec3 middle_of(const TriangleMesh& mesh, const Loop& loop) {
  DVec3 sum(0.0);
  for (const Index v : loop) sum += DVec3(mesh.position(v));
  return sum / double(loop.size());
}

SurgeryReport join(TriangleMesh& mesh, const Theatre& theatre) {
  const auto gap = gap_along(mesh, theatre);
  if (!gap) return refused("no two sheets face each other across the critical point");
  constexpr int kProbes = 8, kMost = 48;
  const std::vector<double> probe = waist(theatre, kProbes);
  const double radius = std::accumulate(probe.begin(), probe.end(), 0.0) / kProbes;
  const double disc_radius = std::min(radius, theatre.options.widest_disc * theatre.e());

  std::vector<Index> disc[2];
  for (const double r : {disc_radius, 0.0}) {
    disc[0] = grow_disc(mesh, gap->first.triangle, theatre.site.before.position, theatre.axis_before(), r);
    disc[1] = grow_disc(mesh, gap->second.triangle, theatre.site.before.position, theatre.axis_before(), r);
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
  std::vector<DVec3> ring_offset;
  for (int i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    ring_offset.push_back(r[i] * (std::cos(angle) * u + std::sin(angle) * v));
    ring.push_back(patch.add_vertex(theatre.site.after.position + ring_offset.back(), around));
  }
  const Index first_ring = ring.front();
  // The first sheet's border turns about the axis as the ring does where its outside looks along the axis (a solid),
  // the second sheet's the other way.
  for (int side = 0; side < 2; ++side) {
    const DVec3 middle = middle_of(mesh, loop[side]);
    const auto at = [&](Index w) {
      return w < first_ring ? DVec3(mesh.position(w)) - middle : ring_offset[w - first_ring];
    };
    const bool same_way = (side == 0) == (theatre.matter == Matter::solid);
    const Loop turned = same_way ? ring : Loop(ring.rbegin(), ring.rend());
    weave(patch, loop[side], turned, at);
    patch.remove(disc[side]);
  }
  return applied(mesh, patch);
}

// ---- cut and spackle ----------------------------------------------------------------------------------------------

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

SurgeryReport sever(TriangleMesh& mesh, const Theatre& theatre) {
  const Plane plane{theatre.site.before.position, theatre.axis_before()};
  const Section section = section_about(mesh, theatre, plane);
  if (section.halfedge.empty()) return refused("no ring of triangles goes around the critical point");
  const bool wide = std::any_of(section.point.begin(), section.point.end(),
                                [&](const DVec3& p) { return glm::distance(p, plane.origin) > theatre.reach(); });
  if (wide) return refused("the ring about the critical point is wider than the reach");
  MeshPatch patch(mesh);
  const DVec3 up = theatre.axis_after();
  const CapSide high = cap_side(mesh, patch, section, true, tip_position(theatre, section, up));
  const CapSide low = cap_side(mesh, patch, section, false, tip_position(theatre, section, -up));
  fill_cut(mesh, patch, section, high, low);
  std::vector<Index> ring;
  for (const Index h : section.halfedge) ring.push_back(TriangleMesh::triangle(h));
  patch.remove(ring);
  return applied(mesh, patch);
}

}  // namespace

SurgeryReport create_component(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                               const SurgeryOptions& options) {
  return make_shell(mesh, {site, field, options, Matter::solid});
}

SurgeryReport destroy_component(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                                const SurgeryOptions& options) {
  return remove_shell(mesh, {site, field, options, Matter::solid});
}

SurgeryReport connect(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return join(mesh, {site, field, options, Matter::solid});
}

SurgeryReport cut(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return sever(mesh, {site, field, options, Matter::solid});
}

SurgeryReport pierce(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return join(mesh, {site, field, options, Matter::hollow});
}

SurgeryReport spackle(TriangleMesh& mesh, const SurgerySite& site, const Field& field, const SurgeryOptions& options) {
  return sever(mesh, {site, field, options, Matter::hollow});
}

SurgeryReport open_bubble(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                          const SurgeryOptions& options) {
  return make_shell(mesh, {site, field, options, Matter::hollow});
}

SurgeryReport burst_bubble(TriangleMesh& mesh, const SurgerySite& site, const Field& field,
                           const SurgeryOptions& options) {
  return remove_shell(mesh, {site, field, options, Matter::hollow});
}

}  // namespace isoskin
