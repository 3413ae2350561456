#include "core/topology/weld.h"

#include <algorithm>
#include <stdexcept>

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
      for (const Index h : seam.halfedge) of_filling_[snapped[mesh.from(h)]] = kept_[mesh.from(h)];
    for (Index t = 0; t < removed.size(); ++t)
      if (!removed[t]) add_kept(t);
    for (Index t = 0; t < inside.size(); ++t)
      if (inside[t])
        add(filling_vertex(filling.surface.triangle[3 * t]), filling_vertex(filling.surface.triangle[3 * t + 1]),
            filling_vertex(filling.surface.triangle[3 * t + 2]));
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
    if (subdivided <= 1) {
      // The corner opposite the subdivided edge sees every point of it.
      if (subdivided == 1) apex = apex_of(t, polygon);
      for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
        add(polygon[apex], polygon[(apex + i) % polygon.size()], polygon[(apex + i + 1) % polygon.size()]);
      return;
    }
    Vec3 sum(0.0f);
    for (const Index v : polygon) sum += result_.vertices.position[v];
    const Index center = new_vertex(sum / float(polygon.size()));
    for (std::size_t i = 0; i < polygon.size(); ++i) add(center, polygon[i], polygon[(i + 1) % polygon.size()]);
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
  std::vector<const std::vector<Index>*> path_;  // per halfedge on a border: the path, other way round
  std::vector<Index> kept_;                      // per vertex of the mesh: its number, kNone where it goes
  std::vector<Index> of_filling_;                // per vertex of the filling
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
