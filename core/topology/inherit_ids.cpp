#include "core/topology/inherit_ids.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/mesh/id_set.h"
#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/filling.h"
#include "core/topology/point_grid.h"

namespace isoskin {
namespace {

/// Some vertices: where they are and how the surface faces there.
struct Places {
  std::vector<Index> vertex;
  std::vector<Vec3> position, normal;

  void add(Index v, const Vec3& p) {
    vertex.push_back(v);
    position.push_back(p);
  }
};

/// For each of `from` the nearest of `to` that faces the same way, kNone where there is none.
std::vector<Index> nearest(const Places& from, const Places& to, float reach) {
  constexpr float kAgree = 0.5f;  // cosine
  const PointGrid grid(to.position, reach);
  std::vector<Index> found(from.position.size());
  for_each_index(found.size(), [&](std::size_t i) {
    std::pair<float, Index> best{std::numeric_limits<float>::infinity(), kNone};
    grid.near(from.position[i], [&](Index k, float square) {
      if (glm::dot(from.normal[i], to.normal[k]) > kAgree) best = std::min(best, {square, k});
    });
    found[i] = best.second;
  });
  return found;
}

}  // namespace

std::vector<Index> inherit_ids(TriangleMesh& mesh, Index first_new, const VertexTable& old, Backend& backend,
                               float reach) {
  const IdSet there(mesh.vertices.id);
  const auto is_gone = [&](Index v) { return !there.contains(old.id[v]); };
  const auto is_fresh = [&](Index v) { return mesh.vertices.id[v] >= first_new; };
  Places gone, fresh;
  for (const Index v : indices_where(old.size(), is_gone)) gone.add(v, old.position[v]);
  for (const Index v : indices_where(mesh.vertex_count(), is_fresh)) fresh.add(v, mesh.position(v));
  if (gone.vertex.empty() || fresh.vertex.empty()) return {};
  gone.normal = field_normals(gone.position, backend);
  fresh.normal = field_normals(fresh.position, backend);
  const std::vector<Index> of_fresh = nearest(fresh, gone, reach), of_gone = nearest(gone, fresh, reach);
  std::vector<Index> taken;
  for (Index i = 0; i < of_fresh.size(); ++i) {
    if (of_fresh[i] == kNone || of_gone[of_fresh[i]] != i) continue;
    taken.push_back(old.id[gone.vertex[of_fresh[i]]]);
    mesh.vertices.id[fresh.vertex[i]] = taken.back();
  }
  return taken;
}

}  // namespace isoskin
