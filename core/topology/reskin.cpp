#include "core/topology/reskin.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <queue>
#include <set>
#include <span>
#include <unordered_map>

#include "core/mesh/validate.h"
#include "core/parallel.h"
#include "core/sampling/closest_point.h"

namespace isoskin {
namespace {

/// Points in a hash grid of cells as wide as the search radius.
class PointGrid {
public:
  PointGrid(const std::vector<Vec3>& points, float radius) : points_(points), radius_(radius) {
    for (Index i = 0; i < points.size(); ++i) cells_[key(cell(points[i]))].push_back(i);
  }

  /// Calls function(index, squared distance) for every point nearer than the radius.
  template <class Function>
  void near(const Vec3& p, Function&& function) const {
    visit(p, [&](Index i, float square) {
      function(i, square);
      return false;
    });
  }

  bool any_near(const Vec3& p) const {
    return visit(p, [](Index, float) { return true; });
  }

private:
  /// Visits the points nearer than the radius until `visitor` returns true; whether it did.
  template <class Visitor>
  bool visit(const Vec3& p, const Visitor& visitor) const {
    const IVec3 c = cell(p);
    for (int n = 0; n < 27; ++n) {
      const auto it = cells_.find(key(c + IVec3(n / 9 - 1, (n / 3) % 3 - 1, n % 3 - 1)));
      if (it == cells_.end()) continue;
      for (const Index i : it->second) {
        const Vec3 d = points_[i] - p;
        if (const float square = glm::dot(d, d); square <= radius_ * radius_ && visitor(i, square)) return true;
      }
    }
    return false;
  }

  IVec3 cell(const Vec3& p) const { return IVec3(glm::floor(p / radius_)); }
  static std::uint64_t key(const IVec3& c) {
    return (std::uint64_t(std::uint32_t(c.x)) * 73856093u) ^ (std::uint64_t(std::uint32_t(c.y)) << 32) ^
           (std::uint64_t(std::uint32_t(c.z)) * 83492791u << 16);
  }

  const std::vector<Vec3>& points_;
  float radius_;
  std::unordered_map<std::uint64_t, std::vector<Index>> cells_;
};

std::vector<Vec3> field_normals(const std::vector<Vec3>& points, Backend& backend) {
  std::vector<float> values(points.size());
  std::vector<Vec3> normals(points.size());
  backend.evaluate(points, values, normals);
  for (Vec3& n : normals) {
    const float length = glm::length(n);
    n = length > 0.0f ? -n / length : Vec3(0.0f);
  }
  return normals;
}

/// The lattice's surface near the emptied region, with what the seams need to know of it.
struct Filling {
  OpenSurface surface;
  std::vector<Vec3> normal;
  std::vector<Index> first;  // per vertex: its edges in `edge`, CSR with gaps: count[v] are used
  std::vector<Index> count;
  struct Edge {
    Index to, triangle;  // the triangle with the halfedge to `to`; kNone on the outside of the filling's border
    bool operator<(const Edge& other) const { return to != other.to ? to < other.to : triangle < other.triangle; }
  };
  std::vector<Edge> edge;

  std::span<const Edge> edges(Index v) const { return {edge.data() + first[v], count[v]}; }
  Index triangle(Index from, Index to) const {
    for (const Edge& e : edges(from))
      if (e.to == to) return e.triangle;
    return kNone;
  }
};

Filling make_filling(OpenSurface surface, Backend& backend) {
  Filling filling;
  filling.surface = std::move(surface);
  const auto& s = filling.surface;
  filling.normal = field_normals(s.position, backend);
  filling.first.assign(s.position.size() + 1, 0);
  for (const Index v : s.triangle) filling.first[v] += 2;  // each halfedge is seen from both of its ends
  Index sum = 0;
  for (Index& f : filling.first) sum += std::exchange(f, sum);
  filling.edge.resize(sum);
  filling.count.assign(s.position.size(), 0);
  const auto add = [&](Index from, Index to, Index triangle) {
    filling.edge[filling.first[from] + filling.count[from]++] = {to, triangle};
  };
  for (Index h = 0; h < s.triangle.size(); ++h) {
    const Index a = s.triangle[h], b = s.triangle[TriangleMesh::next(h)];
    add(a, b, h / 3);
    add(b, a, kNone);
  }
  for_each_index(s.position.size(), [&](std::size_t v) {
    const auto begin = filling.edge.begin() + filling.first[v], end = begin + filling.count[v];
    std::sort(begin, end);  // a triangle comes before kNone
    filling.count[v] =
        Index(std::unique(begin, end, [](const auto& p, const auto& q) { return p.to == q.to; }) - begin);
  });
  return filling;
}

std::uint64_t directed(Index from, Index to) {
  return (std::uint64_t(from) << 32) | to;
}

/// A border of the emptied region, as halfedges of removed triangles: the hole lies to their left.
struct Seam {
  std::vector<Index> halfedge;
  std::vector<std::vector<Index>> path;  // per halfedge: filling vertices from the snapped start to the snapped end
  bool failed = false;
};

/// Triangles to remove: those with a hot vertex, widened until every border is a simple closed curve.
std::vector<std::uint8_t> removed_triangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& hot) {
  std::vector<std::uint8_t> removed(mesh.triangle_count(), 0);
  for (Index h = 0; h < mesh.vertex.size(); ++h) removed[h / 3] |= hot[mesh.vertex[h]];
  const std::vector<Index> outgoing = outgoing_halfedges(mesh);
  for (bool widened = true; widened;) {
    widened = false;
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      int changes = 0;
      Index h = outgoing[v];
      do {
        changes += removed[h / 3] != removed[mesh.twin[h] / 3];
        h = mesh.turn(h);
      } while (h != outgoing[v]);
      if (changes <= 2) continue;
      do {
        removed[h / 3] = 1;
        h = mesh.turn(h);
      } while (h != outgoing[v]);
      widened = true;
    }
  }
  return removed;
}

std::vector<Seam> find_seams(const TriangleMesh& mesh, const std::vector<std::uint8_t>& removed) {
  std::vector<Seam> seams;
  std::vector<std::uint8_t> seen(mesh.vertex.size(), 0);
  const auto on_border = [&](Index h) { return removed[h / 3] && !removed[mesh.twin[h] / 3]; };
  for (Index start = 0; start < mesh.vertex.size(); ++start) {
    if (seen[start] || !on_border(start)) continue;
    Seam seam;
    Index h = start;
    do {
      seen[h] = 1;
      seam.halfedge.push_back(h);
      h = TriangleMesh::next(h);
      while (!on_border(h)) h = TriangleMesh::next(mesh.twin[h]);
    } while (h != start);
    seams.push_back(std::move(seam));
  }
  return seams;
}

/// Snaps border vertices to the filling: mesh vertex -> filling vertex. Marks seams that cannot.
std::unordered_map<Index, Index> snap(const TriangleMesh& mesh, std::vector<Seam>& seams, const Filling& filling,
                                      double spacing, Backend& backend) {
  constexpr float kReach = 2.0f, kAgree = 0.3f;  // in lattice spacings; cosine between normals
  const PointGrid grid(filling.surface.position, kReach * float(spacing));
  std::unordered_map<Index, Index> snapped;
  std::vector<std::uint8_t> taken(filling.surface.position.size(), 0);
  for (Seam& seam : seams) {
    std::vector<Vec3> points;
    for (const Index h : seam.halfedge) points.push_back(mesh.position(mesh.from(h)));
    const std::vector<Vec3> normals = field_normals(points, backend);
    for (std::size_t i = 0; i < points.size(); ++i) {
      std::pair<float, Index> best{std::numeric_limits<float>::infinity(), kNone};
      grid.near(points[i], [&](Index candidate, float square) {
        if (glm::dot(normals[i], filling.normal[candidate]) > kAgree && !taken[candidate])
          best = std::min(best, {square, candidate});
      });
      if (best.second == kNone) {
        seam.failed = true;
        break;
      }
      taken[best.second] = 1;
      snapped[mesh.from(seam.halfedge[i])] = best.second;
    }
  }
  return snapped;
}

/// Shortest path on the filling's edges from a to b that keeps near the straight line and off used vertices.
std::vector<Index> shortest_path(const Filling& filling, Index a, Index b, const std::vector<std::uint8_t>& used,
                                 float slack) {
  const auto& position = filling.surface.position;
  const Vec3 from = position[a], to = position[b];
  const float straight = glm::length(to - from);
  const auto off_line = [&](Index v) {
    const Vec3 d = position[v] - from, line = straight > 0.0f ? (to - from) / straight : Vec3(0.0f);
    return glm::length(d - glm::dot(d, line) * line);
  };
  using Entry = std::tuple<float, Index, Index>;  // cost, vertex, where it came from
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  std::unordered_map<Index, Index> came_from;
  open.emplace(0.0f, a, kNone);
  while (!open.empty()) {
    const auto [cost, v, before] = open.top();
    open.pop();
    if (!came_from.emplace(v, before).second) continue;
    if (v == b) {
      std::vector<Index> path;
      for (Index at = b; at != kNone; at = came_from[at]) path.push_back(at);
      std::reverse(path.begin(), path.end());
      return path;
    }
    for (const auto& [next, triangle] : filling.edges(v)) {
      if (came_from.count(next) || (used[next] && next != b)) continue;
      if (glm::length(position[next] - from) + glm::length(position[next] - to) > straight + slack) continue;
      open.emplace(cost + glm::length(position[next] - position[v]) + off_line(next), next, v);
    }
  }
  return {};
}

void trace_paths(const TriangleMesh& mesh, std::vector<Seam>& seams, const Filling& filling,
                 const std::unordered_map<Index, Index>& snapped, double spacing) {
  constexpr float kSlack = 4.0f;  // in lattice spacings: how much longer than the edge a path may be
  std::vector<std::uint8_t> used(filling.surface.position.size(), 0);
  for (const auto& [vertex, target] : snapped) used[target] = 1;
  for (Seam& seam : seams) {
    for (std::size_t i = 0; i < seam.halfedge.size() && !seam.failed; ++i) {
      const Index h = seam.halfedge[i];
      std::vector<Index> path =
          shortest_path(filling, snapped.at(mesh.from(h)), snapped.at(mesh.to(h)), used, kSlack * float(spacing));
      seam.failed = path.empty();
      for (const Index v : path) used[v] = 1;
      seam.path.push_back(std::move(path));
    }
  }
}

/// The filling's triangles on the hole's side of the seams. Seams whose flood runs out at the filling's own border, or
/// reaches the far side of a seam, fail.
std::vector<std::uint8_t> flood(const Filling& filling, std::vector<Seam>& seams) {
  const auto& triangle = filling.surface.triangle;
  const std::size_t count = triangle.size() / 3;
  std::unordered_map<std::uint64_t, Index> barrier;  // directed path edge -> seam
  std::vector<std::uint8_t> on_path(filling.surface.position.size(), 0);
  for (Index s = 0; s < seams.size(); ++s)
    if (!seams[s].failed)
      for (const auto& path : seams[s].path)
        for (std::size_t i = 0; i + 1 < path.size(); ++i) {
          barrier[directed(path[i], path[i + 1])] = s;
          on_path[path[i]] = on_path[path[i + 1]] = 1;
        }

  std::vector<std::uint8_t> inside(count, 0);
  for (Index s = 0; s < seams.size(); ++s) {
    if (seams[s].failed) continue;
    std::vector<Index> stack, region;
    std::set<Index> touched{s};
    bool leaks = false;
    const auto enter = [&](Index t) {
      if (t == kNone) {
        leaks = true;
      } else if (!inside[t]) {
        inside[t] = 1;
        stack.push_back(t);
        region.push_back(t);
      }
    };
    for (const auto& path : seams[s].path)
      for (std::size_t i = 0; i + 1 < path.size(); ++i) enter(filling.triangle(path[i], path[i + 1]));
    while (!stack.empty()) {
      const Index t = stack.back();
      stack.pop_back();
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        const Index a = triangle[h], b = triangle[TriangleMesh::next(h)];
        if (on_path[a] && on_path[b]) {
          if (const auto own = barrier.find(directed(a, b)); own != barrier.end()) {
            touched.insert(own->second);
            continue;
          }
          if (const auto other = barrier.find(directed(b, a)); other != barrier.end()) {
            touched.insert(other->second);  // came out on the wrong side of a seam
            leaks = true;
            continue;
          }
        }
        enter(filling.triangle(b, a));
      }
    }
    if (!leaks) continue;
    for (const Index t : region) inside[t] = 0;
    for (const Index other : touched) seams[other].failed = true;
  }
  return inside;
}

/// Closed pieces of the filling that failed and that no seam has reached: those without a mesh, and those whose mesh
/// was emptied.
void add_whole_pieces(const Filling& filling, const Certificate& certificate, const std::vector<std::uint8_t>& hot,
                      std::vector<std::uint8_t>& inside) {
  const auto& triangle = filling.surface.triangle;
  std::vector<std::uint8_t> seen = inside;
  for (Index start = 0; start < inside.size(); ++start) {
    if (seen[start]) continue;
    std::vector<Index> piece(1, start);
    seen[start] = 1;
    bool whole = true, emptied = false;
    for (std::size_t i = 0; i < piece.size(); ++i)
      for (Index h = 3 * piece[i]; h < 3 * piece[i] + 3; ++h) {
        const Index a = triangle[h], b = triangle[TriangleMesh::next(h)];
        const Index t = filling.triangle(b, a);
        emptied |= hot[a];
        whole &= t != kNone && !inside[t];
        if (t == kNone || seen[t]) continue;
        seen[t] = 1;
        piece.push_back(t);
      }
    const Fault fault = certificate.lattice_piece[filling.surface.piece[triangle[3 * start]]];
    if (whole && (fault == Fault::missing || (fault != Fault::none && emptied)))
      for (const Index t : piece) inside[t] = 2;
  }
}

/// Builds the welded mesh: kept triangles (their border edges subdivided along the paths) and the filling's part.
class Welder {
public:
  Welder(const TriangleMesh& mesh, const std::vector<std::uint8_t>& removed, const std::vector<Seam>& seams,
         const Filling& filling, const std::vector<std::uint8_t>& inside,
         const std::unordered_map<Index, Index>& snapped)
      : mesh_(mesh), filling_(filling) {
    for (const Seam& seam : seams)
      for (std::size_t i = 0; i < seam.halfedge.size(); ++i) path_[mesh.twin[seam.halfedge[i]]] = &seam.path[i];
    number_kept(removed);
    for (const auto& [vertex, target] : snapped) of_filling_[target] = kept_[vertex];
    for (Index t = 0; t < removed.size(); ++t)
      if (!removed[t]) add_kept(t);
    for (Index t = 0; t < inside.size(); ++t)
      if (inside[t])
        add(filling_vertex(filling.surface.triangle[3 * t]), filling_vertex(filling.surface.triangle[3 * t + 1]),
            filling_vertex(filling.surface.triangle[3 * t + 2]));
  }

  std::optional<TriangleMesh> result() {
    result_.next_id = next_id_;
    try {
      link_twins(result_);
    } catch (const std::invalid_argument&) {
      return std::nullopt;
    }
    if (!validate(result_)) return std::nullopt;
    return std::move(result_);
  }

  Index first_new_vertex() const { return first_new_; }

private:
  void number_kept(const std::vector<std::uint8_t>& removed) {
    std::vector<std::uint8_t> used(mesh_.vertex_count(), 0);
    for (Index h = 0; h < mesh_.vertex.size(); ++h)
      if (!removed[h / 3]) used[mesh_.vertex[h]] = 1;
    kept_.assign(mesh_.vertex_count(), kNone);
    VertexTable& out = result_.vertices;
    for (Index v = 0; v < used.size(); ++v) {
      if (!used[v]) continue;
      kept_[v] = Index(out.size());
      out.position.push_back(mesh_.vertices.position[v]);
      out.rest.push_back(mesh_.vertices.rest[v]);
      out.velocity.push_back(mesh_.vertices.velocity[v]);
      out.id.push_back(mesh_.vertices.id[v]);
      out.age.push_back(mesh_.vertices.age[v]);
    }
    first_new_ = Index(out.size());
    next_id_ = mesh_.next_id;
  }

  Index new_vertex(const Vec3& p) {
    VertexTable& out = result_.vertices;
    out.position.push_back(p);
    out.rest.push_back(p);
    out.velocity.push_back(Vec3(0.0f));
    out.id.push_back(next_id_++);
    out.age.push_back(1);
    return Index(out.size() - 1);
  }

  Index filling_vertex(Index v) {
    const auto [it, fresh] = of_filling_.try_emplace(v, kNone);
    if (fresh) it->second = new_vertex(filling_.surface.position[v]);
    return it->second;
  }

  void add(Index a, Index b, Index c) { result_.vertex.insert(result_.vertex.end(), {a, b, c}); }

  void add_kept(Index t) {
    std::vector<Index> polygon;
    int subdivided = 0;
    std::size_t apex = 0;
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      polygon.push_back(kept_[mesh_.vertex[h]]);
      const auto it = path_.find(h);
      if (it == path_.end() || it->second->size() <= 2) continue;
      ++subdivided;
      const auto& path = *it->second;  // runs the other way: from the end of h to its start
      for (std::size_t i = path.size() - 2; i > 0; --i) polygon.push_back(filling_vertex(path[i]));
    }
    if (subdivided <= 1) {
      // The corner opposite the subdivided edge sees every point of it.
      if (subdivided == 1) apex = apex_of(t, polygon);
      for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
        add(polygon[apex], polygon[(apex + i) % polygon.size()], polygon[(apex + i + 1) % polygon.size()]);
      return;
    }
    Vec3 sum(0.0f);
    for (const Index v : polygon) sum += result_.vertices.position[v];
    const Index center = new_vertex(sum / float(polygon.size()));
    for (std::size_t i = 0; i < polygon.size(); ++i) add(center, polygon[i], polygon[(i + 1) % polygon.size()]);
  }

  std::size_t apex_of(Index t, const std::vector<Index>& polygon) const {
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      const auto it = path_.find(h);
      if (it == path_.end() || it->second->size() <= 2) continue;
      const Index opposite = kept_[mesh_.vertex[TriangleMesh::prev(h)]];
      return std::size_t(std::find(polygon.begin(), polygon.end(), opposite) - polygon.begin());
    }
    return 0;
  }

  const TriangleMesh& mesh_;
  const Filling& filling_;
  std::unordered_map<Index, const std::vector<Index>*> path_;  // kept border halfedge -> path, other way round
  std::vector<Index> kept_;
  std::map<Index, Index> of_filling_;
  TriangleMesh result_;
  Index first_new_ = 0, next_id_ = 0;
};

/// One try with the given bad points; pieces in `spared` are not touched.
struct Attempt {
  std::optional<TriangleMesh> mesh;
  std::vector<Vec3> grow_at;  // border points of seams that failed
  std::set<Index> failed_pieces;
  ReskinReport report;
};

Attempt attempt(const TriangleMesh& mesh, const MeshPieces& pieces, const std::set<Index>& spared,
                const std::vector<Vec3>& bad, const Certificate& certificate, const BrickLattice& lattice,
                const LatticeTopology& topology, Backend& backend, const ReskinOptions& options) {
  Attempt result;
  const float radius = float(options.radius * options.edge_length);
  const PointGrid grid(bad, radius);
  std::vector<std::uint8_t> hot(mesh.vertex_count());
  for (Index v = 0; v < hot.size(); ++v) hot[v] = !spared.count(pieces.of_vertex[v]) && grid.any_near(mesh.position(v));
  const std::vector<std::uint8_t> removed = removed_triangles(mesh, hot);
  std::vector<Seam> seams = find_seams(mesh, removed);

  const float reach = radius + float(options.margin * options.edge_length);
  std::vector<std::uint8_t> wanted(lattice.brick_count(), 0);
  const float half_brick = 0.5f * BrickLattice::kCells * float(lattice.spacing);
  const PointGrid coarse(bad, reach + std::sqrt(3.0f) * half_brick);
  for (Index b = 0; b < lattice.brick_count(); ++b)
    wanted[b] = coarse.any_near(Vec3(lattice.point(8 * lattice.coordinate[b])) + half_brick);
  const Filling filling = make_filling(marching_cubes_open(lattice, topology, wanted), backend);

  const auto snapped = snap(mesh, seams, filling, lattice.spacing, backend);
  trace_paths(mesh, seams, filling, snapped, lattice.spacing);
  std::vector<std::uint8_t> inside = flood(filling, seams);
  for (const Seam& seam : seams) {
    if (!seam.failed) continue;
    for (const Index h : seam.halfedge) {
      result.grow_at.push_back(mesh.position(mesh.from(h)));
      result.failed_pieces.insert(pieces.of_vertex[mesh.from(h)]);
    }
  }
  if (!result.failed_pieces.empty()) return result;

  std::vector<std::uint8_t> hot_filling(filling.surface.position.size());
  for (Index v = 0; v < hot_filling.size(); ++v) hot_filling[v] = grid.any_near(filling.surface.position[v]);
  add_whole_pieces(filling, certificate, hot_filling, inside);

  Welder welder(mesh, removed, seams, filling, inside, snapped);
  result.report.first_new_vertex = welder.first_new_vertex();
  result.report.seams = seams.size();
  result.report.triangles_removed = std::size_t(std::count(removed.begin(), removed.end(), 1));
  result.mesh = welder.result();
  if (!result.mesh)
    for (const Seam& seam : seams)
      for (const Index h : seam.halfedge) {
        result.grow_at.push_back(mesh.position(mesh.from(h)));
        result.failed_pieces.insert(pieces.of_vertex[mesh.from(h)]);
      }
  return result;
}

/// The lattice has several times as many triangles as wanted.
void coarsen(TriangleMesh& mesh, Index first_new, const ReskinOptions& options) {
  const std::vector<std::uint8_t> frozen(first_new, 1);
  for (int pass = 0; pass < options.collapse_passes; ++pass) alter(mesh, options.alter, {}, frozen);
}

double area_of_new(const TriangleMesh& mesh, Index first_new, std::size_t& triangles) {
  double area = 0.0;
  for (Index h = 0; h < mesh.vertex.size(); h += 3) {
    const Index a = mesh.vertex[h], b = mesh.vertex[h + 1], c = mesh.vertex[h + 2];
    if (a < first_new && b < first_new && c < first_new) continue;
    ++triangles;
    area += 0.5 * glm::length(glm::cross(mesh.position(b) - mesh.position(a), mesh.position(c) - mesh.position(a)));
  }
  return area;
}

}  // namespace

ReskinReport reskin(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate, const BadSites& sites,
                    const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                    const ReskinOptions& options) {
  std::vector<Vec3> bad = sites.point;
  std::set<Index> spared;
  for (Index p = 0; p < pieces.count(); ++p)
    if (certificate.mesh_piece[p] == Fault::none) spared.insert(p);
  const std::size_t passed = spared.size();
  ReskinReport report;
  report.first_new_vertex = Index(mesh.vertex_count());
  for (int growth = 0; !bad.empty();) {
    Attempt tried = attempt(mesh, pieces, spared, bad, certificate, lattice, topology, backend, options);
    if (tried.mesh) {
      report = tried.report;
      const TriangleMesh old = std::move(mesh);
      mesh = std::move(*tried.mesh);
      report.area = area_of_new(mesh, report.first_new_vertex, report.triangles_added);
      coarsen(mesh, report.first_new_vertex, options);
      carry_attributes(mesh, report.first_new_vertex, old, backend);
      break;
    }
    if (growth++ < options.growths) {
      bad.insert(bad.end(), tried.grow_at.begin(), tried.grow_at.end());
      continue;
    }
    if (tried.failed_pieces.empty()) break;
    const std::size_t before = spared.size();
    spared.insert(tried.failed_pieces.begin(), tried.failed_pieces.end());
    if (spared.size() == before) break;
    bad = sites.point;
    growth = 0;
  }
  report.pieces_given_up = spared.size() - passed;
  return report;
}

}  // namespace isoskin
