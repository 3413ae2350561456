// Edge edits in parallel on independent sets: claims, winners, slots (design 4).
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <vector>

#include "core/mesh/triangle_mesh.h"
#include "core/parallel.h"

namespace isoskin {

/// What visit(i, list) adds to its list, for i = 0 .. n - 1 in order. Parallel; visited once each, `block` at a time.
template <class Visit>
std::vector<Index> collect(std::size_t n, std::size_t block, const Visit& visit) {
  std::vector<std::vector<Index>> found((n + block - 1) / block);
  tbb::parallel_for(std::size_t(0), found.size(), [&](std::size_t b) {
    for (std::size_t i = b * block; i < std::min(n, (b + 1) * block); ++i) visit(Index(i), found[b]);
  });
  std::vector<std::size_t> first(found.size() + 1, 0);
  for (std::size_t b = 0; b < found.size(); ++b) first[b + 1] = first[b] + found[b].size();
  std::vector<Index> out(first.back());
  tbb::parallel_for(std::size_t(0), found.size(), [&](std::size_t b) {
    std::copy(found[b].begin(), found[b].end(), out.begin() + std::ptrdiff_t(first[b]));
  });
  return out;
}

/// The i < n with keep(i), ascending. Parallel; keep is called once for each i.
template <class Keep>
std::vector<Index> indices_where(std::size_t n, const Keep& keep) {
  constexpr std::size_t kLeast = 128, kMost = 4096, kTasks = 64;  // a task is worth so many; short lists make few
  return collect(n, std::clamp(n / kTasks, kLeast, kMost), [&](Index i, std::vector<Index>& list) {
    if (keep(i)) list.push_back(i);
  });
}

/// Halfedges as bits: many threads add, then they come out ascending. Costs little when few are in.
class EdgeSet {
public:
  explicit EdgeSet(std::size_t halfedges) : bits_((halfedges + 63) / 64, 0) {}

  void add(Index h) {
    std::atomic_ref<std::uint64_t>(bits_[h / 64]).fetch_or(std::uint64_t(1) << h % 64, std::memory_order_relaxed);
  }

  template <class Keep>
  std::vector<Index> where(const Keep& keep) const {
    constexpr std::size_t kBlock = 64;
    const std::vector<Index> words = indices_where(bits_.size(), [&](Index w) { return bits_[w] != 0; });
    return collect(words.size(), kBlock, [&](Index i, std::vector<Index>& list) {
      for (std::uint64_t bits = bits_[words[i]]; bits != 0; bits &= bits - 1) {
        const Index h = 64 * words[i] + Index(std::countr_zero(bits));
        if (keep(h)) list.push_back(h);
      }
    });
  }

private:
  std::vector<std::uint64_t> bits_;
};

/// A key that sorts by `size` (>= 0, in coarse steps: a quarter octave of its root), then by a hash of the edge's ids,
/// so that winners lie scattered and depend on nothing but geometry and ids.
inline std::uint64_t edge_key(const TriangleMesh& mesh, Index h, float size) {
  const Index a = mesh.vertices.id[mesh.from(h)], b = mesh.vertices.id[mesh.to(h)];
  std::uint64_t x = std::uint64_t(std::min(a, b)) << 32 | std::max(a, b);  // splitmix64's mixer
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ x >> 27) * 0x94d049bb133111ebull;
  x ^= x >> 31;
  return std::uint64_t(std::bit_cast<std::uint32_t>(size) >> 22) << 48 | x >> 16;
}

/// The edges an edit wants (see edit_independently), each as the smaller of its halfedges, ascending.
template <class Edit>
std::vector<Index> wanted_edges(const TriangleMesh& mesh, const Edit& edit) {
  return indices_where(mesh.vertex.size(),
                       [&](Index h) { return mesh.vertex[h] != kNone && h < mesh.twin[h] && edit.wants(h); });
}

/// Those of them of which the smaller halfedge is in one of these triangles, which ascend.
template <class Edit>
std::vector<Index> wanted_edges(const TriangleMesh& mesh, const Edit& edit, const std::vector<Index>& triangles) {
  constexpr std::size_t kBlock = 1024;
  return collect(triangles.size(), kBlock, [&](Index i, std::vector<Index>& list) {
    for (Index h = 3 * triangles[i]; h < 3 * triangles[i] + 3; ++h)
      if (mesh.vertex[h] != kNone && h < mesh.twin[h] && edit.wants(h)) list.push_back(h);
  });
}

/// Rounds of edits, starting with the candidates of wanted_edges. In each, every candidate claims some cells (vertices
/// or triangles); it wins when no better claim lies on any cell it watches, so winners can be planned and then applied
/// all at once. Losers, and edges near an applied edit, are candidates of the next round. Returns the number of edits
/// applied.
///
/// Edit offers: wants(h); key(h), smaller is better; cell_count(); for_each_claim(h, f); for_each_watched(h, f), a
/// superset of the claims such that edits conflict exactly when one watches what the other claims; plan(h), the edit's
/// parameter, negative when refused; make_room(count); apply(h, plan, i), i < count, in order of halfedges, which
/// returns an anchor; for_each_changed(anchor, f), halfedges to look at again.
template <class Edit>
std::size_t edit_independently(TriangleMesh& mesh, Edit& edit, std::vector<Index> candidates, int max_rounds) {
  std::vector<Index> best;  // of every cell: the position among the candidates of its best claim
  std::vector<std::uint64_t> key;
  std::size_t total = 0;
  const auto few = [&] { return candidates.size() < mesh.vertex.size() / 1000; };  // not worth a pass over the mesh
  for (int round = 0; round < max_rounds && !candidates.empty() && !(round >= 4 && few()); ++round) {
    key.resize(candidates.size());
    for_each_index(candidates.size(), [&](std::size_t i) { key[i] = edit.key(candidates[i]); });
    const auto better = [&](Index i, Index j) { return key[i] != key[j] ? key[i] < key[j] : i < j; };

    best.resize(edit.cell_count(), kNone);
    for_each_index(candidates.size(), [&](std::size_t i) {
      edit.for_each_claim(candidates[i], [&](Index cell) {
        std::atomic_ref<Index> holder(best[cell]);
        Index seen = holder.load(std::memory_order_relaxed);
        while ((seen == kNone || better(Index(i), seen)) &&
               !holder.compare_exchange_weak(seen, Index(i), std::memory_order_relaxed)) {
        }
      });
    });
    std::vector<std::uint8_t> won(candidates.size(), 1);
    for_each_index(candidates.size(), [&](std::size_t i) {
      const auto contest = [&](Index cell) {
        if (best[cell] != kNone && best[cell] != i && better(best[cell], Index(i))) won[i] = 0;
      };
      edit.for_each_claim(candidates[i], contest);  // most lose here already, and need not look further
      if (won[i]) edit.for_each_watched(candidates[i], contest);
    });
    for_each_index(candidates.size(), [&](std::size_t i) {
      edit.for_each_claim(candidates[i], [&](Index cell) {
        std::atomic_ref<Index>(best[cell]).store(kNone, std::memory_order_relaxed);
      });
    });

    std::vector<float> plan(candidates.size(), -1.0f);
    for_each_index(candidates.size(), [&](std::size_t i) {
      if (won[i]) plan[i] = edit.plan(candidates[i]);
    });
    const std::vector<Index> applied = indices_where(candidates.size(), [&](Index i) { return plan[i] >= 0.0f; });
    edit.make_room(applied.size());
    std::vector<Index> anchor(applied.size());
    for_each_index(applied.size(),
                   [&](std::size_t i) { anchor[i] = edit.apply(candidates[applied[i]], plan[applied[i]], Index(i)); });
    total += applied.size();

    EdgeSet next(mesh.vertex.size());
    const auto list = [&](Index h) {
      if (mesh.vertex[h] != kNone) next.add(std::min(h, mesh.twin[h]));
    };
    for_each_index(candidates.size(), [&](std::size_t i) {
      if (!won[i]) list(candidates[i]);
    });
    for_each_index(applied.size(), [&](std::size_t i) { edit.for_each_changed(anchor[i], list); });
    candidates = next.where([&](Index h) { return edit.wants(h); });
  }
  return total;
}

}  // namespace isoskin
