#include "core/refine/untangle.h"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>

#include "core/disjoint_sets.h"
#include "core/mechanics/alter.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/mesh_part.h"
#include "core/mesh/one_ring.h"
#include "core/parallel.h"
#include "core/topology/point_grid.h"
#include "core/topology/triangle_pairs.h"

namespace isoskin {
namespace {

/// The open triangles about edges at which the skin turns by a right angle or more: where it has folded it has such.
std::vector<Index> creased_triangles(const TriangleMesh& skin, const OpenSet& open) {
  constexpr int kRings = 2;
  const std::vector<Index> all = open.all() ? open_triangles(skin, {}) : std::vector<Index>();
  const std::vector<Index>& some = open.all() ? all : open.triangle;
  const auto normal = [&](Index t) {
    const auto [p, q, r] = corners_of(skin, t);
    return glm::cross(q - p, r - p);
  };
  const std::vector<Index> sharp = indices_where(some.size(), [&](Index i) {
    const Vec3 n = normal(some[i]);
    const auto turns = [&](Index h) { return !(glm::dot(n, normal(skin.twin[h] / 3)) > 0.0f); };
    return turns(3 * some[i]) || turns(3 * some[i] + 1) || turns(3 * some[i] + 2);
  });
  std::vector<Index> creased;
  for (const Index i : sharp) creased.push_back(some[i]);
  std::vector<std::uint8_t> beyond(creased.empty() ? 0 : skin.vertex_count(), 1);
  for (int ring = 0; ring < kRings && !creased.empty(); ++ring) {
    for (const Index t : creased)
      for (Index h = 3 * t; h < 3 * t + 3; ++h) beyond[skin.vertex[h]] = 0;
    creased = open_triangles(skin, beyond, some);
  }
  return creased;
}

/// Of triangles of the skin itself, as its own only children. 98 of 100 that overlap lie about creases, and those are
/// the ones that smoothing takes apart.
std::vector<Crossing> crossings_of(const TriangleMesh& skin, const OpenSet& open) {
  const std::vector<Index> some = creased_triangles(skin, open);
  if (some.empty()) return {};
  const auto box = [&](Index i) { return box_of(corners_of(skin, some[i])); };
  const auto overlap = [&](const TrianglePair& pair) {
    const Index a = some[pair.a], b = some[pair.b];
    return !share_a_vertex(skin, a, b) && triangles_overlap(corners_of(skin, a), corners_of(skin, b));
  };
  std::vector<Crossing> crossings;
  for (const TrianglePair& pair : near_boxes(some.size(), box, 0.0, overlap))
    crossings.push_back({some[pair.a], 0, some[pair.b], 0});
  return crossings;
}

}  // namespace

bool unfold(TriangleMesh& skin, const OpenSet& open, Backend& backend, const ProjectOptions& project) {
  constexpr int kRounds = 3;
  std::vector<Crossing> crossings = crossings_of(skin, open);
  if (crossings.empty()) return false;
  Tangles tangles(skin);
  for (int round = 0; round < kRounds && tangles.smooth(skin, crossings, backend, project); ++round)
    crossings = tangles.take_back(skin, crossings_of(skin, open));
  return true;
}

bool Tangles::smooth(TriangleMesh& skin, const std::vector<Crossing>& crossings, Backend& backend,
                     const ProjectOptions& project) {
  crossing_ = crossings;
  if (std::none_of(crossing_.begin(), crossing_.end(), [&](const Crossing& c) { return is_tried(c); })) return false;
  gather(skin);
  DisjointSets sheets = joined_by_edges();
  const std::vector<Index> moving = held(sheets);
  part_ = parts(skin, std::move(sheets));
  before_.resize(vertex_.size());
  for_each_index(before_.size(), [&](std::size_t i) { before_[i] = skin.position(vertex_[i]); });
  const std::vector<int> last = sweeps(skin);
  std::vector<Index> going = moving;
  for (int sweep = 0; !going.empty(); ++sweep) {
    std::vector<Vec3> middle(going.size());
    for_each_index(going.size(), [&](std::size_t k) {
      const std::vector<Index>& ring = ring_[going[k]];
      Vec3 sum(0.0f);
      for (const Index v : ring) sum += skin.position(v);
      middle[k] = sum / float(ring.size());
    });
    backend.project(middle, project, {});
    for_each_index(going.size(), [&](std::size_t k) { skin.vertices.position[vertex_[going[k]]] = middle[k]; });
    std::erase_if(going, [&](Index i) { return last[i] <= sweep + 1; });
  }
  return true;
}

/// Rows of what hangs together with a vertex that stays: a piece that moves as a whole would shrink to a point.
std::vector<Index> Tangles::held(DisjointSets& sets) const {
  std::vector<std::uint8_t> held(vertex_.size(), 0);  // under the number of each set
  for (Index i = 0; i < ring_.size(); ++i)
    for (const Index v : ring_[i])
      if (row_[v] == kNone) held[sets.root(i)] = 1;
  return indices_where(vertex_.size(), [&](Index i) { return held[sets.root(i)] != 0; });
}

/// Per row: as many as what has been tried most often in its part wants.
std::vector<int> Tangles::sweeps(const TriangleMesh& skin) const {
  std::vector<int> tried(vertex_.size(), 0);  // under the number of each part
  for (const Crossing& crossing : crossing_) {
    if (!is_tried(crossing)) continue;
    int& most = tried[part_[row_[skin.vertex[3 * crossing.a]]]];
    most = std::max(most, times_tried(crossing));
  }
  std::vector<int> sweeps(vertex_.size());
  for (Index i = 0; i < sweeps.size(); ++i) sweeps[i] = options_.sweeps[std::size_t(tried[part_[i]])];
  return sweeps;
}

/// Sets vertex_, row_ and ring_: those of the crossings' triangles and some rings about them.
void Tangles::gather(const TriangleMesh& skin) {
  for (const Index v : vertex_) row_[v] = kNone;
  vertex_.clear();
  std::vector<Index> leaving;  // of each: a halfedge
  const auto add = [&](Index h) {
    if (row_[skin.from(h)] != kNone) return;
    row_[skin.from(h)] = Index(vertex_.size());
    vertex_.push_back(skin.from(h));
    leaving.push_back(h);
  };
  // Those that go on for longest first, so that whoever meets a vertex goes on from it for as long as any.
  int most = 0;
  std::vector<std::vector<Index>> triangles(options_.sweeps.size());
  for (const Crossing& crossing : crossing_) {
    const int tried = times_tried(crossing);
    if (!is_tried(crossing)) continue;
    triangles[std::size_t(tried)].insert(triangles[std::size_t(tried)].end(), {crossing.a, crossing.b});
    most = std::max(most, tried);
  }
  std::size_t begin = 0;
  const auto add_ring = [&] {
    for (const std::size_t end = vertex_.size(); begin < end; ++begin)
      for_each_leaving(skin, leaving[begin], [&](Index h) { add(skin.twin[h]); });
  };
  for (int tried = most; tried >= 0; --tried) {
    if (tried < most) add_ring();
    for (const Index t : triangles[std::size_t(tried)])
      for (Index h = 3 * t; h < 3 * t + 3; ++h) add(h);
  }
  for (int ring = 0; ring < options_.rings; ++ring) add_ring();
  std::vector<Index> order(vertex_.size());
  std::iota(order.begin(), order.end(), Index{0});
  std::sort(order.begin(), order.end(), [&](Index i, Index j) { return vertex_[i] < vertex_[j]; });
  ring_.assign(vertex_.size(), {});
  std::vector<Index> sorted(vertex_.size());
  for (Index i = 0; i < order.size(); ++i) {
    sorted[i] = vertex_[order[i]];
    row_[sorted[i]] = i;
    for_each_leaving(skin, leaving[order[i]], [&](Index h) { ring_[i].push_back(skin.to(h)); });
  }
  vertex_ = std::move(sorted);
}

/// Rows.
DisjointSets Tangles::joined_by_edges() const {
  DisjointSets sets(vertex_.size());
  for (Index i = 0; i < ring_.size(); ++i)
    for (const Index v : ring_[i])
      if (row_[v] != kNone) sets.unite(i, row_[v]);
  return sets;
}

/// Per row; what overlaps joins `sets`.
std::vector<Index> Tangles::parts(const TriangleMesh& skin, DisjointSets sets) const {
  for (const Crossing& crossing : crossing_)
    if (is_tried(crossing)) sets.unite(row_[skin.vertex[3 * crossing.a]], row_[skin.vertex[3 * crossing.b]]);
  std::vector<Index> part(vertex_.size());
  for (Index i = 0; i < part.size(); ++i) part[i] = sets.root(i);
  return part;
}

/// Of a corner of a triangle that moves, kNone when none does.
Index Tangles::row(const TriangleMesh& skin, Index triangle) const {
  for (Index h = 3 * triangle; h < 3 * triangle + 3; ++h)
    if (row_[skin.from(h)] != kNone) return row_[skin.from(h)];
  return kNone;
}

std::vector<Crossing> Tangles::take_back(TriangleMesh& skin, const std::vector<Crossing>& now,
                                         const std::vector<Vec3>& hidden, double reach) {
  const auto of_part = [&](Index t) {
    const Index i = row(skin, t);
    return i == kNone ? kNone : part_[i];
  };
  std::vector<int> fewer(vertex_.size(), 0);  // under the number of each part; a crossing between two parts is of both
  const auto count = [&](const std::vector<Crossing>& crossings, int times) {
    for (const Crossing& crossing : crossings)
      for (const Index t : {crossing.a, crossing.b})
        if (const Index part = of_part(t); part != kNone) fewer[part] += times;
  };
  count(crossing_, 1);
  count(now, -1);
  const PointGrid near(hidden, float(reach));
  for (Index i = 0; i < vertex_.size() && !hidden.empty(); ++i)
    if (near.any_near(before_[i]) || near.any_near(skin.position(vertex_[i])))
      fewer[part_[i]] = std::min(fewer[part_[i]], 0);
  const auto goes_back = [&](Index part) { return part != kNone && fewer[part] <= 0; };
  std::vector<Crossing> left, in_vain;
  for (const Crossing& crossing : now)
    if (!goes_back(of_part(crossing.a)) && !goes_back(of_part(crossing.b))) left.push_back(crossing);
  for (const Crossing& crossing : crossing_) {
    if (!goes_back(of_part(crossing.a)) && !goes_back(of_part(crossing.b))) continue;
    left.push_back(crossing);
    if (is_tried(crossing)) in_vain.push_back(crossing);
  }
  std::sort(left.begin(), left.end());
  std::vector<std::uint8_t> tried;
  for (const Crossing& crossing : in_vain) tried.push_back(std::uint8_t(times_tried(crossing) + 1));
  for (std::size_t i = 0; i < in_vain.size(); ++i)
    for (const Index t : {in_vain[i].a, in_vain[i].b}) tried_[t] = std::max(tried_[t], tried[i]);
  took_back_ = false;
  for (Index i = 0; i < vertex_.size(); ++i) {
    if (!goes_back(part_[i])) continue;
    skin.vertices.position[vertex_[i]] = before_[i];
    took_back_ = true;
  }
  return left;
}

void mend_seams(TriangleMesh& skin, Index first_new, double fineness, Backend& backend, const ProjectOptions& project) {
  constexpr float kShortest = 0.4f, kLongest = 2.7f;  // of the fineness
  constexpr int kRings = 2, kPasses = 2;
  AlterOptions options;
  options.edge_length = float(fineness);
  options.shortest = kShortest;
  options.longest = kLongest;
  options.dt = 0.0f;
  options.respect_locks = false;
  OpenSet open(skin, MeshPart(skin, first_new, kRings).frozen(skin));
  for (int pass = 0; pass < kPasses; ++pass) alter(skin, options, {}, std::vector(open.frozen), &open);
  const std::vector<Index> moved = indices_where(skin.vertex_count(), [&](Index v) { return !open.frozen[v]; });
  std::vector<Vec3> position(moved.size());
  for_each_index(moved.size(), [&](std::size_t i) { position[i] = skin.position(moved[i]); });
  backend.project(position, project, {});
  for_each_index(moved.size(), [&](std::size_t i) { skin.vertices.position[moved[i]] = position[i]; });
}

}  // namespace isoskin
