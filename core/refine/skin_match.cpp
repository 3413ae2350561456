#include "core/refine/skin_match.h"

#include <algorithm>
#include <array>
#include <atomic>

#include <tbb/parallel_for.h>

#include "core/parallel.h"

namespace isoskin {
namespace {

constexpr std::size_t kBlock = 4096;
constexpr std::size_t kAhead = 64;  // triangles looked through for one that lies farther on than it did

bool same_columns(const std::vector<Index>& a, const std::vector<Index>& b) {
  if (a.size() != b.size()) return false;
  std::atomic<bool> same = true;
  tbb::parallel_for(std::size_t{0}, (a.size() + kBlock - 1) / kBlock, [&](std::size_t k) {
    const std::size_t first = k * kBlock, count = std::min(kBlock, a.size() - first);
    if (same.load(std::memory_order_relaxed) && !std::equal(&a[first], &a[first] + count, &b[first]))
      same.store(false, std::memory_order_relaxed);
  });
  return same;
}

/// From each one's counterpart to whose counterpart each is.
std::vector<Index> turned_round(const std::vector<Index>& counterpart, std::size_t count) {
  std::vector<Index> of(count, kNone);
  for_each_index(counterpart.size(), [&](std::size_t i) {
    if (counterpart[i] != kNone) of[counterpart[i]] = Index(i);
  });
  return of;
}

}  // namespace

SkinMatch::SkinMatch(const std::vector<Index>& old_id, const std::vector<Index>& old_corners, const TriangleMesh& skin)
    : old_id_(old_id), old_corners_(old_corners), skin_(skin) {
  identity_ = same_columns(old_id, skin.vertices.id) && same_columns(old_corners, skin.vertex);
  if (identity_) return;
  match_vertices();
  new_vertex_ = turned_round(old_vertex_, old_vertices());
  match_triangles();
  new_triangle_ = turned_round(old_triangle_, old_triangles());
}

/// Ids are one vertex's only, so that no two blocks find the same.
void SkinMatch::match_vertices() {
  const std::vector<Index>& id = skin_.vertices.id;
  old_vertex_.assign(vertices(), kNone);
  tbb::parallel_for(std::size_t{0}, (vertices() + kBlock - 1) / kBlock, [&](std::size_t b) {
    const std::size_t end = std::min(vertices(), (b + 1) * kBlock);
    std::size_t at = std::size_t(std::lower_bound(old_id_.begin(), old_id_.end(), id[b * kBlock]) - old_id_.begin());
    for (std::size_t v = b * kBlock; v < end; ++v) {
      while (at < old_id_.size() && old_id_[at] < id[v]) ++at;
      if (at < old_id_.size() && old_id_[at] == id[v]) old_vertex_[v] = Index(at++);
    }
  });
}

/// Those with the same corners by id, first corner first.
void SkinMatch::match_triangles() {
  const std::size_t count = triangles(), blocks = (count + kBlock - 1) / kBlock;
  old_triangle_.assign(count, kNone);
  std::vector<std::size_t> start(blocks, 0);
  for (std::size_t b = 1; b < blocks; ++b) start[b] = where_block_begins(b * kBlock, start[b - 1]);
  tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
    std::size_t at = start[b];
    for (std::size_t t = b * kBlock; t < std::min(count, (b + 1) * kBlock); ++t) {
      const std::array<Index, 3> wanted = old_corners(t);
      if (wanted[0] == kNone || wanted[1] == kNone || wanted[2] == kNone) continue;
      if (!is(at, wanted)) {
        while (at < old_triangles() && gone(at)) ++at;
        std::size_t found = at;
        while (found < at + kAhead && !is(found, wanted)) ++found;
        if (found == at + kAhead) continue;
        at = found;
      }
      old_triangle_[t] = Index(at++);
    }
  });
}

std::array<Index, 3> SkinMatch::old_corners(std::size_t t) const {
  const Index* v = &skin_.vertex[3 * t];
  return {old_vertex_[v[0]], old_vertex_[v[1]], old_vertex_[v[2]]};
}

/// Does the old triangle, if there is one, have these corners?
bool SkinMatch::is(std::size_t old, const std::array<Index, 3>& corners) const {
  if (3 * old >= old_corners_.size()) return false;
  const Index* v = &old_corners_[3 * old];
  return v[0] == corners[0] && v[1] == corners[1] && v[2] == corners[2];
}

bool SkinMatch::gone(std::size_t old) const {
  const Index* v = &old_corners_[3 * old];
  return new_vertex_[v[0]] == kNone || new_vertex_[v[1]] == kNone || new_vertex_[v[2]] == kNone;
}

/// About where triangle t is among the old ones, when `last` is where the block before begins there: some have come
/// in between, or gone.
std::size_t SkinMatch::where_block_begins(std::size_t t, std::size_t last) const {
  constexpr std::size_t kTriangles = 8, kFarthest = 2 * kBlock;
  const std::size_t likely = std::min(old_triangles(), last + kBlock);
  for (std::size_t k = t; k < std::min(t + kTriangles, triangles()); ++k) {
    const std::array<Index, 3> wanted = old_corners(k);
    if (wanted[0] == kNone || wanted[1] == kNone || wanted[2] == kNone) continue;
    for (std::size_t off = 0; off < kFarthest; ++off) {
      if (off <= likely && is(likely - off, wanted)) return likely - off;
      if (is(likely + off, wanted)) return likely + off;
    }
  }
  return likely;
}

}  // namespace isoskin
