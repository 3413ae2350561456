#include "core/topology/collisions.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_set>

#include "core/disjoint_sets.h"
#include "core/mesh/edit.h"
#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/triangle_pairs.h"

namespace isoskin {
namespace {

/// Distances to the surface with the field's sign, in world units.
class DistanceGauge {
public:
  DistanceGauge(const std::vector<Vec3>& on_surface, Backend& backend, double least_slope) : backend_(backend) {
    std::vector<float> values(on_surface.size()), slopes(on_surface.size());
    std::vector<Vec3> gradients(on_surface.size());
    backend.evaluate(on_surface, values, gradients);
    for_each_index(slopes.size(), [&](std::size_t i) { slopes[i] = glm::length(gradients[i]); });
    const auto middle = slopes.begin() + std::ptrdiff_t(slopes.size() / 2);
    std::nth_element(slopes.begin(), middle, slopes.end());
    least_slope_ = float(least_slope) * *middle;
  }

  std::vector<float> operator()(const std::vector<Vec3>& points) const {
    std::vector<float> values(points.size());
    std::vector<Vec3> gradients(points.size());
    backend_.evaluate(points, values, gradients);
    for_each_index(values.size(), [&](std::size_t i) {
      const float slope = std::max(glm::length(gradients[i]), least_slope_);
      values[i] = slope > 0.0f ? values[i] / slope : 0.0f;
    });
    return values;
  }

private:
  Backend& backend_;
  float least_slope_ = 0.0f;
};

Vec3 centroid(const TriangleMesh& mesh, Index t) {
  const auto [a, b, c] = corners_of(mesh, t);
  return (a + b + c) / 3.0f;
}

Vec3 area_normal(const TriangleMesh& mesh, Index t) {
  const auto [a, b, c] = corners_of(mesh, t);
  return glm::cross(b - a, c - a);
}

/// What a moved mesh tells: for each triangle the side (sign of F) on which it has left the surface, 0 where it has
/// not, and which vertices were not projected.
struct Marks {
  std::vector<std::int8_t> side;
  std::vector<std::int8_t> lost;  // a vertex: the side it is on, 0 where it is on the surface
  std::vector<Vec3> centre;       // of each triangle
  std::size_t pairs = 0, strays = 0;
};

std::int8_t side_of(float distance, double tolerance) {
  return std::int8_t(distance > tolerance ? 1 : distance < -tolerance ? -1 : 0);
}

Marks mark(const TriangleMesh& moved, Backend& backend, const CollisionOptions& options) {
  const DistanceGauge distance(moved.vertices.position, backend, options.least_slope);
  Marks marks;
  const std::vector<float> of_vertex = distance(moved.vertices.position);
  marks.lost.resize(of_vertex.size());
  for_each_index(of_vertex.size(), [&](std::size_t v) {
    marks.lost[v] = side_of(of_vertex[v], options.stray_vertex * options.edge_length);
  });
  std::vector<Vec3>& centres = marks.centre;
  centres.resize(moved.triangle_count());
  for_each_index(centres.size(), [&](std::size_t t) { centres[t] = centroid(moved, Index(t)); });
  const std::vector<float> of_centre = distance(centres);
  marks.side.resize(centres.size());
  for_each_index(centres.size(), [&](std::size_t t) {
    marks.side[t] = side_of(of_centre[t], options.stray_centre * options.edge_length);
    for (std::size_t h = 3 * t; h < 3 * t + 3 && marks.side[t] == 0; ++h) marks.side[t] = marks.lost[moved.vertex[h]];
  });
  marks.strays = std::size_t(std::count_if(marks.side.begin(), marks.side.end(), [](auto s) { return s != 0; }));

  std::vector<TrianglePair> pairs = overlapping_pairs(moved);
  std::erase_if(
      pairs, [&](const TrianglePair& p) { return glm::dot(area_normal(moved, p.a), area_normal(moved, p.b)) >= 0.0f; });
  marks.pairs = pairs.size();
  std::vector<Vec3> middles;
  for (const TrianglePair& p : pairs) middles.push_back(0.5f * (centres[p.a] + centres[p.b]));
  const std::vector<float> of_middle = distance(middles);
  for (std::size_t i = 0; i < pairs.size(); ++i)
    for (const Index t : {pairs[i].a, pairs[i].b})
      if (marks.side[t] == 0) marks.side[t] = side_of(of_middle[i], 0.0);
  return marks;
}

/// Marked triangles of one side that hang together by vertices, ascending.
struct Patch {
  std::vector<Index> triangles;
  int side = 0;
};

/// In order of their smallest triangle; `of` is filled with each triangle's patch.
std::vector<Patch> patches_of(const TriangleMesh& mesh, const Marks& marks, std::vector<Index>& of) {
  const std::vector<Index> marked = indices_where(marks.side.size(), [&](Index t) { return marks.side[t] != 0; });
  DisjointSets sets(marked.size());
  std::map<std::pair<Index, int>, Index> first_at;  // vertex and side: a marked triangle there
  for (Index i = 0; i < marked.size(); ++i)
    for (Index k = 0; k < 3; ++k) {
      const auto [it, fresh] = first_at.try_emplace({mesh.vertex[3 * marked[i] + k], marks.side[marked[i]]}, i);
      if (!fresh) sets.unite(it->second, i);
    }
  std::vector<Patch> patches;
  of.assign(marks.side.size(), kNone);
  for (Index i = 0; i < marked.size(); ++i) {
    const Index root = sets.root(i);
    if (root == i) {
      of[marked[i]] = Index(patches.size());
      patches.push_back({{}, marks.side[marked[i]]});
    }
    of[marked[i]] = of[marked[root]];
    patches[of[marked[i]]].triangles.push_back(marked[i]);
  }
  return patches;
}

/// How many pairs of near triangles two patches of one side have.
using Links = std::map<std::pair<Index, Index>, std::size_t>;

Links links_between(const TriangleMesh& moved, const std::vector<Patch>& patches, const std::vector<Index>& of,
                    double near) {
  Links links;
  if (patches.size() < 2) return links;
  for (const TrianglePair& p : near_pairs(moved, near, [&](const TrianglePair& pair) {
         const Index a = of[pair.a], b = of[pair.b];
         return a != kNone && b != kNone && a != b && patches[a].side == patches[b].side;
       }))
    ++links[std::minmax(of[p.a], of[p.b])];
  return links;
}

/// What the patches without a link face: where sheets have just met, it is chance which of them still finds a surface.
/// One set of triangles a patch, ascending; empty for linked ones.
std::vector<std::vector<Index>> partners_of(const TriangleMesh& moved, const std::vector<Patch>& patches,
                                            const std::vector<Index>& of, const Links& links, const Marks& marks,
                                            const Field& field, double near) {
  std::vector<std::uint8_t> alone(patches.size(), 1);
  for (const auto& [pair, count] : links) alone[pair.first] = alone[pair.second] = 0;
  std::vector<std::vector<Index>> partners(patches.size());
  if (std::count(alone.begin(), alone.end(), 1) == 0) return partners;
  const auto lone = [&](Index t) { return of[t] != kNone && alone[of[t]]; };
  for (const auto& [a, b] : near_pairs(moved, near, [&](const TrianglePair& p) {
         if (!(lone(p.a) && of[p.b] == kNone) && !(lone(p.b) && of[p.a] == kNone)) return false;
         if (glm::dot(area_normal(moved, p.a), area_normal(moved, p.b)) >= 0.0f) return false;
         const int side = marks.side[p.a] + marks.side[p.b];
         return side * field.value(0.5 * (DVec3(marks.centre[p.a]) + DVec3(marks.centre[p.b]))) > 0.0;
       }))
    (lone(a) ? partners[of[a]] : partners[of[b]]).push_back(lone(a) ? b : a);
  for (std::vector<Index>& partner : partners) {
    std::sort(partner.begin(), partner.end());
    partner.erase(std::unique(partner.begin(), partner.end()), partner.end());
  }
  return partners;
}

/// Patches that belong together, and their links, the strongest first.
struct Cluster {
  std::vector<Index> patches;
  std::vector<std::pair<Index, Index>> links;
};

std::vector<Cluster> clusters_of(std::size_t patch_count, const Links& links) {
  DisjointSets sets(patch_count);
  for (const auto& [pair, count] : links) sets.unite(pair.first, pair.second);
  std::vector<Cluster> clusters;
  std::vector<Index> of(patch_count);
  for (Index p = 0; p < patch_count; ++p) {
    if (sets.root(p) == p) {
      of[p] = Index(clusters.size());
      clusters.emplace_back();
    }
    of[p] = of[sets.root(p)];
    clusters[of[p]].patches.push_back(p);
  }
  std::vector<std::pair<std::size_t, std::pair<Index, Index>>> strongest;
  for (const auto& [pair, count] : links) strongest.push_back({count, pair});
  std::stable_sort(strongest.begin(), strongest.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  for (const auto& [count, pair] : strongest) clusters[of[pair.first]].links.push_back(pair);
  return clusters;
}

DVec3 middle_of(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  DVec3 sum(0.0);
  for (const Index t : triangles) sum += DVec3(centroid(mesh, t)) / double(triangles.size());
  return sum;
}

std::vector<Index> vertices_of(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  std::vector<Index> vertices;
  for (const Index t : triangles)
    for (Index k = 0; k < 3; ++k) vertices.push_back(mesh.vertex[3 * t + k]);
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  return vertices;
}

/// Collects operations planned on one mesh, as long as they do not touch each other.
class Operations {
public:
  Operations(TriangleMesh& mesh, const Field& field, const CollisionOptions& options)
      : mesh_(mesh), field_(field), options_(options) {}

  /// True when the triangles were all of a piece that no vertex of finds the surface; it is erased.
  bool vanish(const Patch& patch, const Marks& marks) {
    const std::vector<Index> vertices = vertices_of(mesh_, patch.triangles);
    if (std::any_of(vertices.begin(), vertices.end(), [&](Index v) { return marks.lost[v] != patch.side; }))
      return false;
    const std::unordered_set<Index> in(patch.triangles.begin(), patch.triangles.end());
    for (const Index t : patch.triangles)
      for (Index h = 3 * t; h < 3 * t + 3; ++h)
        if (!in.count(TriangleMesh::triangle(mesh_.twin[h]))) return false;
    MeshPatch change(mesh_);
    change.remove(patch.triangles);
    return accept("vanish", {std::move(change), {}});
  }

  bool split(const QuasiCritical& cluster) {
    SplitOptions options = options_.split;
    options.edge_length = options_.edge_length;
    return accept(cluster.side < 0 ? "split" : "spackle", plan_split(mesh_, cluster, field_, options));
  }

  bool blend(const Patch& a, const Patch& b) {
    if (!faces(a, b)) return false;
    std::vector<Index> disc_a = a.triangles, disc_b = b.triangles;
    constexpr int kRings = 3;
    for (int ring = 0; ring < kRings; ++ring) {
      disc_a = with_neighbours(mesh_, disc_a);
      disc_b = with_neighbours(mesh_, disc_b);
      if (accept(a.side > 0 ? "blend" : "pierce", plan_blend(mesh_, disc_a, disc_b))) return true;
    }
    return false;
  }

  std::vector<CollisionEvent> apply(std::vector<Ball>& split) {
    std::vector<CollisionEvent> done;
    for (std::size_t i = 0; i < patches_.size(); ++i) {
      const DVec3 center = events_[i].position;
      double radius = 0.0;
      for (const Index v : vertices_of(mesh_, patches_[i].removed()))
        radius = std::max(radius, glm::distance(DVec3(mesh_.position(v)), center));
      if (!patches_[i].splice(mesh_)) continue;
      done.push_back(events_[i]);
      if (events_[i].kind != "split" && events_[i].kind != "spackle") continue;
      constexpr double kAround = 2.0;  // the new surface is far from the old one about as far as the hole is wide
      split.push_back({center, kAround * radius});
    }
    if (!done.empty()) compact(mesh_);
    for (const Ball& ball : split) stop(ball);
    return done;
  }

private:
  void stop(const Ball& ball) {
    for_each_index(mesh_.vertex_count(), [&](std::size_t v) {
      if (glm::distance(DVec3(mesh_.position(Index(v))), ball.center) < ball.radius)
        mesh_.vertices.velocity[v] = Vec3(0.0f);
    });
  }

  /// True when the patches look at each other or away from each other, and the new field joins them.
  bool faces(const Patch& a, const Patch& b) const {
    Vec3 normal[2] = {Vec3(0.0f), Vec3(0.0f)};
    for (const Index t : a.triangles) normal[0] += area_normal(mesh_, t);
    for (const Index t : b.triangles) normal[1] += area_normal(mesh_, t);
    if (glm::dot(normal[0], normal[1]) >= 0.0f) return false;
    const DVec3 from = middle_of(mesh_, a.triangles), to = middle_of(mesh_, b.triangles);
    constexpr int kProbes = 7;
    for (int i = 1; i <= kProbes; ++i)
      if (a.side * field_.value(glm::mix(from, to, i / (kProbes + 1.0))) <= 0.0) return false;
    return true;
  }

  bool accept(const char* kind, PlannedPatch planned) {
    if (!planned.patch) return false;
    const std::vector<Index> touched = vertices_of(mesh_, planned.patch->removed());
    if (std::any_of(touched.begin(), touched.end(), [&](Index v) { return claimed_.count(v) > 0; })) return false;
    claimed_.insert(touched.begin(), touched.end());
    events_.push_back({kind, middle_of(mesh_, planned.patch->removed()), touched.size(), planned.patch->area(mesh_)});
    patches_.push_back(std::move(*planned.patch));
    return true;
  }

  TriangleMesh& mesh_;
  const Field& field_;
  const CollisionOptions& options_;
  std::vector<MeshPatch> patches_;
  std::vector<CollisionEvent> events_;
  std::unordered_set<Index> claimed_;  // vertices of triangles that will be gone
};

/// True when a patch of the cluster lies where the mesh was split before.
bool was_split(const Cluster& cluster, const std::vector<Patch>& patches, const Marks& marks,
               const std::vector<Ball>& split) {
  return std::any_of(split.begin(), split.end(), [&](const Ball& ball) {
    return std::any_of(cluster.patches.begin(), cluster.patches.end(), [&](Index p) {
      return glm::distance(DVec3(marks.centre[patches[p].triangles.front()]), ball.center) < ball.radius;
    });
  });
}

/// True when something was planned for the cluster.
bool plan(Operations& operations, const Cluster& cluster, const std::vector<Patch>& patches,
          const std::vector<std::vector<Index>>& partners, const Marks& marks) {
  bool planned = false;
  for (const Index p : cluster.patches) planned |= operations.vanish(patches[p], marks);
  if (planned) return true;
  QuasiCritical points;
  points.side = patches[cluster.patches.front()].side;
  for (const Index p : cluster.patches)
    points.triangles.insert(points.triangles.end(), patches[p].triangles.begin(), patches[p].triangles.end());
  std::sort(points.triangles.begin(), points.triangles.end());
  for (const Index t : points.triangles) points.points.push_back(DVec3(marks.centre[t]));
  if (operations.split(points)) return true;
  for (const auto& [a, b] : cluster.links) planned |= operations.blend(patches[a], patches[b]);
  const Index first = cluster.patches.front();
  if (!partners[first].empty()) planned = operations.blend(patches[first], {partners[first], patches[first].side});
  return planned;
}

}  // namespace

CollisionReport handle_collisions(TriangleMesh& mesh, const std::vector<Vec3>& moved, Backend& backend,
                                  const Field& field, const std::vector<std::uint8_t>& open,
                                  const std::vector<Ball>& split, const CollisionOptions& options) {
  CollisionReport report;
  if (mesh.empty()) return report;
  std::vector<Vec3> place = moved;
  std::swap(mesh.vertices.position, place);
  Marks marks = mark(mesh, backend, options);
  for (Index t = 0; t < marks.side.size() && !open.empty(); ++t)
    if (!open[mesh.vertex[3 * t]]) marks.side[t] = 0;
  std::vector<Index> of;
  const std::vector<Patch> patches = patches_of(mesh, marks, of);
  const Links links = links_between(mesh, patches, of, options.near * options.edge_length);
  const auto partners = partners_of(mesh, patches, of, links, marks, field, options.edge_length);
  std::swap(mesh.vertices.position, place);

  report.pairs = marks.pairs;
  report.strays = marks.strays;
  Operations operations(mesh, field, options);
  for (const Cluster& cluster : clusters_of(patches.size(), links))
    if (!was_split(cluster, patches, marks, split) && !plan(operations, cluster, patches, partners, marks))
      ++report.refused;
  report.events = operations.apply(report.split);
  return report;
}

}  // namespace isoskin
