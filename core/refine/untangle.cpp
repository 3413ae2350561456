#include "core/refine/untangle.h"

#include <algorithm>
#include <utility>

#include "core/disjoint_sets.h"
#include "core/mechanics/alter.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/mesh_part.h"
#include "core/parallel.h"
#include "core/topology/point_grid.h"

namespace isoskin {

Tangles::Tangles(const TriangleMesh& skin, Faults faults, const UntangleOptions& options)
    : faults_(std::move(faults)), options_(options) {
  gather(skin, options.rings);
  ring_.resize(vertex_.size());
  for (Index h = 0; h < skin.vertex.size(); ++h)
    if (row_[skin.from(h)] != kNone) ring_[row_[skin.from(h)]].push_back(skin.to(h));
  join_parts(skin);
  for (const Index v : vertex_) before_.push_back(skin.position(v));
}

void Tangles::gather(const TriangleMesh& skin, int rings) {
  std::vector<std::uint8_t> in(skin.vertex_count());
  for (const Crossing& crossing : faults_.crossings)
    for (const Index t : {crossing.a, crossing.b})
      for (Index h = 3 * t; h < 3 * t + 3; ++h) in[skin.from(h)] = 1;
  for (int ring = 0; ring < rings; ++ring) {
    std::vector<Index> beside;
    for (Index h = 0; h < skin.vertex.size(); ++h)
      if (in[skin.from(h)] && !in[skin.to(h)]) beside.push_back(skin.to(h));
    for (const Index v : beside) in[v] = 1;
  }
  vertex_ = indices_where(in.size(), [&](Index v) { return in[v] != 0; });
  row_.assign(in.size(), kNone);
  for (Index i = 0; i < vertex_.size(); ++i) row_[vertex_[i]] = i;
}

void Tangles::join_parts(const TriangleMesh& skin) {
  DisjointSets sets(vertex_.size());
  for (Index i = 0; i < vertex_.size(); ++i)
    for (const Index v : ring_[i])
      if (row_[v] != kNone) sets.unite(i, row_[v]);
  for (const Crossing& crossing : faults_.crossings)
    sets.unite(row_[skin.vertex[3 * crossing.a]], row_[skin.vertex[3 * crossing.b]]);
  part_.resize(vertex_.size());
  for (Index i = 0; i < part_.size(); ++i) part_[i] = sets.root(i);
}

void Tangles::smooth(TriangleMesh& skin, Backend& backend, const ProjectOptions& project) const {
  std::vector<Vec3> middle(vertex_.size());
  for (int sweep = 0; sweep < options_.sweeps; ++sweep) {
    for_each_index(middle.size(), [&](std::size_t i) {
      Vec3 sum(0.0f);
      for (const Index v : ring_[i]) sum += skin.position(v);
      middle[i] = sum / float(ring_[i].size());
    });
    backend.project(middle, project, {});
    for_each_index(middle.size(), [&](std::size_t i) { skin.vertices.position[vertex_[i]] = middle[i]; });
  }
}

/// Under the number of each part; one between two parts is of both.
std::vector<int> Tangles::crossings_by_part(const TriangleMesh& skin, const std::vector<Crossing>& crossings) const {
  std::vector<int> count(vertex_.size(), 0);
  for (const Crossing& crossing : crossings)
    for (const Index t : {crossing.a, crossing.b})
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        const Index i = row_[skin.from(h)];
        if (i == kNone) continue;
        ++count[part_[i]];
        break;
      }
  return count;
}

bool Tangles::take_back(TriangleMesh& skin, const Faults& now, double reach) const {
  const std::vector<int> crossings_before = crossings_by_part(skin, faults_.crossings);
  const std::vector<int> crossings_now = crossings_by_part(skin, now.crossings);
  std::vector<Vec3> places = before_;
  for (const Index v : vertex_) places.push_back(skin.position(v));
  const PointGrid near(places, float(reach));
  std::vector<int> more_wrong(vertex_.size(), 0);
  const auto count_wrong = [&](const std::vector<Vec3>& wrong, int times) {
    for (const Vec3& place : wrong) {
      std::vector<Index> parts;
      near.near(place, [&](Index i, float) { parts.push_back(part_[i % vertex_.size()]); });
      std::sort(parts.begin(), parts.end());
      parts.erase(std::unique(parts.begin(), parts.end()), parts.end());
      for (const Index part : parts) more_wrong[part] += times;
    }
  };
  count_wrong(now.wrong, 1);
  count_wrong(faults_.wrong, -1);
  bool any = false;
  for (Index i = 0; i < vertex_.size(); ++i) {
    const Index part = part_[i];
    if (crossings_now[part] < crossings_before[part] && more_wrong[part] <= 0) continue;
    skin.vertices.position[vertex_[i]] = before_[i];
    any = true;
  }
  return any;
}

void mend_seams(TriangleMesh& skin, Index first_new, double fineness, Backend& backend, const ProjectOptions& project) {
  constexpr float kShortest = 0.4f, kLongest = 2.7f;  // of the fineness
  constexpr int kRings = 2, kPasses = 2;
  AlterOptions options;
  options.edge_length = float(fineness);
  options.shortest = kShortest;
  options.longest = kLongest;
  options.dt = 0.0f;
  options.respect_locks = false;
  const MeshPart part(skin, first_new, kRings);
  for (int pass = 0; pass < kPasses; ++pass) alter(skin, options, {}, part.frozen(skin));
  const std::vector<std::uint8_t> frozen = part.frozen(skin);
  const std::vector<Index> moved = indices_where(skin.vertex_count(), [&](Index v) { return !frozen[v]; });
  std::vector<Vec3> position(moved.size());
  for_each_index(moved.size(), [&](std::size_t i) { position[i] = skin.position(moved[i]); });
  backend.project(position, project, {});
  for_each_index(moved.size(), [&](std::size_t i) { skin.vertices.position[moved[i]] = position[i]; });
}

}  // namespace isoskin
