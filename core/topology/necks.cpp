#include "core/topology/necks.h"

#include <algorithm>

#include "core/mesh/one_ring.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

bool on_neck(const TriangleMesh& mesh, Index leaving) {
  thread_local std::vector<Index> ring;
  ring.clear();
  for_each_leaving(mesh, leaving, [&](Index k) { ring.push_back(mesh.to(k)); });
  bool found = false;
  for_each_leaving(mesh, leaving, [&](Index k) {
    const Index left = mesh.from(TriangleMesh::prev(k)), right = mesh.to(TriangleMesh::next(mesh.twin[k]));
    for_each_leaving(mesh, mesh.twin[k], [&](Index g) {
      const Index w = mesh.to(g);
      found |= w != left && w != right && std::find(ring.begin(), ring.end(), w) != ring.end();
    });
  });
  return found;
}

}  // namespace

std::vector<std::uint8_t> neck_vertices(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted) {
  const std::vector<Index> outgoing = outgoing_halfedges(mesh);
  std::vector<std::uint8_t> on(mesh.vertex_count());
  for_each_index(on.size(), [&](std::size_t v) {
    on[v] = (wanted.empty() || wanted[v]) && outgoing[v] != kNone && on_neck(mesh, outgoing[v]);
  });
  return on;
}

}  // namespace isoskin
