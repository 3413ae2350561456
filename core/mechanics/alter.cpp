#include "core/mechanics/alter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/mesh/edit.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/mesh_part.h"
#include "core/mesh/one_ring.h"
#include "core/mesh/small_pieces.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

// A round costs what its candidates cost, and they fade quickly; the limits only bound the tail.
constexpr int kSplitRounds = 12;
constexpr int kCollapseRounds = 32;
// Where more than this share of edges is too short, the much too short ones go first: it is better for shapes, and
// fewer edges compete at once.
constexpr double kManyCollapses = 0.02;
constexpr std::array kEarlyCollapses = {0.4f, 0.7f};
constexpr int kFlipRounds = 12;
constexpr float kFlat = 0.02f;  // a triangle lower than this share of its longest edge has no normal to speak of
constexpr float kValenceWeight = 0.3f;  // see flip_gain
constexpr float kLeastGain = 0.05f;     // a flip must pay, or rounding would flip back and forth

float squared(const Vec3& v) {
  return glm::dot(v, v);
}

/// The triangles that edits may touch: all, or those with a vertex that is not frozen and what is added to the mesh.
class OpenTriangles {
public:
  OpenTriangles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& frozen, const OpenSet* among)
      : mesh_(mesh), all_(frozen.empty()), known_(Index(mesh.triangle_count())) {
    if (all_) return;
    triangles_ = among ? open_triangles(mesh, frozen, among->triangle) : open_triangles(mesh, frozen);
  }

  bool none() const { return all_ ? mesh_.empty() : triangles_.empty(); }
  template <class Edit>
  std::vector<Index> wanted(const Edit& edit) {
    add_new();
    return all_ ? wanted_edges(mesh_, edit) : wanted_edges(mesh_, edit, triangles_);
  }
  /// visit(t), in parallel.
  template <class Visit>
  void for_each(const Visit& visit) {
    add_new();
    for_each_index(all_ ? mesh_.triangle_count() : triangles_.size(),
                   [&](std::size_t i) { visit(all_ ? Index(i) : triangles_[i]); });
  }

private:
  void add_new() {
    for (; !all_ && known_ < mesh_.triangle_count(); ++known_) triangles_.push_back(known_);
  }

  const TriangleMesh& mesh_;
  const bool all_;
  Index known_;
  std::vector<Index> triangles_;
};

/// What splits and collapses ask about an edge.
struct EdgeState {
  const TriangleMesh& mesh;
  const AlterOptions& options;
  const std::vector<std::uint8_t>& frozen;

  float squared_length(Index h) const { return squared(mesh.position(mesh.to(h)) - mesh.position(mesh.from(h))); }

  /// Change of the edge's length in this frame, world units; 0 for an edge without length.
  float growth(Index h) const {
    const Index a = mesh.from(h), b = mesh.to(h);
    const Vec3 edge = mesh.position(b) - mesh.position(a);
    const float length = glm::length(edge);
    if (!(length > 0.0f)) return 0.0f;
    return glm::dot(edge, mesh.vertices.velocity[b] - mesh.vertices.velocity[a]) / length * options.dt;
  }
  bool stretched(Index h) const { return growth(h) > options.rate * options.edge_length; }
  bool compressed(Index h) const { return growth(h) < -options.rate * options.edge_length; }

  bool is_frozen(Index v) const { return v < frozen.size() && frozen[v]; }
  bool frozen_end(Index h) const { return is_frozen(mesh.from(h)) || is_frozen(mesh.to(h)); }
  bool locked(Index h) const {
    return options.respect_locks && (mesh.vertices.age[mesh.from(h)] == 0 || mesh.vertices.age[mesh.to(h)] == 0);
  }
};

/// Splits conflict when the pairs of triangles they cut share an edge.
class Splits {
public:
  Splits(TriangleMesh& mesh, const AlterOptions& options, const std::vector<std::uint8_t>& frozen,
         std::vector<std::uint8_t>& inverted)
      : mesh_(mesh),
        state_{mesh, options, frozen},
        inverted_(inverted),
        limit_(options.longest * options.edge_length * options.longest * options.edge_length) {}

  bool wants(Index h) const {
    if (state_.frozen_end(h) || !(state_.squared_length(h) > limit_) || state_.locked(h) || state_.compressed(h))
      return false;
    if (is_small_piece(mesh_, h)) return false;
    return inverted_.empty() || !(inverted_[h / 3] || inverted_[mesh_.twin[h] / 3]);
  }
  std::uint64_t key(Index h) const { return edge_key(mesh_, h, 1.0f / state_.squared_length(h)); }

  std::size_t cell_count() const { return mesh_.triangle_count(); }
  template <class Visit>
  void for_each_claim(Index h, const Visit& visit) const {
    visit(h / 3);
    visit(mesh_.twin[h] / 3);
  }
  template <class Visit>
  void for_each_watched(Index h, const Visit& visit) const {
    for (const Index t : {h / 3, mesh_.twin[h] / 3}) {
      visit(t);
      for (Index k = 3 * t; k < 3 * t + 3; ++k) visit(mesh_.twin[k] / 3);
    }
  }

  float plan(Index) const { return 0.5f; }
  void make_room(std::size_t count) {
    first_vertex_ = Index(mesh_.vertex_count());
    first_triangle_ = Index(mesh_.triangle_count());
    first_id_ = mesh_.next_id;
    mesh_.vertices.resize(mesh_.vertex_count() + count);
    mesh_.vertex.resize(mesh_.vertex.size() + 6 * count);
    mesh_.twin.resize(mesh_.vertex.size());
    mesh_.next_id += Index(count);
    if (!inverted_.empty()) inverted_.resize(mesh_.triangle_count(), 0);
  }
  Index apply(Index h, float t, Index i) {
    mesh_.vertices.id[first_vertex_ + i] = first_id_ + i;
    split_edge_into(mesh_, h, t, first_vertex_ + i, first_triangle_ + 2 * i);
    return mesh_.twin[h];
  }
  template <class Visit>
  void for_each_changed(Index anchor, const Visit& visit) const {
    for_each_leaving(mesh_, anchor, visit);
  }

private:
  TriangleMesh& mesh_;
  EdgeState state_;
  std::vector<std::uint8_t>& inverted_;
  float limit_;
  Index first_vertex_ = 0, first_triangle_ = 0, first_id_ = 0;
};

/// Collapses conflict when an end of one lies in the rings of the other's ends.
class Collapses {
public:
  Collapses(TriangleMesh& mesh, const AlterOptions& options, const std::vector<std::uint8_t>& frozen)
      : mesh_(mesh),
        state_{mesh, options, frozen},
        longest_(options.longest * options.edge_length * options.longest * options.edge_length),
        least_cosine_(std::cos(glm::radians(options.max_collapse_turn))) {
    restrict_to(1.0f);
  }

  /// From now on only edges below this share of the shortest wanted length.
  void restrict_to(float share) {
    const float shortest = share * state_.options.shortest * state_.options.edge_length;
    limit_ = shortest * shortest;
  }

  bool wants(Index h) const {
    return may_go(h) && state_.squared_length(h) < limit_ && !state_.locked(h) && !state_.stretched(h);
  }
  std::uint64_t key(Index h) const { return edge_key(mesh_, h, state_.squared_length(h)); }

  std::size_t cell_count() const { return mesh_.vertex_count(); }
  template <class Visit>
  void for_each_claim(Index h, const Visit& visit) const {
    visit(mesh_.from(h));
    visit(mesh_.to(h));
  }
  template <class Visit>
  void for_each_watched(Index h, const Visit& visit) const {
    for (const Index end : {h, mesh_.twin[h]}) for_each_leaving(mesh_, end, [&](Index k) { visit(mesh_.to(k)); });
  }

  /// Where to put the merged vertex: the middle, else one of the ends; negative when every place does harm.
  float plan(Index h) const {
    if (!link_condition(mesh_, h) || is_small_piece(mesh_, h)) return -1.0f;
    if (state_.frozen_end(h)) {
      const float t = state_.is_frozen(mesh_.from(h)) ? 0.0f : 1.0f;
      return harmless(h, t) ? t : -1.0f;
    }
    for (const float t : {0.5f, 0.0f, 1.0f})
      if (harmless(h, t)) return t;
    return -1.0f;
  }
  void make_room(std::size_t count) {
    first_ = removed_.vertex.size();
    removed_.vertex.resize(first_ + count);
    removed_.triangle.resize(2 * removed_.vertex.size());
  }
  Index apply(Index h, float t, Index i) {
    if (state_.options.keep_older && goes_before(mesh_.to(h), mesh_.from(h))) {
      h = mesh_.twin[h];
      t = 1.0f - t;
    }
    const Index kept = mesh_.twin[mesh_.prev(h)];
    removed_.vertex[first_ + i] = mesh_.to(h);
    removed_.triangle[2 * (first_ + i)] = h / 3;
    removed_.triangle[2 * (first_ + i) + 1] = mesh_.twin[h] / 3;
    collapse_edge(mesh_, h, t);
    return kept;
  }
  /// What collapses have left dead or unused.
  RemovedRows removed() && {
    std::sort(removed_.vertex.begin(), removed_.vertex.end());
    std::sort(removed_.triangle.begin(), removed_.triangle.end());
    return std::move(removed_);
  }
  template <class Visit>
  void for_each_changed(Index anchor, const Visit& visit) const {
    for_each_leaving(mesh_, anchor, visit);
  }

private:
  bool goes_before(Index a, Index b) const {
    const bool frozen_a = state_.is_frozen(a), frozen_b = state_.is_frozen(b);
    return frozen_a != frozen_b ? frozen_a : mesh_.vertices.id[a] < mesh_.vertices.id[b];
  }
  bool may_go(Index h) const {
    const bool from = state_.is_frozen(mesh_.from(h)), to = state_.is_frozen(mesh_.to(h));
    return state_.options.keep_older ? !(from && to) : !from && !to;
  }

  bool harmless(Index h, float t) const {
    const Index g = mesh_.twin[h], a = mesh_.from(h), b = mesh_.from(g);
    const Vec3 p = glm::mix(mesh_.position(a), mesh_.position(b), t);
    bool ok = true;
    const auto check = [&](Index k) {
      if (!ok || k == h || k == g) return;
      const Vec3 &from = mesh_.position(mesh_.from(k)), &x = mesh_.position(mesh_.to(k));
      ok = squared(x - p) <= std::max(longest_, squared(x - from));
      if (!ok || k == mesh_.next(g) || k == mesh_.next(h)) return;  // the triangles on the edge itself vanish
      const Vec3& y = mesh_.position(mesh_.from(mesh_.prev(k)));
      const Vec3 before = glm::cross(x - from, y - from), after = glm::cross(x - p, y - p);
      const float area = glm::length(before),
                  longest = std::max({squared(x - from), squared(y - from), squared(y - x)});
      if (area <= kFlat * longest) return;
      ok = glm::dot(before, after) >= least_cosine_ * area * glm::length(after);
    };
    for_each_leaving(mesh_, h, check);
    for_each_leaving(mesh_, g, check);
    return ok;
  }

  TriangleMesh& mesh_;
  EdgeState state_;
  float limit_ = 0.0f, longest_, least_cosine_;
  RemovedRows removed_;
  std::size_t first_ = 0;  // of the collapses that are applied now
};

/// Flips conflict when their quads share a vertex: so valences are right, and no edge is made twice.
class Flips {
public:
  Flips(TriangleMesh& mesh, const AlterOptions& options, const std::vector<std::uint8_t>& locked, OpenTriangles& open)
      : mesh_(mesh),
        locked_(locked),
        longest_(options.longest * options.edge_length * options.longest * options.edge_length),
        least_cosine_(std::cos(glm::radians(options.max_flip_turn))) {
    valence_.assign(mesh.vertex_count(), 0);
    open.for_each([&](Index t) {
      for (Index h = 3 * t; h < 3 * t + 3; ++h)
        if (mesh.vertex[h] != kNone && !this->locked(mesh.vertex[h]))  // a quad with a locked vertex stays
          std::atomic_ref<Index>(valence_[mesh.vertex[h]]).fetch_add(1, std::memory_order_relaxed);
    });
  }

  bool wants(Index h) const { return gain(h) > kLeastGain && can_flip(mesh_, h); }
  std::uint64_t key(Index h) const { return edge_key(mesh_, h, 1.0f / gain(h)); }

  std::size_t cell_count() const { return mesh_.vertex_count(); }
  template <class Visit>
  void for_each_claim(Index h, const Visit& visit) const {
    for (const Index v : quad(h)) visit(v);
  }
  template <class Visit>
  void for_each_watched(Index h, const Visit& visit) const {
    for_each_claim(h, visit);
  }

  float plan(Index) const { return 0.0f; }
  void make_room(std::size_t) {}
  Index apply(Index h, float, Index) {
    const auto [a, b, c, d] = quad(h);
    --valence_[a], --valence_[b], ++valence_[c], ++valence_[d];
    flip_edge(mesh_, h);
    return h;
  }
  template <class Visit>
  void for_each_changed(Index h, const Visit& visit) const {
    const Index g = mesh_.twin[h];
    for (const Index k : {h, mesh_.next(h), mesh_.prev(h), mesh_.next(g), mesh_.prev(g)}) visit(k);
  }

private:
  /// The edge's ends, then the two opposite vertices.
  std::array<Index, 4> quad(Index h) const {
    const Index g = mesh_.twin[h];
    return {mesh_.from(h), mesh_.from(g), mesh_.from(mesh_.prev(h)), mesh_.from(mesh_.prev(g))};
  }

  bool locked(Index v) const { return v < locked_.size() && locked_[v]; }

  float valence_gain(const std::array<Index, 4>& q) const {
    // (v - 6)^2 falls by 2 (v - 6) - 1 where an edge goes and rises by 2 (v - 6) + 1 where one comes.
    const auto v = [&](int k) { return int(valence_[q[k]]); };
    return float(2 * (v(0) + v(1) - v(2) - v(3)) - 4);
  }

  /// (cot A + cot B + cot C) / sqrt 3 of a triangle from its squared edges' sum and twice its area: 1 when equilateral.
  static float shape_cost(float squared_edges, float doubled_area) {
    constexpr float kScale = 0.28867513f;  // 1 / (2 sqrt 3)
    return kScale * squared_edges / std::max(doubled_area, 1e-5f * squared_edges);
  }

  /// How much a flip lowers  sum over triangles (cot A + cot B + cot C) / sqrt 3  +  kValenceWeight * sum (valence -
  /// 6)^2: the first is what Delaunay triangulations minimise (Rippa 1990); one sum that only falls cannot cycle.
  float gain(Index h) const {
    const std::array<Index, 4> q = quad(h);
    if (locked(q[0]) || locked(q[1])) return 0.0f;
    const Vec3 &a = mesh_.position(q[0]), &b = mesh_.position(q[1]), &c = mesh_.position(q[2]),
               &d = mesh_.position(q[3]);
    const Vec3 old_c = glm::cross(b - a, c - a), old_d = glm::cross(d - a, b - a);
    const float area_c = glm::length(old_c), area_d = glm::length(old_d);
    const float ab = squared(b - a), bc = squared(c - b), ca = squared(a - c), ad = squared(d - a), db = squared(b - d);
    const float before = shape_cost(ab + bc + ca, area_c) + shape_cost(ab + ad + db, area_d);
    const float by_valence = kValenceWeight * valence_gain(q);
    if (before - 2.0f + by_valence <= kLeastGain) return 0.0f;  // no two triangles cost less than 2

    const float cd = squared(d - c);
    if (cd > std::max(longest_, ab)) return 0.0f;  // it would be split at once
    const Vec3 new_a = glm::cross(d - a, c - a), new_b = glm::cross(c - b, d - b);
    const float area_a = glm::length(new_a), area_b = glm::length(new_b);
    const float flat = kFlat * std::max({ab, cd, bc, ca, ad, db});
    if (area_a <= flat || area_b <= flat) return 0.0f;
    const float after = shape_cost(cd + ca + ad, area_a) + shape_cost(cd + bc + db, area_b);
    const float result = before - after + by_valence;
    if (!(result > kLeastGain)) return 0.0f;
    for (const Index v : q)
      if (locked(v)) return 0.0f;
    const auto turned = [&](const Vec3& m, float area_m, const Vec3& n, float area_n) {
      return area_n > flat && glm::dot(m, n) < least_cosine_ * area_m * area_n;
    };
    if (area_c > flat && turned(old_c, area_c, old_d, area_d)) return 0.0f;
    if (turned(new_a, area_a, new_b, area_b)) return 0.0f;
    if (turned(new_a, area_a, old_c, area_c) || turned(new_a, area_a, old_d, area_d)) return 0.0f;
    if (turned(new_b, area_b, old_c, area_c) || turned(new_b, area_b, old_d, area_d)) return 0.0f;
    return result;
  }

  TriangleMesh& mesh_;
  const std::vector<std::uint8_t>& locked_;
  float longest_, least_cosine_;
  std::vector<Index> valence_;
};

std::size_t collapse(TriangleMesh& mesh, Collapses& collapses, OpenTriangles& open) {
  std::vector<Index> candidates = open.wanted(collapses);
  std::size_t done = 0;
  if (double(candidates.size()) > kManyCollapses * double(mesh.vertex.size() / 2)) {
    for (const float share : kEarlyCollapses) {
      collapses.restrict_to(share);
      done += edit_independently(mesh, collapses, open.wanted(collapses), kCollapseRounds);
    }
    collapses.restrict_to(1.0f);
    candidates = open.wanted(collapses);
  }
  return done + edit_independently(mesh, collapses, std::move(candidates), kCollapseRounds);
}

}  // namespace

AlterReport alter(TriangleMesh& mesh, const AlterOptions& options, const std::vector<std::uint8_t>& inverted,
                  const std::vector<std::uint8_t>& frozen, OpenSet* among) {
  AlterReport report;
  if (among && among->all()) among = nullptr;
  OpenTriangles open(mesh, frozen, among);
  if (open.none()) return report;
  const std::size_t triangles_before = mesh.triangle_count();
  // Flips heed the locks of earlier edits, not of this call's: they mend what splits and collapses leave.
  std::vector<std::uint8_t> locked = frozen;
  if (options.respect_locks) {
    locked.resize(mesh.vertex_count(), 0);
    for_each_index(locked.size(), [&](std::size_t v) { locked[v] |= mesh.vertices.age[v] == 0; });
  }

  std::vector<std::uint8_t> inverted_now = inverted;
  Splits splits(mesh, options, frozen, inverted_now);
  report.splits = edit_independently(mesh, splits, open.wanted(splits), kSplitRounds);
  Collapses collapses(mesh, options, frozen);
  report.collapses = collapse(mesh, collapses, open);
  if (options.flip) {
    Flips flips(mesh, options, locked, open);
    report.flips = edit_independently(mesh, flips, open.wanted(flips), kFlipRounds);
  }
  if (among) among->add_rows(mesh, triangles_before);
  if (report.collapses == 0) return report;
  RemovedRows removed = std::move(collapses).removed();
  remove_rows(mesh, removed);
  if (among) among->remove(removed);
  return report;
}

}  // namespace isoskin
