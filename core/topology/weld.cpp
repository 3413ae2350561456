#include "core/topology/weld.h"

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include "core/mesh/validate.h"

namespace isoskin {
namespace {

class Welder {
public:
  Welder(const TriangleMesh& mesh, const std::vector<std::uint8_t>& removed, const std::vector<Seam>& seams,
         const Filling& filling, const std::vector<std::uint8_t>& inside, const std::vector<Index>& snapped)
      : mesh_(mesh),
        filling_(filling),
        path_(mesh.vertex.size(), nullptr),
        of_filling_(filling.surface.position.size(), kNone) {
    for (const Seam& seam : seams)
      for (std::size_t i = 0; i < seam.halfedge.size(); ++i) path_[mesh.twin[seam.halfedge[i]]] = &seam.path[i];
    number_kept(removed);
    for (const Seam& seam : seams)
      for (const Index h : seam.halfedge) {
        of_filling_[snapped[mesh.from(h)]] = kept_[mesh.from(h)];
        on_seam_.insert(kept_[mesh.from(h)]);
      }
    for (Index t = 0; t < removed.size(); ++t)
      if (!removed[t]) add_kept(t);
    for (const Seam& seam : seams)
      for (const auto& path : seam.path)
        if (path.size() == 2) on_border_.insert(std::minmax(path[0], path[1]));
    for (Index t = 0; t < inside.size(); ++t)
      if (inside[t]) add_filling(t);
  }

  std::optional<Weld> result() {
    result_.next_id = next_id_;
    try {
      link_twins(result_);
    } catch (const std::invalid_argument&) {
      return std::nullopt;
    }
    if (!validate(result_)) return std::nullopt;
    return Weld{std::move(result_), first_new_};
  }

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
    if (of_filling_[v] == kNone) of_filling_[v] = new_vertex(filling_.surface.position[v]);
    return of_filling_[v];
  }

  /// The vertex that parts an edge of the filling between two vertices that stay, which may be neighbours already;
  /// kNone for other edges.
  Index middle_of_chord(Index from, Index to) {
    const bool stay = filling_vertex(from) < first_new_ && filling_vertex(to) < first_new_;
    if (!stay || on_border_.count(std::minmax(from, to))) return kNone;
    const auto [it, fresh] = middle_.try_emplace(std::minmax(from, to), kNone);
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
    const bool from_corner = subdivided == 0 || (subdivided == 1 && !on_seam_.count(polygon[apex]));
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
  std::set<Index> on_seam_;                          // vertices of the result
  std::set<std::pair<Index, Index>> on_border_;      // edges of the filling that are edges of the mesh too
  std::map<std::pair<Index, Index>, Index> middle_;  // of edges of the filling: new vertices
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
