#include "core/topology/section_cut.h"

#include <algorithm>
#include <map>
#include <set>
#include <vector>

namespace isoskin {
namespace {

/// One side of the cut: the vertex along which each crossing's border runs, and the tip of the cap.
struct CapSide {
  std::vector<Index> slot;  // a crossing
  Index tip = kNone;
};

/// The section's ends on one side: the vertex each crossing halfedge leaves from (or arrives at), and the number of the
/// run of equal ones it belongs to.
struct Runs {
  std::vector<Index> vertex;
  std::vector<std::size_t> run;
  std::size_t count = 0;
  bool simple = false;  // no vertex belongs to two runs
};

Runs runs_of(const TriangleMesh& mesh, const Section& section, bool above) {
  Runs runs;
  const std::size_t n = section.halfedge.size();
  for (const Index h : section.halfedge) runs.vertex.push_back(above ? mesh.from(h) : mesh.to(h));
  for (std::size_t k = 0; k < n; ++k) {
    if (k > 0 && runs.vertex[k] != runs.vertex[k - 1]) ++runs.count;
    runs.run.push_back(runs.count);
  }
  if (runs.vertex.front() == runs.vertex.back()) {  // the last run goes on in the first
    for (std::size_t& r : runs.run)
      if (r == runs.count) r = 0;
  } else {
    ++runs.count;
  }
  runs.count = std::max<std::size_t>(runs.count, 1);
  const std::set<Index> distinct(runs.vertex.begin(), runs.vertex.end());
  runs.simple = distinct.size() == runs.count;
  return runs;
}

/// Border of one side of the cut: the vertices there are, where they make a simple curve; else a new one for each of
/// their turns, or for each crossing where even those are too few.
CapSide cap_side(const TriangleMesh& mesh, MeshPatch& patch, const Section& section, bool above, const DVec3& tip) {
  const Runs runs = runs_of(mesh, section, above);
  CapSide side;
  if (runs.count >= 3 && runs.simple) {
    side.slot = runs.vertex;
  } else {
    std::map<std::size_t, Index> of_slot;
    for (std::size_t k = 0; k < runs.vertex.size(); ++k) {
      const std::size_t slot = runs.count >= 3 ? runs.run[k] : k;
      const auto [it, fresh] = of_slot.try_emplace(slot, kNone);
      if (fresh) it->second = patch.add_vertex(0.5 * (section.point[k] + tip), {runs.vertex[k]});
      side.slot.push_back(it->second);
    }
  }
  side.tip = patch.add_vertex(tip, runs.vertex);
  return side;
}

/// The crossed triangles cut along the slots, and the fans.
void fill_cut(const TriangleMesh& mesh, MeshPatch& patch, const Section& section, const CapSide& high,
              const CapSide& low) {
  const std::size_t n = section.halfedge.size();
  for (std::size_t k = 0; k < n; ++k) {
    const Index h = section.halfedge[k], entered = section.halfedge[(k + 1) % n];
    const Index p = mesh.from(h), m = mesh.to(h), third = mesh.from(TriangleMesh::prev(h));
    const Index a = high.slot[k], a_next = high.slot[(k + 1) % n];
    const Index b = low.slot[k], b_next = low.slot[(k + 1) % n];
    if (mesh.from(entered) == third) {  // the third corner is above
      patch.add_triangle(p, a, a_next);
      patch.add_triangle(p, a_next, third);
      patch.add_triangle(b, m, b_next);
    } else {
      patch.add_triangle(p, a, a_next);
      patch.add_triangle(b, m, third);
      patch.add_triangle(b, third, b_next);
    }
    patch.add_triangle(a_next, a, high.tip);
    patch.add_triangle(b, b_next, low.tip);
  }
}

}  // namespace

DVec3 middle_of(const Section& section) {
  DVec3 sum(0.0);
  for (const DVec3& p : section.point) sum += p;
  return sum / double(section.point.size());
}

std::pair<Index, Index> cut_and_cap(const TriangleMesh& mesh, MeshPatch& patch, const Section& section,
                                    const DVec3& high, const DVec3& low) {
  const CapSide above = cap_side(mesh, patch, section, true, high);
  const CapSide below = cap_side(mesh, patch, section, false, low);
  fill_cut(mesh, patch, section, above, below);
  std::vector<Index> ring;
  for (const Index h : section.halfedge) ring.push_back(TriangleMesh::triangle(h));
  patch.remove(ring);
  return {above.tip, below.tip};
}

}  // namespace isoskin
