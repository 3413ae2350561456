// What a refined skin shows of itself.
#include <algorithm>
#include <numeric>
#include <utility>

#include <tbb/parallel_for.h>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/refine/refined_skin.h"
#include "core/trace.h"

namespace isoskin {

const GeometricMesh& RefinedSkin::mesh() const {
  if (!ordered_) put_in_order();
  if (!carried_) carry_attributes();
  if (!normals_replaced_) replace_normals();
  return geometric_;
}

void RefinedSkin::put_in_order() const {
  const Span span("put in order");
  const std::size_t triangles = slot_.size(), corners = corner_.size();
  std::vector<Rows> child(child_.size()), fresh(fresh_.size());
  Index children = 0, all = Index(corners);
  for (const Index s : slot_) {
    child[s] = {std::exchange(children, children + child_[s].count), child_[s].count};
    fresh[s] = {std::exchange(all, all + fresh_[s].count), fresh_[s].count};
  }
  std::vector<Index> vertex_at(birth_.size(), kNone), child_at(geometric_.parent_triangle.size(), kNone);
  for_each_index(corners, [&](std::size_t v) { vertex_at[corner_[v]] = Index(v); });
  for_each_index(triangles, [&](std::size_t t) {
    const Index s = slot_[t];
    for (Index k = 0; k < fresh[s].count; ++k) vertex_at[fresh_[s].first + k] = fresh[s].first + k;
    for (Index k = 0; k < child[s].count; ++k) child_at[child_[s].first + k] = child[s].first + k;
  });
  GeometricMesh out;
  std::vector<Birth> birth(all);
  out.mesh.vertex.resize(3 * std::size_t(children));
  out.mesh.twin.resize(3 * std::size_t(children));
  out.parent_triangle.resize(children);
  out.normal.resize(all);
  out.parent_edge.resize(all);
  out.mesh.vertices.resize(all);
  std::vector<std::uint16_t> angle_step(angle_step_.empty() ? 0 : children);
  const auto move_vertex = [&](Index to, Index from) {
    const auto [a, b] = geometric_.parent_edge[from];
    out.mesh.vertices.position[to] = position(from);
    out.normal[to] = geometric_.normal[from];
    out.parent_edge[to] = {vertex_at[a], vertex_at[b]};
    birth[to] = birth_[from];
  };
  for_each_index(corners, [&](std::size_t v) { move_vertex(Index(v), corner_[v]); });
  for_each_index(triangles, [&](std::size_t t) {
    const Index s = slot_[t];
    for (Index k = 0; k < fresh[s].count; ++k) move_vertex(fresh[s].first + k, fresh_[s].first + k);
    for (Index k = 0; k < child[s].count; ++k) {
      const Index to = child[s].first + k, from = child_[s].first + k;
      out.parent_triangle[to] = Index(t);
      if (!angle_step.empty()) angle_step[to] = from < angle_step_.size() ? angle_step_[from] : 0;
      for (Index h = 0; h < 3; ++h) {
        const Index twin = geometric_.mesh.twin[3 * from + h];
        out.mesh.vertex[3 * to + h] = vertex_at[geometric_.mesh.vertex[3 * from + h]];
        out.mesh.twin[3 * to + h] = 3 * child_at[twin / 3] + twin % 3;
      }
    }
  });
  geometric_ = std::move(out);
  angle_step_ = std::move(angle_step);
  birth_ = std::move(birth);
  child_ = std::move(child);
  fresh_ = std::move(fresh);
  std::iota(corner_.begin(), corner_.end(), Index{0});
  free_children_ = free_vertices_ = {};
  without_normal_.clear();
  ordered_ = true;
}

void RefinedSkin::carry_attributes() const {
  const Span span("carry");
  const std::size_t corners = corner_.size();
  VertexTable& table = geometric_.mesh.vertices;
  std::copy(skin_.rest.begin(), skin_.rest.end(), table.rest.begin());
  std::copy(skin_.velocity.begin(), skin_.velocity.end(), table.velocity.begin());
  std::copy(skin_.age.begin(), skin_.age.end(), table.age.begin());
  std::copy(skin_.id.begin(), skin_.id.end(), table.id.begin());
  for (std::size_t v = corners; v < table.size(); ++v) {
    const auto [a, b] = geometric_.parent_edge[v];
    table.rest[v] = 0.5f * (table.rest[a] + table.rest[b]);
    table.velocity[v] = 0.5f * (table.velocity[a] + table.velocity[b]);
    table.age[v] = std::min(table.age[a], table.age[b]);
  }
  std::iota(table.id.begin() + std::ptrdiff_t(corners), table.id.end(), skin_next_id_);
  geometric_.mesh.next_id = skin_next_id_ + Index(table.size() - corners);
  carried_ = true;
}

void RefinedSkin::replace_normals() const {
  const std::vector<Vec3>& normal = geometric_.normal;
  without_normal_ = indices_where(normal.size(), [&](Index v) { return normal[v] == Vec3(0.0f); });
  if (!without_normal_.empty()) replace_zero_normals(geometric_);
  normals_replaced_ = true;
}

std::array<Vec3, 3> RefinedSkin::corners(Index child) const {
  const Index* v = &geometric_.mesh.vertex[3 * child];
  return {position(v[0]), position(v[1]), position(v[2])};
}

/// Counts what the slots' children add up to, or takes back what has been counted; each slot once.
void RefinedSkin::count_shapes(const std::vector<Index>& slots, int times) const {
  if (counted_.empty()) return;
  constexpr std::size_t kBlock = 128;
  angle_step_.resize(geometric_.parent_triangle.size());
  const auto count_children = [&](Index slot) {
    ShapeSums::Sum& sum = counted_[slot];
    const Rows child = child_[slot];
    for (Index c = child.first; c < child.first + child.count; ++c) {
      if (times > 0) sum.add(shape_.of(corners(c), angle_step_[c]));
      shape_.count(angle_step_[c], times);
    }
    return times > 0 ? sum : std::exchange(sum, {});
  };
  tbb::parallel_for(std::size_t(0), (slots.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    ShapeSums::Sum sum;
    for (std::size_t i = block * kBlock; i < std::min(slots.size(), (block + 1) * kBlock); ++i) {
      const bool counted = counted_[slots[i]].triangles > 0;
      if (counted != (times > 0)) sum.add(count_children(slots[i]));
    }
    shape_.count(sum, times);
  });
}

ShapeStatistics RefinedSkin::statistics() const {
  if (counted_.empty()) {
    counted_.assign(child_.size(), {});
    shape_ = ShapeSums(unit_);
    count_shapes(slot_, 1);
  } else {
    tbb::parallel_sort(uncounted_.begin(), uncounted_.end());
    uncounted_.erase(std::unique(uncounted_.begin(), uncounted_.end()), uncounted_.end());
    std::erase_if(uncounted_, [&](Index slot) { return triangle_[slot] == kNone; });
    count_shapes(uncounted_, 1);
  }
  uncounted_.clear();
  return shape_.statistics();
}

std::vector<Vec3> RefinedSkin::strays() const {
  std::vector<Vec3> points;
  for (const Stray& stray : stray_) points.push_back(stray.point);
  return points;
}

void RefinedSkin::flatten(const std::vector<Vec3>& bad, float radius) {
  mesh();
  if (lifted_.empty()) lifted_ = geometric_.mesh.vertices.position;
  isoskin::flatten(geometric_, bad, radius);
  counted_.clear();
}

}  // namespace isoskin
