#include "core/topology/inherit_ids.h"

#include <algorithm>
#include <limits>
#include <utility>

#include <tbb/parallel_sort.h>

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
  std::vector<Index> there = mesh.vertices.id;
  tbb::parallel_sort(there);
  Places gone, fresh;
  for (Index v = 0; v < old.size(); ++v)
    if (!std::binary_search(there.begin(), there.end(), old.id[v])) gone.add(v, old.position[v]);
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    if (mesh.vertices.id[v] >= first_new) fresh.add(v, mesh.position(v));
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
