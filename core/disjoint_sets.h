// Union-find that threads may fill at once.
#pragma once

#include <atomic>
#include <numeric>
#include <utility>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// Sets of 0 .. n - 1. Roots are the smallest members, so they do not depend on the order of unions. Thread safe.
class DisjointSets {
public:
  explicit DisjointSets(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), Index(0)); }

  Index root(Index v) {
    for (;;) {
      const Index up = at(v).load(std::memory_order_relaxed);
      if (up == v) return v;
      const Index above = at(up).load(std::memory_order_relaxed);
      if (above != up) at(v).store(above, std::memory_order_relaxed);
      v = up;
    }
  }

  void unite(Index a, Index b) {
    for (;;) {
      a = root(a), b = root(b);
      if (a == b) return;
      if (a < b) std::swap(a, b);
      Index expected = a;
      if (at(a).compare_exchange_strong(expected, b, std::memory_order_relaxed)) return;
    }
  }

private:
  std::atomic_ref<Index> at(Index v) { return std::atomic_ref<Index>(parent_[v]); }
  std::vector<Index> parent_;
};

}  // namespace isoskin
