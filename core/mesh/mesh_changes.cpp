#include "core/mesh/mesh_changes.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <optional>
#include <utility>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "core/disjoint_sets.h"
#include "core/mesh/id_set.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

std::vector<Index> match_vertices(const MeshCopy& before, const TriangleMesh& mesh) {
  const std::vector<Index>& id = mesh.vertices.id;
  std::vector<Index> match(id.size(), kNone);
  const std::size_t same =
      std::size_t(std::mismatch(id.begin(), id.end(), before.id.begin(), before.id.end()).first - id.begin());
  for (Index v = 0; v < same; ++v) match[v] = v;
  if (same == id.size()) return match;
  const IdSet here{std::span<const Index>(id).subspan(same)};
  std::size_t next = same;
  for (Index v = Index(same); v < id.size(); ++v) {
    while (next < before.id.size() && before.id[next] != id[v] && !here.contains(before.id[next])) ++next;
    if (next < before.id.size() && before.id[next] == id[v]) match[v] = Index(next++);
  }
  return match;
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

/// What some triangles join of some vertices, which are known by ascending names.
class Joined {
public:
  explicit Joined(const std::vector<Index>& names) : names_(names), sets_(names.size()), used_(names.size(), 0) {}

  void join(const std::array<Index, 3>& names) {
    std::array<Index, 3> corner;
    for (int k = 0; k < 3; ++k)
      corner[k] = Index(std::lower_bound(names_.begin(), names_.end(), names[k]) - names_.begin());
    for (const Index i : corner) {
      used_[i] = 1;
      sets_.unite(corner[0], i);
    }
  }
  /// By numbers among the names.
  Index find(Index i) { return sets_.root(i); }
  bool uses(Index i) const { return used_[i] != 0; }

private:
  const std::vector<Index>& names_;
  DisjointSets sets_;
  std::vector<std::uint8_t> used_;
};

/// Labels as labelled_pieces() wants them, below the number of pieces before; nothing where they may be others.
std::optional<std::vector<Index>> labels_after(const TriangleMesh& mesh, const MeshCopy& before,
                                               const MeshPieces& pieces_before, const MeshChanges& changes) {
  const std::vector<Index>& was = changes.vertex_before;
  std::vector<Index> label(mesh.vertex_count(), kNone);
  for_each_index(label.size(), [&](std::size_t v) {
    if (was[v] != kNone) label[v] = pieces_before.of_vertex[was[v]];
  });
  if (changes.gone.empty() && changes.fresh.empty()) return label;

  // The vertices of the copy have their own names, those of the mesh that are new come after them.
  const Index first_new = Index(before.id.size());
  const auto name = [&](Index v) { return was[v] == kNone ? first_new + v : was[v]; };
  const auto gone_corners = [&](Index t) -> std::array<Index, 3> {
    return {before.vertex[3 * t], before.vertex[3 * t + 1], before.vertex[3 * t + 2]};
  };
  const auto fresh_corners = [&](Index t) -> std::array<Index, 3> {
    return {name(mesh.vertex[3 * t]), name(mesh.vertex[3 * t + 1]), name(mesh.vertex[3 * t + 2])};
  };
  std::vector<Index> names;
  const auto add = [&](const std::array<Index, 3>& corners) {
    names.insert(names.end(), corners.begin(), corners.end());
  };
  for (const Index t : changes.gone) add(gone_corners(t));
  for (const Index t : changes.fresh) add(fresh_corners(t));
  tbb::parallel_sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  std::vector<std::uint8_t> is_left(first_new, 0);
  for_each_index(was.size(), [&](std::size_t v) {
    if (was[v] != kNone) is_left[was[v]] = 1;
  });

  Joined gone(names), fresh(names);
  for (const Index t : changes.gone) gone.join(gone_corners(t));
  for (const Index t : changes.fresh) fresh.join(fresh_corners(t));
  std::vector<Index> fresh_of_gone(names.size(), kNone), gone_of_fresh(names.size(), kNone);
  const auto agree = [](Index& known, Index found) { return std::exchange(known, found) == found; };
  for (Index i = 0; i < names.size() && names[i] < first_new; ++i) {
    if (!is_left[names[i]]) continue;
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

}  // namespace

MeshChanges mesh_changes(const MeshCopy& before, const TriangleMesh& mesh) {
  MeshChanges changes;
  changes.vertex_before = match_vertices(before, mesh);
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
  const auto label = labels_after(mesh, before, pieces_before, changes);
  return label ? labelled_pieces(mesh, *label, pieces_before.count()) : mesh_pieces(mesh);
}

}  // namespace isoskin
