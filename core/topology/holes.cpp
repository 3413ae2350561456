#include "core/topology/holes.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <limits>
#include <span>
#include <utility>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/one_ring.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

/// Triangles to be removed, and those that have been.
class Removal {
public:
  Removal(const TriangleMesh& mesh, const std::vector<std::uint8_t>& hot, const std::vector<std::uint8_t>& spared)
      : mesh_(mesh), removed_(mesh.triangle_count()), leaving_(mesh.vertex_count()) {
    for_each_index(removed_.size(), [&](std::size_t t) {
      const bool touched = hot[mesh.vertex[3 * t]] || hot[mesh.vertex[3 * t + 1]] || hot[mesh.vertex[3 * t + 2]];
      removed_[t] = touched && (spared.empty() || !spared[t]);
    });
    list_ = indices_where(removed_.size(), [&](Index t) { return removed_[t]; });
  }

  /// Connected scraps of so many triangles that would stay between removed ones: they have no surroundings to be placed
  /// by.
  void remove_scraps(std::size_t most) {
    std::vector<Index> beside;
    for (const Index t : list_)
      for (Index h = 3 * t; h < 3 * t + 3; ++h)
        if (!removed_[mesh_.twin[h] / 3]) beside.push_back(mesh_.twin[h] / 3);
    std::vector<std::uint8_t> seen = removed_;
    std::vector<Index> scrap;
    for (const Index start : beside) {
      if (seen[start]) continue;
      scrap.assign(1, start);
      seen[start] = 1;
      for (std::size_t i = 0; i < scrap.size() && scrap.size() <= most; ++i)
        for (Index h = 3 * scrap[i]; h < 3 * scrap[i] + 3; ++h)
          if (const Index next = mesh_.twin[h] / 3; !seen[next]) {
            seen[next] = 1;
            scrap.push_back(next);
          }
      for (const Index t : scrap)
        if (scrap.size() <= most)
          remove(t);
        else
          seen[t] = 0;
    }
  }

  /// More, until every border is a simple closed curve.
  void widen() {
    std::vector<std::uint64_t> due((mesh_.vertex_count() + 63) / 64, 0);  // a bit a vertex
    const auto look_at = [&](Index t) {
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        leaving_[mesh_.vertex[h]] = h;
        due[mesh_.vertex[h] / 64] |= std::uint64_t(1) << mesh_.vertex[h] % 64;
      }
    };
    for (const Index t : list_) look_at(t);
    for (bool widened = true; widened;) {
      widened = false;
      for (Index w = 0; w < due.size(); ++w)
        while (due[w] != 0) {  // those that come after are looked at in the same sweep
          const Index v = 64 * w + Index(std::countr_zero(due[w]));
          due[w] &= due[w] - 1;
          int changes = 0;
          for_each_leaving(mesh_, leaving_[v],
                           [&](Index h) { changes += removed_[h / 3] != removed_[mesh_.twin[h] / 3]; });
          if (changes <= 2) continue;
          for_each_leaving(mesh_, leaving_[v], [&](Index h) {
            if (removed_[h / 3]) return;
            remove(h / 3);
            look_at(h / 3);
          });
          widened = true;
        }
    }
  }

  /// Ascending.
  std::vector<Index> triangles() {
    tbb::parallel_sort(list_);
    return std::move(list_);
  }

private:
  void remove(Index t) {
    removed_[t] = 1;
    list_.push_back(t);
  }

  const TriangleMesh& mesh_;
  std::vector<std::uint8_t> removed_;
  std::vector<Index> list_;     // of the removed triangles
  std::vector<Index> leaving_;  // per vertex of a removed triangle: a halfedge that leaves it
};

/// Counts a set of triangles' vertices, edges and faces. Edges inside the set are seen from both sides.
class EulerCount {
public:
  explicit EulerCount(std::size_t vertices) : seen_in_(vertices, kNone) {}

  void start(Index set) {
    set_ = set;
    vertices_ = faces_ = inner_halfedges_ = border_halfedges_ = 0;
  }
  void corner(Index v) {
    if (seen_in_[v] != set_) ++vertices_;
    seen_in_[v] = set_;
  }
  void face() { ++faces_; }
  void halfedge(bool border) { ++(border ? border_halfedges_ : inner_halfedges_); }
  int euler() const { return vertices_ - inner_halfedges_ / 2 - border_halfedges_ + faces_; }

private:
  std::vector<Index> seen_in_;
  Index set_ = kNone;
  int vertices_ = 0, faces_ = 0, inner_halfedges_ = 0, border_halfedges_ = 0;
};

/// `removed`: ascending.
void number_holes(const TriangleMesh& mesh, const std::vector<Index>& removed, Holes& holes) {
  constexpr Index kUnnumbered = kNone - 1;
  holes.of_triangle.assign(mesh.triangle_count(), kNone);
  for (const Index t : removed) holes.of_triangle[t] = kUnnumbered;
  EulerCount count(mesh.vertex_count());
  for (const Index start : removed) {
    if (holes.of_triangle[start] != kUnnumbered) continue;
    const Index hole = holes.count();
    count.start(hole);
    std::vector<Index> stack(1, start);
    holes.of_triangle[start] = hole;
    while (!stack.empty()) {
      const Index t = stack.back();
      stack.pop_back();
      count.face();
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        count.corner(mesh.vertex[h]);
        const Index next = mesh.twin[h] / 3;
        count.halfedge(holes.of_triangle[next] == kNone);
        if (holes.of_triangle[next] != kUnnumbered) continue;
        holes.of_triangle[next] = hole;
        stack.push_back(next);
      }
    }
    holes.euler.push_back(count.euler());
  }
}

void find_seams(const TriangleMesh& mesh, const std::vector<Index>& removed, Holes& holes) {
  const auto is_removed = [&](Index h) { return holes.of_triangle[h / 3] != kNone; };
  const auto on_border = [&](Index h) { return is_removed(h) && !is_removed(mesh.twin[h]); };
  std::vector<std::uint8_t> seen(mesh.vertex.size(), 0);
  const auto follow = [&](Index start) {
    Seam seam;
    seam.hole = holes.of_triangle[start / 3];
    Index h = start;
    do {
      seen[h] = 1;
      seam.halfedge.push_back(h);
      h = TriangleMesh::next(h);
      while (!on_border(h)) h = TriangleMesh::next(mesh.twin[h]);
    } while (h != start);
    holes.seams.push_back(std::move(seam));
  };
  for (const Index t : removed)
    for (Index h = 3 * t; h < 3 * t + 3; ++h)
      if (!seen[h] && on_border(h)) follow(h);
}

/// Marks seams that cannot be snapped.
std::vector<Index> snap(const TriangleMesh& mesh, const std::vector<Vec3>& normals, std::vector<Seam>& seams,
                        const GrowingFilling& filling) {
  constexpr float kAgree = 0.3f;  // cosine between normals
  const auto nearest = [&](Index v, const auto& is_free) {
    std::pair<float, Index> best{std::numeric_limits<float>::infinity(), kNone};
    filling.near().near(mesh.position(v), [&](Index candidate, float square) {
      if (glm::dot(normals[v], filling->normal[candidate]) > kAgree && is_free(candidate))
        best = std::min(best, {square, candidate});
    });
    return best.second;
  };
  std::vector<Index> border, target;
  for (const Seam& seam : seams) border.insert(border.end(), seam.halfedge.begin(), seam.halfedge.end());
  target.resize(border.size());
  tbb::parallel_for(std::size_t{0}, border.size(),
                    [&](std::size_t i) { target[i] = nearest(mesh.from(border[i]), [](Index) { return true; }); });
  // Few want what another has taken before them.
  std::vector<Index> snapped(mesh.vertex_count(), kNone);
  std::vector<std::uint8_t> taken(filling->surface.position.size(), 0);
  auto next = target.begin();
  for (Seam& seam : seams) {
    for (const Index h : seam.halfedge) {
      Index to = *next++;
      if (to != kNone && taken[to]) to = nearest(mesh.from(h), [&](Index candidate) { return !taken[candidate]; });
      if (to == kNone) {
        seam.failed_at.push_back(h);
        continue;
      }
      taken[to] = 1;
      snapped[mesh.from(h)] = to;
    }
    seam.failed = !seam.failed_at.empty();
  }
  return snapped;
}

/// The paths of all seams together: each is the shortest that keeps off those before it.
void trace_paths(const TriangleMesh& mesh, std::vector<Seam>& seams, const GrowingFilling& filling,
                 const std::vector<Index>& snapped, double spacing) {
  constexpr float kSlack = 4.0f;  // in lattice spacings: how much longer than the edge a path may be
  std::vector<std::uint8_t> used(filling->surface.position.size(), 0);
  for (const Index target : snapped)
    if (target != kNone) used[target] = 1;
  std::vector<std::pair<Index, Index>> edges;  // seam, its halfedge
  for (Index s = 0; s < seams.size(); ++s) {
    if (seams[s].failed) continue;
    seams[s].path.resize(seams[s].halfedge.size());
    for (Index i = 0; i < seams[s].halfedge.size(); ++i) edges.emplace_back(s, i);
  }
  const auto find = [&](Index h) {
    return filling.paths().path(snapped[mesh.from(h)], snapped[mesh.to(h)], used, kSlack * float(spacing));
  };
  // Most paths are far from each other: only those that meet one before them are to be found again, in order.
  tbb::parallel_for(std::size_t{0}, edges.size(), [&](std::size_t e) {
    Seam& seam = seams[edges[e].first];
    seam.path[edges[e].second] = find(seam.halfedge[edges[e].second]);
  });
  for (const auto& [s, i] : edges) {
    std::vector<Index>& path = seams[s].path[i];
    const bool meets =
        path.size() > 2 && std::any_of(path.begin() + 1, path.end() - 1, [&](Index v) { return used[v]; });
    if (meets) path = find(seams[s].halfedge[i]);
    if (path.empty()) seams[s].failed_at.push_back(seams[s].halfedge[i]);
    for (const Index v : path) used[v] = 1;
  }
  for (Seam& seam : seams) seam.failed |= !seam.failed_at.empty();
}

/// The directed edges of all complete paths, with their seams.
class Barriers {
public:
  Barriers(const std::vector<Seam>& seams, std::size_t vertices) : last_(vertices, kNone) {
    for (Index s = 0; s < seams.size(); ++s)
      if (seams[s].failed_at.empty())
        for (const auto& path : seams[s].path)
          for (std::size_t i = 0; i + 1 < path.size(); ++i) {
            edge_.push_back({path[i + 1], s, last_[path[i]]});
            last_[path[i]] = Index(edge_.size() - 1);
          }
  }

  /// The seam whose path runs from a to b, kNone if none does.
  Index seam(Index a, Index b) const {
    for (Index e = last_[a]; e != kNone; e = edge_[e].before)
      if (edge_[e].to == b) return edge_[e].seam;
    return kNone;
  }

private:
  struct Edge {
    Index to, seam;
    Index before;  // another edge from the same vertex
  };
  std::vector<Edge> edge_;
  std::vector<Index> last_;  // per vertex: its last edge
};

/// Floods patches from all seams at once. Where the floods of several seams meet, they are of one patch.
class PatchFlood {
public:
  PatchFlood(std::vector<Seam>& seams, const Filling& filling)
      : seams_(seams),
        filling_(filling),
        wall_(filling.twin.size(), 0),
        on_path_(filling.surface.position.size(), 0),
        seen_(on_path_.size(), 0),
        of_triangle_(filling.triangle_count(), kNone),
        flood_(seams.size()),
        joined_(seams.size()) {
    tbb::parallel_for(Index(0), Index(seams.size()), [&](Index s) { raise_walls(s); });
    tbb::parallel_for(Index(0), Index(seams.size()), [&](Index s) { flood(s); });
  }

  /// Numbered by their first seam.
  Patches patches() && {
    Patches out;
    std::vector<Index> number(seams_.size(), kNone);
    std::vector<Flood> sum;
    for (Index s = 0; s < seams_.size(); ++s) {
      if (flood_[s].start.empty()) continue;
      const Index first = joined_.root(s);
      if (first == s) {
        number[s] = Index(sum.size());
        sum.emplace_back();
        out.seams.emplace_back();
      }
      number[s] = number[first];
      out.seams[number[s]].push_back(s);
      sum[number[s]].add(flood_[s]);
    }
    for (const Flood& f : sum) {
      out.euler.push_back(f.leaks ? 0 : f.euler());
      out.leaks.push_back(f.leaks);
    }
    // How far a patch that leaks was followed depends on threads.
    tbb::parallel_for(Index(0), Index(seams_.size()), [&](Index s) {
      for (const Index t : flood_[s].triangle) of_triangle_[t] = out.leaks[number[s]] ? kNone : number[s];
    });
    for (Index s = 0; s < seams_.size(); ++s) {
      if (number[s] == kNone || !out.leaks[number[s]]) continue;
      // Whoever has the outside of the filling, or of another hole, on its hole's side is wrong; others may be right.
      seams_[s].failed = true;
      for (const Index t : flood_[s].start) of_triangle_[t] = number[s];
    }
    out.of_triangle = std::move(of_triangle_);
    return out;
  }

private:
  static constexpr std::uint8_t kAlong = 1, kAgainst = 2;

  struct Flood {
    std::vector<Index> start, triangle;  // beside the seam's paths; all that were reached before any other did
    int faces = 0, inner_vertices = 0, inner_halfedges = 0;
    bool leaks = false;

    void add(const Flood& other) {
      faces += other.faces;
      inner_vertices += other.inner_vertices;
      inner_halfedges += other.inner_halfedges;
      leaks |= other.leaks;
    }
    /// Of a whole patch. Seams are closed curves that share no vertex: their vertices and edges are as many.
    int euler() const { return inner_vertices - inner_halfedges / 2 + faces; }
  };

  static bool take(std::uint8_t& flag) { return std::atomic_ref(flag).exchange(1, std::memory_order_relaxed) == 0; }
  void mark(Index h, std::uint8_t bit) {
    std::atomic_ref<std::uint8_t>(wall_[h]).fetch_or(bit, std::memory_order_relaxed);
  }
  /// kNone where no triangle has it.
  Index halfedge(Index from, Index to) const {
    const Index t = filling_.triangle(from, to);
    for (Index h = 3 * t; t != kNone && h < 3 * t + 3; ++h)
      if (filling_.surface.triangle[h] == from) return h;
    return kNone;
  }

  void raise_walls(Index s) {
    Seam& seam = seams_[s];
    if (!seam.failed_at.empty()) return;
    const bool starts = !seam.failed;
    for (const auto& path : seam.path)
      for (std::size_t i = 0; i + 1 < path.size(); ++i) {
        std::atomic_ref(on_path_[path[i]]).store(1, std::memory_order_relaxed);
        const Index h = halfedge(path[i], path[i + 1]);
        const Index g = h == kNone ? halfedge(path[i + 1], path[i]) : filling_.twin[h];
        if (h != kNone) mark(h, kAlong);
        if (g != kNone) mark(g, kAgainst);
        if (starts && h != kNone) flood_[s].start.push_back(h / 3);
        seam.failed |= h == kNone;
      }
  }

  /// Reaches the triangle, if no other flood has.
  void reach(Index t, Index s) {
    Index by = kNone;
    if (std::atomic_ref(of_triangle_[t]).compare_exchange_strong(by, s, std::memory_order_relaxed))
      flood_[s].triangle.push_back(t);
    else if (by != s)
      joined_.unite(by, s);
  }

  /// A patch that leaks is not followed any further: it may be all of the skin.
  void flood(Index s) {
    Flood& own = flood_[s];
    for (const Index t : own.start) reach(t, s);
    for (std::size_t i = 0; i < own.triangle.size() && !own.leaks; ++i) {
      const Index t = own.triangle[i];
      ++own.faces;
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        const Index v = filling_.surface.triangle[h];
        own.inner_vertices += !on_path_[v] && take(seen_[v]);
        if (wall_[h] & kAlong) continue;
        ++own.inner_halfedges;
        const Index twin = filling_.twin[h];
        own.leaks |= twin == kNone || (wall_[h] & kAgainst);
        if (!own.leaks) reach(twin / 3, s);
      }
    }
  }

  std::vector<Seam>& seams_;
  const Filling& filling_;
  std::vector<std::uint8_t> wall_;            // per halfedge: whether complete paths run along it, or against it
  std::vector<std::uint8_t> on_path_, seen_;  // per vertex
  std::vector<Index> of_triangle_;            // the seam that reached it, then its patch
  std::vector<Flood> flood_;                  // per seam; empty of those that have failed
  DisjointSets joined_;                       // seams of one patch
};

/// What skin lies on the filling.
class Covering {
public:
  Covering(const TriangleMesh& mesh, const std::vector<Vec3>& normals, const PointGrid& vertices, const Holes& holes,
           const Filling& filling)
      : normals_(normals),
        vertices_(vertices),
        filling_(filling),
        on_(filling.surface.position.size(), kUnread),
        stays_(staying_vertices(mesh, holes)) {}

  /// The vertex of the mesh nearest to one of the filling; kNone where there is none, or it goes or is on a seam.
  Index on(Index f) {
    if (on_[f] == kUnread) on_[f] = find(f);
    return on_[f];
  }
  /// All threads find what on() will be asked for: the corners of triangles beside these that are not yet seen.
  void look_ahead(std::span<const Index> triangles, const std::vector<std::uint8_t>& seen) {
    constexpr std::size_t kFew = 16;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, triangles.size(), kFew), [&](const auto& range) {
      for (std::size_t i = range.begin(); i != range.end(); ++i)
        for (Index h = 3 * triangles[i]; h < 3 * triangles[i] + 3; ++h) {
          const Index next = filling_.twin[h] == kNone ? kNone : filling_.twin[h] / 3;
          for (Index k = 3 * next; next != kNone && !seen[next] && k < 3 * next + 3; ++k) {
            const std::atomic_ref on(on_[filling_.surface.triangle[k]]);
            if (on.load(std::memory_order_relaxed) == kUnread)
              on.store(find(filling_.surface.triangle[k]), std::memory_order_relaxed);
          }
        }
    });
  }

private:
  static constexpr Index kUnread = kNone - 1;

  Index find(Index f) const {
    constexpr float kAgree = 0.5f;  // cosine between normals
    std::pair<float, Index> best{std::numeric_limits<float>::infinity(), kNone};
    vertices_.near(filling_.surface.position[f], [&](Index v, float square) {
      if (glm::dot(normals_[v], filling_.normal[f]) > kAgree) best = std::min(best, {square, v});
    });
    return best.second != kNone && stays_[best.second] ? best.second : kNone;
  }

  const std::vector<Vec3>& normals_;
  const PointGrid& vertices_;
  const Filling& filling_;
  std::vector<Index> on_;            // per vertex of the filling
  std::vector<std::uint8_t> stays_;  // per vertex of the mesh: all triangles about it do
};

}  // namespace

Holes cut_holes(const TriangleMesh& mesh, const std::vector<std::uint8_t>& hot,
                const std::vector<std::uint8_t>& spared) {
  Holes holes;
  constexpr std::size_t kScrap = 24;  // triangles
  Removal removal(mesh, hot, spared);
  removal.remove_scraps(kScrap);
  removal.widen();
  const std::vector<Index> removed = removal.triangles();
  number_holes(mesh, removed, holes);
  find_seams(mesh, removed, holes);
  return holes;
}

std::vector<std::uint8_t> staying_vertices(const TriangleMesh& mesh, const Holes& holes) {
  std::vector<std::uint8_t> stays(mesh.vertex_count(), 1);
  for_each_index(holes.of_triangle.size(), [&](std::size_t t) {
    for (std::size_t h = 3 * t; h < 3 * t + 3 && holes.of_triangle[t] != kNone; ++h)
      std::atomic_ref(stays[mesh.vertex[h]]).store(0, std::memory_order_relaxed);
  });
  return stays;
}

float seam_reach(double spacing) {
  constexpr float kReach = 2.0f;  // in lattice spacings
  return kReach * float(spacing);
}

std::vector<Index> lay_seams(const TriangleMesh& mesh, const std::vector<Vec3>& normals, Holes& holes,
                             const GrowingFilling& filling, double spacing) {
  std::vector<Index> snapped = snap(mesh, normals, holes.seams, filling);
  trace_paths(mesh, holes.seams, filling, snapped, spacing);
  return snapped;
}

Patches find_patches(Holes& holes, const Filling& filling) {
  return PatchFlood(holes.seams, filling).patches();
}

Leaks follow_leaks(const TriangleMesh& mesh, const std::vector<Vec3>& normals, const PointGrid& vertices,
                   const Holes& holes, const Filling& filling) {
  const auto& triangle = filling.surface.triangle;
  const Barriers barriers(holes.seams, filling.surface.position.size());
  Covering skin(mesh, normals, vertices, holes, filling);
  std::vector<std::uint8_t> seen(filling.triangle_count(), 0);
  std::vector<Index> queue;
  const auto reach = [&](Index t) {
    if (t == kNone || seen[t]) return;
    seen[t] = 1;
    queue.push_back(t);
  };
  for (const Seam& seam : holes.seams)
    for (std::size_t k = 0; k < seam.path.size() && seam.failed; ++k)
      for (std::size_t i = 0; i + 1 < seam.path[k].size(); ++i)
        reach(filling.triangle(seam.path[k][i], seam.path[k][i + 1]));
  Leaks leaks;
  std::vector<std::uint8_t> behind(holes.seams.size(), 0);
  std::size_t looked_ahead = 0;
  for (std::size_t i = 0; i < queue.size(); ++i) {
    if (i == looked_ahead) {
      skin.look_ahead({queue.begin() + std::ptrdiff_t(i), queue.end()}, seen);
      looked_ahead = queue.size();
    }
    for (Index h = 3 * queue[i]; h < 3 * queue[i] + 3; ++h) {
      const Index a = triangle[h], b = triangle[TriangleMesh::next(h)], twin = filling.twin[h], next = twin / 3;
      if (twin == kNone) leaks.ends.push_back(filling.surface.position[a]);
      if (barriers.seam(a, b) != kNone) continue;
      if (const Index seam = barriers.seam(b, a); seam != kNone) {
        behind[seam] = 1;
        continue;
      }
      if (twin == kNone || seen[next]) continue;
      Index met = kNone;
      for (Index k = 3 * next; k < 3 * next + 3 && met == kNone; ++k) met = skin.on(triangle[k]);
      if (met == kNone) {
        reach(next);
      } else {
        seen[next] = 1;
        leaks.skin.push_back(met);
      }
    }
  }
  for (Index s = 0; s < behind.size(); ++s)
    for (std::size_t i = 0; i < holes.seams[s].halfedge.size() && behind[s]; ++i)
      leaks.seams.push_back(mesh.from(holes.seams[s].halfedge[i]));
  return leaks;
}

}  // namespace isoskin
