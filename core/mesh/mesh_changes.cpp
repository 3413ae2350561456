#include "core/mesh/mesh_changes.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <numeric>
#include <optional>
#include <utility>

#include <tbb/parallel_for.h>

#include "core/disjoint_sets.h"
#include "core/mesh/id_set.h"
#include "core/mesh/piece_sums.h"
#include "core/mesh/ranks.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

/// Fills vertex_before, lost and added.
void match_vertices(const MeshCopy& before, const TriangleMesh& mesh, MeshChanges& changes) {
  const std::vector<Index>& id = mesh.vertices.id;
  std::vector<Index>& match = changes.vertex_before;
  match.resize(id.size());
  const std::size_t same =
      std::size_t(std::mismatch(id.begin(), id.end(), before.id.begin(), before.id.end()).first - id.begin());
  std::iota(match.begin(), match.begin() + std::ptrdiff_t(same), Index(0));
  const IdSet here{std::span<const Index>(id).subspan(same)};
  Index next = Index(same);
  const auto old_end = Index(before.id.size());
  for (Index v = Index(same); v < id.size(); ++v) {
    while (next < old_end && before.id[next] != id[v] && !here.contains(before.id[next]))
      changes.lost.push_back(next++);
    if (next < old_end && before.id[next] == id[v]) {
      match[v] = next++;
    } else {
      match[v] = kNone;
      changes.added.push_back(v);
    }
  }
  while (next < old_end) changes.lost.push_back(next++);
}

/// Walks through the triangles of both meshes that have all their vertices in both, unmoved.
class Walk {
public:
  Walk(const MeshCopy& before, const TriangleMesh& mesh, MeshChanges& changes)
      : before_(before), mesh_(mesh), changes_(changes), vertex_now_(before.id.size(), kNone) {
    for_each_index(changes.vertex_before.size(), [&](std::size_t v) {
      if (!changes.moved[v]) vertex_now_[changes.vertex_before[v]] = Index(v);
    });
  }

  void run() {
    for (;;) {
      pass_over_others();
      if (old_ == old_end() || now_ == now_end()) break;
      if (same(old_, now_))
        pass_over_same();
      else
        pass_over_difference();
    }
    for (; old_ < old_end(); ++old_) changes_.gone.push_back(old_);
    for (; now_ < now_end(); ++now_) changes_.fresh.push_back(now_);
  }

private:
  Index old_end() const { return Index(before_.vertex.size() / 3); }
  Index now_end() const { return Index(mesh_.triangle_count()); }
  Index vertex_now(Index t, int k) const { return vertex_now_[before_.vertex[3 * t + Index(k)]]; }
  bool stays(Index t) const {
    return vertex_now(t, 0) != kNone && vertex_now(t, 1) != kNone && vertex_now(t, 2) != kNone;
  }
  bool stayed(Index t) const {
    const Index* v = &mesh_.vertex[3 * t];
    return !(changes_.moved[v[0]] | changes_.moved[v[1]] | changes_.moved[v[2]]);
  }
  bool same(Index t, Index now) const {
    const Index* v = &mesh_.vertex[3 * now];
    return vertex_now(t, 0) == v[0] && vertex_now(t, 1) == v[1] && vertex_now(t, 2) == v[2];
  }

  void pass_over_others() {
    for (; old_ < old_end() && !stays(old_); ++old_) changes_.gone.push_back(old_);
    for (; now_ < now_end() && !stayed(now_); ++now_) changes_.fresh.push_back(now_);
  }

  /// Over all that goes on the same, in stretches that grow and are looked over in parallel.
  void pass_over_same() {
    constexpr Index kFirst = 16, kMost = 1 << 18;
    for (Index stretch = kFirst;; stretch = std::min(2 * stretch, kMost)) {
      const Index most = std::min({stretch, old_end() - old_, now_end() - now_}), same = count_same(most);
      old_ += same, now_ += same;
      if (same < stretch) return;
    }
  }

  /// How many of the next triangles go on the same, at most `most`.
  Index count_same(Index most) const {
    constexpr Index kBlock = 4096;
    std::atomic<Index> first{most};
    tbb::parallel_for(Index{0}, (most + kBlock - 1) / kBlock, [&](Index block) {
      if (first.load(std::memory_order_relaxed) < block * kBlock) return;
      for (Index i = block * kBlock; i < std::min(most, (block + 1) * kBlock); ++i) {
        if (same(old_ + i, now_ + i)) continue;
        for (Index seen = first; i < seen && !first.compare_exchange_weak(seen, i);) {
        }
        return;
      }
    });
    return first;
  }

  /// To the next triangle of either that is the other's, if there is one near, else over both.
  void pass_over_difference() {
    constexpr Index kNear = 32;
    for (Index ahead = 1; ahead <= kNear; ++ahead) {
      if (old_ + ahead < old_end() && same(old_ + ahead, now_)) {
        for (; ahead > 0; --ahead) changes_.gone.push_back(old_++);
        return;
      }
      if (now_ + ahead < now_end() && same(old_, now_ + ahead)) {
        for (; ahead > 0; --ahead) changes_.fresh.push_back(now_++);
        return;
      }
    }
    changes_.gone.push_back(old_++);
    changes_.fresh.push_back(now_++);
  }

  const MeshCopy& before_;
  const TriangleMesh& mesh_;
  MeshChanges& changes_;
  std::vector<Index> vertex_now_;  // per vertex of the copy, kNone where it is gone or has moved
  Index old_ = 0, now_ = 0;
};

/// What some triangles join of some vertices, which are known by names.
class Joined {
public:
  Joined(const Ranks& names, std::size_t count) : names_(names), sets_(count), used_(count, 0) {}

  void join(const std::array<Index, 3>& names) {
    const Index first = names_.below(names[0]);
    for (const Index name : names) {
      const Index i = names_.below(name);
      used_[i] = 1;
      sets_.unite(first, i);
    }
  }
  /// By numbers among the names.
  Index find(Index i) { return sets_.root(i); }
  bool uses(Index i) const { return used_[i] != 0; }

private:
  const Ranks& names_;
  DisjointSets sets_;
  std::vector<std::uint8_t> used_;
};

/// The pieces before that the vertices added are of, in order (kNone: unused); nothing where what hangs together may be
/// another.
std::optional<std::vector<Index>> pieces_of_added(const TriangleMesh& mesh, const MeshCopy& before,
                                                  const MeshPieces& pieces_before, const MeshChanges& changes) {
  const std::vector<Index>& was = changes.vertex_before;
  std::vector<Index> label(changes.added.size(), kNone);
  if (changes.gone.empty() && changes.fresh.empty()) return label;

  // The vertices of the copy have their own names, those of the mesh that are new come after them.
  const Index first_new = Index(before.id.size());
  const Ranks added(mesh.vertex_count(), changes.added), lost(first_new, changes.lost);
  const auto name = [&](Index v) { return was[v] == kNone ? first_new + added.below(v) : was[v]; };
  const auto gone_corners = [&](Index t) -> std::array<Index, 3> {
    return {before.vertex[3 * t], before.vertex[3 * t + 1], before.vertex[3 * t + 2]};
  };
  const auto fresh_corners = [&](Index t) -> std::array<Index, 3> {
    return {name(mesh.vertex[3 * t]), name(mesh.vertex[3 * t + 1]), name(mesh.vertex[3 * t + 2])};
  };
  std::vector<Index> corners(3 * (changes.gone.size() + changes.fresh.size()));
  const auto list = [&](const std::vector<Index>& triangles, std::size_t from, const auto& corners_of) {
    for_each_index(triangles.size(), [&](std::size_t i) {
      const std::array<Index, 3> three = corners_of(triangles[i]);
      std::copy(three.begin(), three.end(), corners.begin() + std::ptrdiff_t(from + 3 * i));
    });
  };
  list(changes.gone, 0, gone_corners);
  list(changes.fresh, 3 * changes.gone.size(), fresh_corners);
  const Ranks ranks(first_new + changes.added.size(), corners);
  const std::vector<Index> names = ranks.numbers();

  Joined gone(ranks, names.size()), fresh(ranks, names.size());
  for (const Index t : changes.gone) gone.join(gone_corners(t));
  for (const Index t : changes.fresh) fresh.join(fresh_corners(t));
  std::vector<Index> fresh_of_gone(names.size(), kNone), gone_of_fresh(names.size(), kNone);
  const auto agree = [](Index& known, Index found) { return std::exchange(known, found) == found; };
  for (Index i = 0; i < names.size() && names[i] < first_new; ++i) {
    if (lost.contains(names[i])) continue;
    if (!gone.uses(i) || !fresh.uses(i)) return std::nullopt;
    const Index a = gone.find(i), b = fresh.find(i);
    const bool known = fresh_of_gone[a] != kNone || gone_of_fresh[b] != kNone;
    if (!(agree(fresh_of_gone[a], b) & agree(gone_of_fresh[b], a)) && known) return std::nullopt;
  }
  for (Index i = 0; i < names.size(); ++i) {
    if (names[i] < first_new) continue;
    const Index like = gone_of_fresh[fresh.find(i)];
    if (like == kNone) return std::nullopt;  // a piece that was not there
    label[names[i] - first_new] = pieces_before.of_vertex[names[like]];
  }
  return label;
}

/// Nothing where pieces have gone or have another order, or new vertices are not the last.
std::optional<MeshPieces> pieces_after(const TriangleMesh& mesh, const MeshCopy& before,
                                       const MeshPieces& pieces_before, const MeshChanges& changes,
                                       const std::vector<Index>& of_added) {
  const std::size_t left = mesh.vertex_count() - changes.added.size();
  if (!changes.added.empty() && changes.added.front() != left) return std::nullopt;
  MeshPieces pieces;
  pieces.of_vertex.resize(mesh.vertex_count());
  for_each_index(left, [&](std::size_t v) { pieces.of_vertex[v] = pieces_before.of_vertex[changes.vertex_before[v]]; });
  std::copy(of_added.begin(), of_added.end(), pieces.of_vertex.begin() + std::ptrdiff_t(left));

  std::vector<int> vertices(pieces_before.count());
  for (std::size_t p = 0; p < vertices.size(); ++p)
    vertices[p] = pieces_before.euler[p] + pieces_before.triangles[p] / 2;
  for (const Index v : changes.lost)
    if (const Index p = pieces_before.of_vertex[v]; p != kNone) --vertices[p];
  for (const Index p : of_added)
    if (p != kNone) ++vertices[p];
  pieces.first = pieces_before.first;
  const Ranks lost(before.id.size(), changes.lost);
  for (Index p = 0; p < vertices.size(); ++p) {
    if (vertices[p] == 0) return std::nullopt;
    const bool goes = lost.contains(pieces.first[p]);
    Index v = pieces.first[p] - lost.below(pieces.first[p]);
    while (goes && pieces.of_vertex[v] != p) ++v;
    pieces.first[p] = v;
  }
  if (!std::is_sorted(pieces.first.begin(), pieces.first.end())) return std::nullopt;

  pieces.triangles = pieces_before.triangles;
  pieces.solid = pieces_before.solid;
  add_triangles(
      changes.gone.size(), [&](std::size_t i) { return changes.gone[i]; }, before.vertex, before.position,
      pieces_before.of_vertex, -1, pieces);
  add_triangles(
      changes.fresh.size(), [&](std::size_t i) { return changes.fresh[i]; }, mesh.vertex, mesh.vertices.position,
      pieces.of_vertex, 1, pieces);
  for (std::size_t p = 0; p < vertices.size(); ++p) {
    pieces.euler.push_back(vertices[p] - pieces.triangles[p] / 2);
    pieces.volume.push_back(pieces.solid[p].volume());
  }
  return pieces;
}

}  // namespace

MeshChanges mesh_changes(const MeshCopy& before, const TriangleMesh& mesh) {
  MeshChanges changes;
  match_vertices(before, mesh, changes);
  changes.moved.resize(mesh.vertex_count());
  for_each_index(mesh.vertex_count(), [&](std::size_t v) {
    const Index was = changes.vertex_before[v];
    changes.moved[v] = was == kNone || std::memcmp(&before.position[was], &mesh.position(Index(v)), sizeof(Vec3)) != 0;
  });
  Walk(before, mesh, changes).run();
  return changes;
}

MeshPieces mesh_pieces(const TriangleMesh& mesh, const MeshCopy& before, const MeshPieces& pieces_before,
                       const MeshChanges& changes) {
  constexpr std::size_t kMostChanged = 8;  // one in so many triangles; where more have, joining all takes no longer
  if (changes.fresh.size() * kMostChanged > mesh.triangle_count()) return mesh_pieces(mesh);
  const auto of_added = pieces_of_added(mesh, before, pieces_before, changes);
  if (!of_added) return mesh_pieces(mesh);
  const auto pieces = pieces_after(mesh, before, pieces_before, changes, *of_added);
  return pieces ? *pieces : mesh_pieces(mesh);
}

}  // namespace isoskin
