#include "core/topology/flaps.h"

#include <algorithm>
#include <map>

#include "core/mesh/edit.h"
#include "core/mesh/one_ring.h"

namespace isoskin {
namespace {

/// The mesh while edges are collapsed.
class Flaps {
public:
  Flaps(TriangleMesh& mesh, const Field& field, const IsFar& is_far)
      : mesh_(mesh), field_(field), is_far_(is_far), leaving_(outgoing_halfedges(mesh)), astray_(mesh.vertex.size()) {}

  /// Looks at all edges but those between frozen vertices. Whether any is astray.
  bool look(Backend& backend, const std::vector<std::uint8_t>& frozen) {
    std::vector<Index> edge;
    std::vector<Vec3> middle;
    for (Index h = 0; h < mesh_.vertex.size(); ++h) {
      const Index a = mesh_.from(h), b = mesh_.to(h);
      if (mesh_.twin[h] < h || (!frozen.empty() && frozen[a] && frozen[b])) continue;
      edge.push_back(h);
      middle.push_back(0.5f * (mesh_.position(a) + mesh_.position(b)));
    }
    std::vector<float> value(edge.size());
    std::vector<Vec3> gradient(edge.size());
    backend.evaluate(middle, value, gradient);
    bool any = false;
    for (std::size_t i = 0; i < edge.size(); ++i) {
      const bool far = is_far_(value[i], glm::length(DVec3(gradient[i])));
      astray_[edge[i]] = astray_[mesh_.twin[edge[i]]] = far;
      any |= far;
    }
    return any;
  }

  /// Collapses at each vertex with edges astray, those with most first. Returns how many went.
  std::size_t collapse() {
    std::map<Index, int> count;
    for (Index h = 0; h < astray_.size(); ++h)
      if (mesh_.vertex[h] != kNone && astray_[h]) ++count[mesh_.from(h)];
    std::vector<std::pair<int, Index>> order;
    for (const auto& [v, n] : count) order.emplace_back(-n, v);
    std::sort(order.begin(), order.end());
    std::size_t gone = 0;
    for (const auto& [n, v] : order)
      if (leaving_[v] != kNone && collapse_at(v)) ++gone;
    return gone;
  }

private:
  bool is_astray(const Vec3& a, const Vec3& b) const {
    const FieldSample at = field_.sample(0.5 * (DVec3(a) + DVec3(b)));
    return is_far_(at.value, glm::length(at.gradient));
  }

  /// Edges astray at `v` that would go, less those that would come, if it were merged along halfedge h into its end.
  int gain(Index h) const {
    int gain = 0;
    const Index g = mesh_.twin[h], u = mesh_.to(h);
    std::vector<Index> near;
    for_each_leaving(mesh_, g, [&](Index k) { near.push_back(mesh_.to(k)); });
    for_each_leaving(mesh_, h, [&](Index k) {
      gain += astray_[k] != 0;
      const Index w = mesh_.to(k);
      if (w != u && std::find(near.begin(), near.end(), w) == near.end())
        gain -= is_astray(mesh_.position(u), mesh_.position(w));
    });
    return gain;
  }

  bool collapse_at(Index v) {
    Index best = kNone;
    int most = 0;
    for_each_leaving(mesh_, leaving_[v], [&](Index h) {
      if (!link_condition(mesh_, h)) return;
      const int g = gain(h);
      if (g > most || (g == most && best != kNone && mesh_.to(h) < mesh_.to(best))) {
        most = g;
        best = h;
      }
    });
    if (best == kNone) return false;
    const Index h = mesh_.twin[best], u = mesh_.from(h);  // from what stays to what goes
    const Index g = best;
    const Index third = mesh_.from(mesh_.prev(h));
    const Index beside = mesh_.twin[mesh_.next(h)], other = mesh_.twin[mesh_.prev(g)];
    collapse_edge(mesh_, h, 0.0f);
    leaving_[v] = kNone;
    leaving_[third] = beside;
    leaving_[u] = other;
    leaving_[mesh_.to(other)] = mesh_.next(other);
    for_each_leaving(mesh_, other, [&](Index k) {
      astray_[k] = astray_[mesh_.twin[k]] = is_astray(mesh_.position(u), mesh_.position(mesh_.to(k)));
    });
    return true;
  }

  TriangleMesh& mesh_;
  const Field& field_;
  const IsFar& is_far_;
  std::vector<Index> leaving_;        // per vertex; kNone: it has gone
  std::vector<std::uint8_t> astray_;  // per halfedge
};

}  // namespace

std::size_t collapse_flaps(TriangleMesh& mesh, const Field& field, Backend& backend,
                           const std::vector<std::uint8_t>& frozen, const IsFar& is_far) {
  Flaps flaps(mesh, field, is_far);
  if (!flaps.look(backend, frozen)) return 0;
  std::size_t gone = 0;
  for (std::size_t more = flaps.collapse(); more > 0; more = flaps.collapse()) gone += more;
  if (gone > 0) compact(mesh);
  return gone;
}

}  // namespace isoskin
