#include "core/mesh/mesh_changes.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <numeric>
#include <optional>
#include <utility>

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

using Corners = std::array<Index, 3>;

/// Walks through the triangles of both meshes that have all their vertices in both, unmoved.
class Walk {
public:
  Walk(const MeshCopy& before, const TriangleMesh& mesh, MeshChanges& changes)
      : before_(before), mesh_(mesh), changes_(changes), vertex_now_(before.id.size(), kNone) {
    for (Index v = 0; v < changes.vertex_before.size(); ++v)
      if (!changes.moved[v]) vertex_now_[changes.vertex_before[v]] = v;
  }

  void run() {
    for (;;) {
      pass_over_others();
      if (old_ == old_end() || now_ == now_end()) break;
      if (same(old_, now_))
        ++old_, ++now_;
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

/// What some triangles join of the vertices of both meshes: those of the copy, then those of the mesh that are new.
class Joined {
public:
  explicit Joined(std::size_t vertices) : parent_(vertices), used_(vertices, 0) {
    std::iota(parent_.begin(), parent_.end(), Index{0});
  }

  void join(Index a, Index b, Index c) {
    used_[a] = used_[b] = used_[c] = 1;
    const Index root = std::min({find(a), find(b), find(c)});
    for (const Index v : {a, b, c}) parent_[find(v)] = root;
  }
  Index find(Index v) {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }
  bool uses(Index v) const { return used_[v] != 0; }

private:
  std::vector<Index> parent_;
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

  const Index first_new = Index(before.id.size());
  const auto name = [&](Index v) { return was[v] == kNone ? first_new + v : was[v]; };
  Joined gone(first_new), fresh(first_new + mesh.vertex_count());
  for (const Index t : changes.gone) {
    const Index* v = &before.vertex[3 * t];
    gone.join(v[0], v[1], v[2]);
  }
  for (const Index t : changes.fresh) {
    const Index* v = &mesh.vertex[3 * t];
    fresh.join(name(v[0]), name(v[1]), name(v[2]));
  }
  std::vector<Index> fresh_of_gone(first_new, kNone), gone_of_fresh(first_new + mesh.vertex_count(), kNone);
  const auto agree = [](Index& known, Index found) { return std::exchange(known, found) == found; };
  for (Index v = 0; v < label.size(); ++v) {
    if (was[v] == kNone || (!gone.uses(was[v]) && !fresh.uses(was[v]))) continue;
    if (!gone.uses(was[v]) || !fresh.uses(was[v])) return std::nullopt;
    const Index a = gone.find(was[v]), b = fresh.find(was[v]);
    const bool known = fresh_of_gone[a] != kNone || gone_of_fresh[b] != kNone;
    if (!(agree(fresh_of_gone[a], b) & agree(gone_of_fresh[b], a)) && known) return std::nullopt;
  }
  for (Index v = 0; v < label.size(); ++v) {
    if (was[v] != kNone || !fresh.uses(name(v))) continue;
    const Index like = gone_of_fresh[fresh.find(name(v))];
    if (like == kNone) return std::nullopt;  // a piece that was not there
    label[v] = pieces_before.of_vertex[like];
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
