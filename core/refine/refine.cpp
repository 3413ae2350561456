#include "core/refine/refine.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/refine/split_pattern.h"

namespace isoskin {
namespace {

constexpr float kMaxTravel = 0.5f;  // a new point farther from its edge's middle than this times the edge stays there
constexpr float kCentroid = 4.0f / 3.0f;  // a sphere's triangle: what its centroid sags by over what its edges do
constexpr float kNoArea = 1e-6f;  // twice the area over the longest edge squared, below which a child is degenerate

Vec3 unit_outward(const Vec3& gradient) {
  return Vec3(outward_normal(DVec3(gradient)));
}

void evaluate_normals(Backend& backend, std::span<const Vec3> points, std::span<Vec3> normals) {
  std::vector<float> values(points.size());
  backend.evaluate(points, values, normals);
  for_each_index(points.size(), [&](std::size_t i) { normals[i] = unit_outward(normals[i]); });
}

/// How far the middle of an edge lies from the circle through its ends with these unit normals there.
float sagitta(const Vec3& edge, const Vec3& from_normal, const Vec3& to_normal) {
  if (from_normal == Vec3(0.0f) || to_normal == Vec3(0.0f)) return 0.0f;
  return 0.125f * std::abs(glm::dot(to_normal - from_normal, edge));
}

std::vector<Vec3> summed_triangle_normals(const TriangleMesh& mesh) {
  std::vector<Vec3> sum(mesh.vertex_count(), Vec3(0.0f));
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
    const Index* v = &mesh.vertex[3 * t];
    const Vec3 &a = mesh.position(v[0]), &b = mesh.position(v[1]), &c = mesh.position(v[2]);
    for (int k = 0; k < 3; ++k) sum[v[k]] += glm::cross(b - a, c - a);
  }
  return sum;
}

/// True when two unit normals differ by more than the angle; a zero normal tells nothing.
bool differ(const Vec3& a, const Vec3& b, float cosine) {
  return glm::dot(a, b) < cosine && a != Vec3(0.0f) && b != Vec3(0.0f);
}

}  // namespace

void SplitTable::add(const KnownSplit& split) {
  if (2 * count_ >= split_.size()) grow();
  KnownSplit& place = split_[slot(split.a, split.b)];
  if (place.a != kNone) return;
  place = split;
  ++count_;
}

const KnownSplit* SplitTable::find(Index a, Index b) const {
  if (split_.empty()) return nullptr;
  const KnownSplit& place = split_[slot(a, b)];
  return place.a == kNone ? nullptr : &place;
}

/// The edge's, or the empty one that it would have.
std::size_t SplitTable::slot(Index a, Index b) const {
  std::uint64_t x = (std::uint64_t(a) << 32 | b) * 0x9e3779b97f4a7c15u;
  x ^= x >> 32;
  for (std::size_t at = x;; ++at) {
    const KnownSplit& place = split_[at & (split_.size() - 1)];
    if (place.a == kNone || (place.a == a && place.b == b)) return at & (split_.size() - 1);
  }
}

void SplitTable::grow() {
  constexpr std::size_t kFirst = 1024;
  const std::vector<KnownSplit> before =
      std::exchange(split_, std::vector<KnownSplit>(std::max(kFirst, 2 * split_.size())));
  for (const KnownSplit& split : before)
    if (split.a != kNone) split_[slot(split.a, split.b)] = split;
}

/// One refinement in progress.
class Refiner::Passes {
public:
  Passes(const TriangleMesh& mechanical, const KnownSplits* known, Backend& backend, const RefineOptions& options,
         const ProjectOptions& project)
      : known_(known),
        backend_(backend),
        project_(project),
        cosine_(float(std::cos(double(options.angle) * std::numbers::pi / 180.0))),
        shortest_(options.shortest),
        sagitta_(options.sagitta > 0.0f ? options.sagitta : std::numeric_limits<float>::infinity()) {
    out_.mesh = mechanical;
    if (known_) name_ = known_->name;
    const std::size_t vertices = mechanical.vertex_count(), triangles = triangles_ = mechanical.triangle_count();
    out_.normal.resize(vertices);
    evaluate_normals(backend, mechanical.vertices.position, out_.normal);
    out_.parent_triangle.resize(triangles);
    std::iota(out_.parent_triangle.begin(), out_.parent_triangle.end(), Index{0});
    out_.parent_edge.resize(vertices);
    for_each_index(vertices, [&](std::size_t v) { out_.parent_edge[v] = {Index(v), Index(v)}; });
    centroid_normal_.resize(triangles);
    centroid_.resize(triangles);
    std::vector<Index> all(triangles);
    std::iota(all.begin(), all.end(), Index{0});
    evaluate_centroids(all);
  }

  /// One pass; false when nothing was marked.
  bool pass() {
    ++pass_;
    mark_edges();
    if (new_edge_.empty()) return false;
    add_midpoints();
    place_new_points();
    keep_from_folding();
    split_triangles();
    return true;
  }

  Refinement finish() {
    Refinement done;
    done.first_child = begins(out_.parent_triangle, triangles_);
    done.first_vertex = begins(owner_, triangles_);
    if (!std::is_sorted(owner_.begin(), owner_.end())) sort_by_owner(done.first_vertex);
    done.geometric = std::move(out_);
    done.birth = std::move(birth_);
    done.centroid = std::move(centroid_);
    return done;
  }

  std::size_t quasi_critical() const { return quasi_critical_; }
  const TriangleMesh& mesh() const { return out_.mesh; }
  CentroidSample centroid(std::size_t triangle) const { return centroid_[triangle]; }

private:
  const Vec3& position(Index v) const { return out_.mesh.vertices.position[v]; }
  bool canonical(Index h) const { return h < mesh().twin[h]; }

  void evaluate_centroids(const std::vector<Index>& triangles) {
    std::vector<Vec3> points(triangles.size()), gradients(triangles.size());
    std::vector<float> values(triangles.size());
    for_each_index(triangles.size(), [&](std::size_t i) {
      const Index* v = &mesh().vertex[3 * std::size_t(triangles[i])];
      points[i] = (position(v[0]) + position(v[1]) + position(v[2])) / 3.0f;
    });
    backend_.evaluate(points, values, gradients);
    for_each_index(triangles.size(), [&](std::size_t i) {
      centroid_normal_[triangles[i]] = unit_outward(gradients[i]);
      centroid_[triangles[i]] = {values[i], glm::length(gradients[i])};
    });
  }

  bool centroid_off(std::size_t triangle) const {
    const auto [value, slope] = centroid_[triangle];
    return std::abs(value) > kCentroid * sagitta_ * slope;
  }

  /// Fills middle_ (the new vertex of each halfedge's edge, or kNone) and new_edge_ (one halfedge of each marked edge).
  void mark_edges() {
    const std::size_t halfedges = mesh().vertex.size();
    const std::vector<std::uint8_t> open = open_triangles();
    const auto is_open = [&](Index t) { return open.empty() || open[t]; };
    const auto turns = [&](Index h) {
      const Index twin = mesh().twin[h];
      return twin != kNone && differ(centroid_normal_[h / 3], centroid_normal_[twin / 3], cosine_);
    };
    new_edge_ = indices_where(halfedges, [&](Index h) {
      const Index twin = mesh().twin[h];
      if (!canonical(h)) return false;
      if (is_known(h)) return known_split(h) != nullptr;
      if (!is_open(h / 3) && !is_open(twin / 3)) return false;
      const Index a = mesh().from(h), b = mesh().to(h);
      const Vec3 edge = position(b) - position(a);
      const bool wanted = differ(out_.normal[a], out_.normal[b], cosine_) ||
                          sagitta(edge, out_.normal[a], out_.normal[b]) > sagitta_ || centroid_off(h / 3) ||
                          centroid_off(twin / 3) || turns(TriangleMesh::next(h)) || turns(TriangleMesh::prev(h)) ||
                          turns(TriangleMesh::next(twin)) || turns(TriangleMesh::prev(twin));
      const float length = glm::length(edge);
      return wanted && length >= shortest_ && length > 0.0f;
    });
    middle_.assign(halfedges, kNone);
    const Index first = Index(mesh().vertex_count());
    for_each_index(new_edge_.size(), [&](std::size_t i) {
      const Index h = new_edge_[i], twin = mesh().twin[h];
      middle_[h] = first + Index(i);
      if (twin != kNone) middle_[twin] = middle_[h];
    });
  }

  /// One byte a triangle: those that the last pass made, and their neighbours. What is not about any was not marked in
  /// the last pass, and nothing that edges are marked for has changed since. Empty: all.
  std::vector<std::uint8_t> open_triangles() const {
    if (fresh_.empty()) return {};
    std::vector<std::uint8_t> open(mesh().triangle_count());
    for_each_index(open.size(), [&](std::size_t t) {
      const auto is_fresh = [&](Index h) { return mesh().twin[h] != kNone && fresh_[mesh().twin[h] / 3]; };
      open[t] = fresh_[t] || is_fresh(Index(3 * t)) || is_fresh(Index(3 * t + 1)) || is_fresh(Index(3 * t + 2));
    });
    return open;
  }

  bool is_known(Index h) const {
    const auto known = [&](Index k) { return known_->triangle[out_.parent_triangle[k / 3]] != 0; };
    return known_ && (mesh().twin[h] == kNone || known(h) || known(mesh().twin[h]));
  }

  /// Of an edge that is split in this pass, else null.
  const KnownSplit* known_split(Index h) const {
    const Index from = name_[mesh().from(h)], to = name_[mesh().to(h)];
    const KnownSplit* const found = known_->split.find(std::min(from, to), std::max(from, to));
    return found && found->pass == pass_ ? found : nullptr;
  }

  Vec3 midpoint(Index h) const { return 0.5f * (position(mesh().from(h)) + position(mesh().to(h))); }

  void add_midpoints() {
    const std::size_t first = mesh().vertex_count(), count = new_edge_.size();
    VertexTable& table = out_.mesh.vertices;
    table.resize(first + count);
    out_.normal.resize(first + count);
    out_.parent_edge.resize(first + count);
    owner_.resize(owner_.size() + count);
    birth_.resize(owner_.size(), {std::uint16_t(pass_), 0});
    if (known_) name_.resize(first + count, kNone);
    for_each_index(count, [&](std::size_t i) {
      const Index h = new_edge_[i], a = mesh().from(h), b = mesh().to(h);
      const std::size_t v = first + i;
      table.position[v] = midpoint(h);
      table.rest[v] = 0.5f * (table.rest[a] + table.rest[b]);
      table.velocity[v] = 0.5f * (table.velocity[a] + table.velocity[b]);
      table.age[v] = std::min(table.age[a], table.age[b]);
      table.id[v] = out_.mesh.next_id + Index(i);
      out_.parent_edge[v] = {a, b};
      owner_[owner_.size() - count + i] = out_.parent_triangle[h / 3];
      if (known_ && is_known(h)) name_[v] = known_split(h)->middle;
    });
    out_.mesh.next_id += Index(count);
  }

  std::span<Vec3> new_positions() { return std::span(out_.mesh.vertices.position).last(new_edge_.size()); }
  std::span<Vec3> new_normals() { return std::span(out_.normal).last(new_edge_.size()); }

  void place_new_points() {
    const std::span<Vec3> points = new_positions();
    std::vector<ProjectStatus> status(points.size());
    quasi_critical_ += backend_.project(points, project_, status).quasi_critical;
    for_each_index(points.size(), [&](std::size_t i) {
      const Index h = new_edge_[i];
      const float edge = glm::length(position(mesh().to(h)) - position(mesh().from(h)));
      if (!(glm::length(points[i] - midpoint(h)) <= kMaxTravel * edge)) points[i] = midpoint(h);
    });
    evaluate_normals(backend_, points, new_normals());
  }

  /// The global vertex of a pattern's local one.
  Index vertex_of(std::size_t t, int local) const {
    return local < 3 ? mesh().vertex[3 * t + local] : middle_[3 * t + local - 3];
  }

  unsigned marks_of(std::size_t t) const {
    return unsigned(middle_[3 * t] != kNone) | unsigned(middle_[3 * t + 1] != kNone) << 1 |
           unsigned(middle_[3 * t + 2] != kNone) << 2;
  }

  /// Of the two diagonals of a 1-to-3 split the one whose end normals differ less; of equal ones the shorter.
  const SplitPattern& pattern_of(std::size_t t) const {
    const unsigned marked = marks_of(t);
    if (marked != 3 && marked != 5 && marked != 6) return split_pattern(marked, false);
    const int k = first_marked_edge(marked);
    const Index a = vertex_of(t, k), b = vertex_of(t, 3 + (k + 1) % 3);
    const Index c = vertex_of(t, (k + 2) % 3), d = vertex_of(t, 3 + k);
    const float bend1 = glm::dot(out_.normal[a], out_.normal[b]), bend2 = glm::dot(out_.normal[c], out_.normal[d]);
    const float length1 = glm::length(position(b) - position(a)), length2 = glm::length(position(d) - position(c));
    return split_pattern(marked, bend2 > bend1 || (bend2 == bend1 && length2 < length1));
  }

  bool folded(const std::array<Index, 3>& v) const {
    const Vec3 ab = position(v[1]) - position(v[0]), ac = position(v[2]) - position(v[0]);
    const Vec3 bc = position(v[2]) - position(v[1]), normal = glm::cross(ab, ac);
    const float longest2 = std::max({glm::dot(ab, ab), glm::dot(ac, ac), glm::dot(bc, bc)});
    if (glm::length(normal) <= kNoArea * longest2) return true;
    return glm::dot(normal, out_.normal[v[0]]) < 0.0f && glm::dot(normal, out_.normal[v[1]]) < 0.0f &&
           glm::dot(normal, out_.normal[v[2]]) < 0.0f;
  }

  /// Puts new points of folded children back on their edges until there is none that this can help. Points only ever go
  /// back, so it ends.
  void keep_from_folding() {
    std::vector<std::uint8_t> bad(mesh().triangle_count());  // bit k: the new vertex of edge k has to go back
    std::vector<std::uint8_t> back(new_edge_.size(), 0);
    for_each_index(bad.size(), [&](std::size_t t) { bad[t] = folded_edges(t); });
    for (;;) {
      const std::vector<Index> reverted = indices_where(new_edge_.size(), [&](Index i) {
        const Index h = new_edge_[i], twin = mesh().twin[h];
        return !back[i] && ((bad[h / 3] >> h % 3 & 1) || (twin != kNone && (bad[twin / 3] >> twin % 3 & 1)));
      });
      if (reverted.empty()) return;
      put_back(reverted);
      for (const Index i : reverted) {
        const Index h = new_edge_[i], twin = mesh().twin[h];
        back[i] = 1;
        bad[h / 3] = folded_edges(h / 3);
        if (twin != kNone) bad[twin / 3] = folded_edges(twin / 3);
      }
    }
  }

  std::uint8_t folded_edges(std::size_t t) const {
    if (marks_of(t) == 0) return 0;
    const SplitPattern& pattern = pattern_of(t);
    unsigned edges = 0;
    for (int child = 0; child < pattern.count; ++child) {
      const std::int8_t* local = &pattern.corner[3 * child];
      if (!folded({vertex_of(t, local[0]), vertex_of(t, local[1]), vertex_of(t, local[2])})) continue;
      for (int k = 0; k < 3; ++k) edges |= local[k] >= 3 ? 1u << (local[k] - 3) : 0u;
    }
    return std::uint8_t(edges);
  }

  void put_back(const std::vector<Index>& new_points) {
    std::vector<Vec3> points(new_points.size()), normals(new_points.size());
    for_each_index(points.size(), [&](std::size_t i) { points[i] = midpoint(new_edge_[new_points[i]]); });
    evaluate_normals(backend_, points, normals);
    for_each_index(points.size(), [&](std::size_t i) {
      new_positions()[new_points[i]] = points[i];
      new_normals()[new_points[i]] = normals[i];
      birth_[birth_.size() - new_edge_.size() + new_points[i]].put_back = 1;
    });
  }

  /// Replaces every triangle by its children, in order, and links them.
  void split_triangles() {
    const std::size_t triangles = mesh().triangle_count();
    std::vector<const SplitPattern*> patterns(triangles);
    std::vector<Index> first(triangles + 1, 0);
    for_each_index(triangles, [&](std::size_t t) {
      patterns[t] = &pattern_of(t);
      first[t + 1] = Index(patterns[t]->count);
    });
    std::partial_sum(first.begin(), first.end(), first.begin());

    const std::size_t children = first[triangles];
    std::vector<Index> vertex(3 * children), twin(3 * children), parent(children);
    std::vector<Vec3> centroid_normal(children);
    std::vector<CentroidSample> centroid(children);
    fresh_.resize(children);
    // The child halfedge on half `half` of a parent's halfedge.
    const auto part = [&](Index h, int half) { return 3 * first[h / 3] + patterns[h / 3]->part[2 * (h % 3) + half]; };
    for_each_index(triangles, [&](std::size_t t) {
      const SplitPattern& pattern = *patterns[t];
      const Index base = 3 * first[t];
      for (int i = 0; i < 3 * pattern.count; ++i) {
        vertex[base + i] = vertex_of(t, pattern.corner[i]);
        if (pattern.twin[i] >= 0) twin[base + i] = base + Index(pattern.twin[i]);
      }
      for (Index h = Index(3 * t); h < 3 * t + 3; ++h) {
        const Index other = mesh().twin[h];
        twin[part(h, 0)] = other == kNone ? kNone : part(other, 1);
        twin[part(h, 1)] = other == kNone ? kNone : part(other, 0);
      }
      for (Index child = first[t]; child < first[t + 1]; ++child) {
        parent[child] = out_.parent_triangle[t];
        centroid_normal[child] = centroid_normal_[t];
        centroid[child] = centroid_[t];
        fresh_[child] = pattern.count > 1;
      }
    });
    constexpr std::size_t kBlock = 4096;
    const std::vector<Index> fresh = collect(triangles, kBlock, [&](Index t, std::vector<Index>& list) {
      if (patterns[t]->count == 1) return;
      for (Index child = first[t]; child < first[t + 1]; ++child) list.push_back(child);
    });
    out_.mesh.vertex = std::move(vertex);
    out_.mesh.twin = std::move(twin);
    out_.parent_triangle = std::move(parent);
    centroid_normal_ = std::move(centroid_normal);
    centroid_ = std::move(centroid);
    evaluate_centroids(fresh);
  }

  /// Counts rows by the triangle they came from: where each of those begins, and the end.
  static std::vector<Index> begins(const std::vector<Index>& came_from, std::size_t triangles) {
    std::vector<Index> first(triangles + 1, 0);
    for_each_index(came_from.size(), [&](std::size_t i) {
      std::atomic_ref<Index>(first[came_from[i] + 1]).fetch_add(1, std::memory_order_relaxed);
    });
    std::partial_sum(first.begin(), first.end(), first.begin());
    return first;
  }

  /// New vertices lie by pass; they come to lie by owner.
  void sort_by_owner(const std::vector<Index>& first_vertex) {
    const std::size_t fresh = owner_.size(), old = mesh().vertex_count() - fresh;
    std::vector<Index> next(first_vertex.begin(), first_vertex.end() - 1), row(old + fresh), place(old + fresh);
    for_each_index(old, [&](std::size_t v) { row[v] = place[v] = Index(v); });
    for_each_index(fresh, [&](std::size_t i) {  // in any order at first
      const Index at = std::atomic_ref<Index>(next[owner_[i]]).fetch_add(1, std::memory_order_relaxed);
      row[old + at] = Index(old + i);
    });
    for_each_index(triangles_, [&](std::size_t t) {
      const auto begin = row.begin() + std::ptrdiff_t(old + first_vertex[t]);
      std::sort(begin, row.begin() + std::ptrdiff_t(old + first_vertex[t + 1]));
    });
    for_each_index(fresh, [&](std::size_t i) { place[row[old + i]] = Index(old + i); });
    const std::vector<Vec3> normal = std::move(out_.normal);
    const std::vector<std::array<Index, 2>> parent = std::move(out_.parent_edge);
    const std::vector<Birth> birth = std::move(birth_);
    std::vector<Index> id = out_.mesh.vertices.id;
    out_.mesh.vertices = out_.mesh.vertices.select(row);
    out_.mesh.vertices.id = std::move(id);  // which follow the order
    out_.normal.resize(row.size());
    out_.parent_edge.resize(row.size());
    birth_.resize(fresh);
    for_each_index(row.size(), [&](std::size_t v) {
      out_.normal[v] = normal[row[v]];
      out_.parent_edge[v] = {place[parent[row[v]][0]], place[parent[row[v]][1]]};
      if (v >= old) birth_[v - old] = birth[row[v] - old];
    });
    for_each_index(mesh().vertex.size(), [&](std::size_t h) { out_.mesh.vertex[h] = place[mesh().vertex[h]]; });
  }

  const KnownSplits* known_;
  Backend& backend_;
  const ProjectOptions project_;
  const float cosine_, shortest_, sagitta_;
  GeometricMesh out_;
  std::vector<Vec3> centroid_normal_;     // field normal at each triangle's centroid
  std::vector<CentroidSample> centroid_;  // how far it lies beside the surface
  std::vector<std::uint8_t> fresh_;       // per triangle: the last pass made it
  std::vector<Index> new_edge_;           // this pass: one halfedge of each marked edge, ascending
  std::vector<Index> middle_;             // this pass: the new vertex on each halfedge's edge, kNone when unmarked
  std::vector<Index> owner_;              // per new vertex: the triangle whose edge it came on
  std::vector<Birth> birth_;              // per new vertex
  std::vector<Index> name_;               // per vertex, as in known_
  std::size_t triangles_ = 0;             // at the beginning
  int pass_ = 0;
  std::size_t quasi_critical_ = 0;
};

Refiner::Refiner(const TriangleMesh& mechanical, Backend& backend, const RefineOptions& options,
                 const ProjectOptions& project)
    : passes_(std::make_unique<Passes>(mechanical, nullptr, backend, options, project)) {
  report_.triangles = mechanical.triangle_count();
}
Refiner::Refiner(const TriangleMesh& part, const KnownSplits& known, Backend& backend, const RefineOptions& options,
                 const ProjectOptions& project)
    : passes_(std::make_unique<Passes>(part, &known, backend, options, project)) {
  report_.triangles = part.triangle_count();
}
Refiner::~Refiner() = default;

bool Refiner::pass() {
  const std::size_t vertices = mesh().vertex_count();
  if (!passes_->pass()) return false;
  ++report_.passes;
  report_.triangles = mesh().triangle_count();
  report_.new_vertices += mesh().vertex_count() - vertices;
  report_.quasi_critical = passes_->quasi_critical();
  return true;
}

const TriangleMesh& Refiner::mesh() const {
  return passes_->mesh();
}

CentroidSample Refiner::centroid(std::size_t triangle) const {
  return passes_->centroid(triangle);
}

Refinement Refiner::finish() {
  return passes_->finish();
}

GeometricMesh refine(const TriangleMesh& mechanical, Backend& backend, const RefineOptions& options,
                     const ProjectOptions& project, RefineReport* report) {
  Refiner refiner(mechanical, backend, options, project);
  while (refiner.report().passes < options.passes && refiner.pass()) {
  }
  if (report) *report = refiner.report();
  GeometricMesh geometric = refiner.finish().geometric;
  replace_zero_normals(geometric);
  return geometric;
}

void replace_zero_normals(GeometricMesh& geometric) {
  std::vector<Vec3> sum;
  for (std::size_t v = 0; v < geometric.normal.size(); ++v) {
    if (geometric.normal[v] != Vec3(0.0f)) continue;
    if (sum.empty()) sum = summed_triangle_normals(geometric.mesh);
    const float length = glm::length(sum[v]);
    geometric.normal[v] = length > 0.0f ? sum[v] / length : Vec3(0.0f, 0.0f, 1.0f);
  }
}

void flatten(GeometricMesh& geometric, const std::vector<Vec3>& bad, float radius) {
  auto& position = geometric.mesh.vertices.position;
  const std::vector<Vec3> refined = position;
  for (Index v = 0; v < position.size(); ++v) {
    const auto [a, b] = geometric.parent_edge[v];
    const auto near = [&](const Vec3& p) { return glm::distance(p, refined[v]) <= radius; };
    if (a != b && std::any_of(bad.begin(), bad.end(), near)) position[v] = 0.5f * (position[a] + position[b]);
  }
}

}  // namespace isoskin
