#include "core/topology/weld.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <map>
#include <utility>

#include <tbb/parallel_sort.h>

#include "core/mesh/independent_edits.h"
#include "core/mesh/one_ring.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

class Welder {
public:
  Welder(const TriangleMesh& mesh, const std::vector<std::uint8_t>& removed, const std::vector<Seam>& seams,
         const Filling& filling, const std::vector<std::uint8_t>& inside, const std::vector<Index>& snapped)
      : mesh_(mesh),
        filling_(filling),
        path_(mesh.vertex.size(), nullptr),
        of_filling_(filling.surface.position.size(), kNone),
        copy_of_(mesh.triangle_count(), kNone) {
    for (const Seam& seam : seams)
      for (std::size_t i = 0; i < seam.halfedge.size(); ++i) path_[mesh.twin[seam.halfedge[i]]] = &seam.path[i];
    number_kept(removed);
    on_seam_.assign(first_new_, 0);
    for (const Seam& seam : seams)
      for (const Index h : seam.halfedge) {
        of_filling_[snapped[mesh.from(h)]] = kept_[mesh.from(h)];
        on_seam_[kept_[mesh.from(h)]] = 1;
      }
    copy_kept(removed);
    for (const Index t : indices_where(removed.size(), [&](Index t) { return !removed[t] && copy_of_[t] == kNone; }))
      add_kept(t);
    for (const Seam& seam : seams)
      for (const auto& path : seam.path)
        if (path.size() == 2) on_border_.emplace_back(std::minmax(path[0], path[1]));
    std::sort(on_border_.begin(), on_border_.end());
    for (const Index t : indices_where(inside.size(), [&](Index t) { return inside[t] != 0; })) add_filling(t);
  }

  std::optional<Weld> result() {
    result_.next_id = next_id_;
    if (!link() || !is_sound()) return std::nullopt;
    return Weld{std::move(result_), first_new_};
  }

private:
  void number_kept(const std::vector<std::uint8_t>& removed) {
    std::vector<std::uint8_t> used(mesh_.vertex_count(), 0);
    for_each_index(removed.size(), [&](std::size_t t) {
      for (std::size_t h = 3 * t; h < 3 * t + 3 && !removed[t]; ++h)
        std::atomic_ref(used[mesh_.vertex[h]]).store(1, std::memory_order_relaxed);
    });
    const std::vector<Index> rows = indices_where(used.size(), [&](Index v) { return used[v]; });
    kept_.assign(mesh_.vertex_count(), kNone);
    for_each_index(rows.size(), [&](std::size_t i) { kept_[rows[i]] = Index(i); });
    result_.vertices = mesh_.vertices.select(rows);
    first_new_ = Index(rows.size());
    next_id_ = mesh_.next_id;
  }

  /// Triangles that stay as they are come first, in their order.
  void copy_kept(const std::vector<std::uint8_t>& removed) {
    copied_ = indices_where(removed.size(), [&](Index t) {
      return !removed[t] && !is_subdivided(3 * t) && !is_subdivided(3 * t + 1) && !is_subdivided(3 * t + 2);
    });
    result_.vertex.resize(3 * copied_.size());
    for_each_index(copied_.size(), [&](std::size_t i) {
      copy_of_[copied_[i]] = Index(i);
      for (Index k = 0; k < 3; ++k) result_.vertex[3 * i + k] = kept_[mesh_.vertex[3 * copied_[i] + k]];
    });
  }

  /// Copies are neighbours as they were; what is left open is matched. Whether it can be.
  bool link() {
    auto& twin = result_.twin;
    twin.assign(result_.vertex.size(), kNone);
    for_each_index(copied_.size(), [&](std::size_t i) {
      for (Index k = 0; k < 3; ++k) {
        const Index g = mesh_.twin[3 * copied_[i] + k], copy = copy_of_[g / 3];
        if (copy != kNone) twin[3 * i + k] = 3 * copy + g % 3;
      }
    });
    open_ = indices_where(twin.size(), [&](Index h) { return twin[h] == kNone; });
    std::vector<std::pair<std::uint64_t, Index>> by_ends(open_.size());
    for_each_index(open_.size(), [&](std::size_t i) {
      const Index a = result_.from(open_[i]), b = result_.to(open_[i]);
      by_ends[i] = {std::uint64_t(std::min(a, b)) << 32 | std::max(a, b), open_[i]};
    });
    tbb::parallel_sort(by_ends);
    if (open_.size() % 2 != 0) return false;
    for (std::size_t i = 0; i < open_.size(); i += 2) {
      const Index g = by_ends[i].second, h = by_ends[i + 1].second;
      if (result_.from(g) != result_.to(h) || result_.to(g) != result_.from(h)) return false;
      twin[g] = h;
      twin[h] = g;
    }
    return true;
  }

  /// A closed, oriented 2-manifold (see validate()), if the mesh is one: only what touches open edges may be none.
  bool is_sound() const {
    std::vector<Index> leaving(result_.vertex_count(), kNone), corners(result_.vertex_count(), 0);
    for (const Index h : open_) leaving[result_.from(h)] = h;
    for (const Index v : result_.vertex) corners[v] += leaving[v] != kNone;
    std::atomic<bool> sound{true};
    for_each_index(leaving.size(), [&](std::size_t v) {
      if (leaving[v] != kNone && !is_one_fan(leaving[v], corners[v])) sound = false;
    });
    for_each_index(result_.triangle_count() - copied_.size(), [&](std::size_t i) {
      const Index h = 3 * Index(copied_.size() + i);
      const Index a = result_.twin[h] / 3, b = result_.twin[h + 1] / 3, c = result_.twin[h + 2] / 3;
      if (a == b || b == c || c == a) sound = false;
    });
    return sound;
  }

  /// So many triangles, with an edge to each of their other corners once, and none back to the vertex.
  bool is_one_fan(Index leaving, Index triangles) const {
    thread_local std::vector<Index> ends;
    ends.clear();
    for_each_leaving(result_, leaving, [&](Index h) { ends.push_back(result_.to(h)); });
    std::sort(ends.begin(), ends.end());
    return ends.size() == triangles && std::adjacent_find(ends.begin(), ends.end()) == ends.end() &&
           !std::binary_search(ends.begin(), ends.end(), result_.from(leaving));
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
    if (of_filling_[v] == kNone) of_filling_[v] = new_vertex(filling_.surface.position[v]);
    return of_filling_[v];
  }

  /// The vertex that parts an edge of the filling between two vertices that stay, which may be neighbours already;
  /// kNone for other edges.
  Index middle_of_chord(Index from, Index to) {
    const bool stay = filling_vertex(from) < first_new_ && filling_vertex(to) < first_new_;
    const std::pair<Index, Index> ends = std::minmax(from, to);
    if (!stay || std::binary_search(on_border_.begin(), on_border_.end(), ends)) return kNone;
    const auto [it, fresh] = middle_.try_emplace(ends, kNone);
    const auto& position = filling_.surface.position;
    if (fresh) it->second = new_vertex(0.5f * (position[from] + position[to]));
    return it->second;
  }

  void add_filling(Index t) {
    const Index* corner = &filling_.surface.triangle[3 * t];
    std::vector<Index> polygon;
    std::size_t apex = 0;
    int subdivided = 0;
    for (int k = 0; k < 3; ++k) {
      polygon.push_back(filling_vertex(corner[k]));
      const Index middle = middle_of_chord(corner[k], corner[(k + 1) % 3]);
      if (middle == kNone) continue;
      polygon.push_back(middle);
      ++subdivided;
      apex = std::size_t(k);
    }
    if (subdivided == 1) apex = (apex + 3) % 4;  // the corner opposite sees it
    add_polygon(polygon, subdivided <= 1, apex);
  }

  /// A fan about one of its corners, or about a vertex in its middle.
  void add_polygon(const std::vector<Index>& polygon, bool from_corner, std::size_t apex) {
    if (from_corner) {
      for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
        add(polygon[apex], polygon[(apex + i) % polygon.size()], polygon[(apex + i + 1) % polygon.size()]);
      return;
    }
    Vec3 sum(0.0f);
    for (const Index v : polygon) sum += result_.vertices.position[v];
    const Index center = new_vertex(sum / float(polygon.size()));
    for (std::size_t i = 0; i < polygon.size(); ++i) add(center, polygon[i], polygon[(i + 1) % polygon.size()]);
  }

  bool is_subdivided(Index h) const { return path_[h] != nullptr && path_[h]->size() > 2; }

  void add(Index a, Index b, Index c) { result_.vertex.insert(result_.vertex.end(), {a, b, c}); }

  void add_kept(Index t) {
    std::vector<Index> polygon;
    int subdivided = 0;
    std::size_t apex = 0;
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      polygon.push_back(kept_[mesh_.vertex[h]]);
      if (!is_subdivided(h)) continue;
      ++subdivided;
      const auto& path = *path_[h];  // runs the other way: from the end of h to its start
      for (std::size_t i = path.size() - 2; i > 0; --i) polygon.push_back(filling_vertex(path[i]));
    }
    if (subdivided == 1) apex = apex_of(t, polygon);  // the corner opposite sees every point of it
    // From a corner on a seam the filling may have an edge there already.
    const bool from_corner = subdivided == 1 && !on_seam_[polygon[apex]];
    add_polygon(polygon, from_corner, apex);
  }

  std::size_t apex_of(Index t, const std::vector<Index>& polygon) const {
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      if (!is_subdivided(h)) continue;
      const Index opposite = kept_[mesh_.vertex[TriangleMesh::prev(h)]];
      return std::size_t(std::find(polygon.begin(), polygon.end(), opposite) - polygon.begin());
    }
    return 0;
  }

  const TriangleMesh& mesh_;
  const Filling& filling_;
  std::vector<const std::vector<Index>*> path_;      // per halfedge on a border: the path, other way round
  std::vector<Index> kept_;                          // per vertex of the mesh: its number, kNone where it goes
  std::vector<Index> of_filling_;                    // per vertex of the filling
  std::vector<std::uint8_t> on_seam_;                // per vertex of the result that was there before
  std::vector<std::pair<Index, Index>> on_border_;   // edges of the filling that are edges of the mesh too, sorted
  std::map<std::pair<Index, Index>, Index> middle_;  // of edges of the filling: new vertices
  std::vector<Index> copied_, copy_of_;              // triangles that stay as they are; of the mesh's the copy or kNone
  std::vector<Index> open_;                          // halfedges of the result that copies do not link
  TriangleMesh result_;
  Index first_new_ = 0, next_id_ = 0;
};

}  // namespace

std::optional<Weld> weld(const TriangleMesh& mesh, const std::vector<std::uint8_t>& removed,
                         const std::vector<Seam>& seams, const Filling& filling,
                         const std::vector<std::uint8_t>& inside, const std::vector<Index>& snapped) {
  return Welder(mesh, removed, seams, filling, inside, snapped).result();
}

}  // namespace isoskin
