#include "core/refine/split_pattern.h"

#include <bit>
#include <initializer_list>

namespace isoskin {
namespace {

int turned(int local, int by) {
  return local < 3 ? (local + by) % 3 : 3 + (local + by) % 3;
}

/// `corners` is written for marked edges 0 (one), 0 and 1 (two), or all, and turned to where they are.
SplitPattern linked(std::initializer_list<int> corners, unsigned marked, int turn) {
  SplitPattern p;
  p.count = int(corners.size() / 3);
  int size = 0;
  for (const int c : corners) p.corner[size++] = std::int8_t(turned(c, turn));
  const auto from = [&](int h) { return p.corner[h]; };
  const auto to = [&](int h) { return p.corner[h % 3 == 2 ? h - 2 : h + 1]; };
  const auto find = [&](int a, int b) {
    for (int h = 0; h < size; ++h)
      if (from(h) == a && to(h) == b) return std::int8_t(h);
    return std::int8_t{-1};
  };
  for (int h = 0; h < size; ++h) p.twin[h] = find(to(h), from(h));
  for (int k = 0; k < 3; ++k) {
    const int end = (k + 1) % 3;
    const bool split = marked >> k & 1;
    p.part[2 * k] = split ? find(k, 3 + k) : find(k, end);
    p.part[2 * k + 1] = split ? find(3 + k, end) : find(k, end);
  }
  return p;
}

SplitPattern build(unsigned marked, bool second_diagonal) {
  const int turn = marked == 0 || marked == 7   ? 0
                   : std::popcount(marked) == 1 ? std::countr_zero(marked)
                                                : first_marked_edge(marked);
  switch (std::popcount(marked)) {
    case 0:
      return linked({0, 1, 2}, marked, turn);
    case 1:
      return linked({0, 3, 2, 3, 1, 2}, marked, turn);
    case 2:
      if (second_diagonal) return linked({3, 1, 4, 3, 4, 2, 0, 3, 2}, marked, turn);
      return linked({3, 1, 4, 0, 3, 4, 0, 4, 2}, marked, turn);
    default:
      return linked({0, 3, 5, 1, 4, 3, 2, 5, 4, 3, 4, 5}, marked, turn);
  }
}

}  // namespace

int first_marked_edge(unsigned marked) {
  return marked == 6 ? 1 : marked == 5 ? 2 : 0;
}

const SplitPattern& split_pattern(unsigned marked, bool second_diagonal) {
  static const std::array<SplitPattern, 16> patterns = [] {
    std::array<SplitPattern, 16> all;
    for (unsigned i = 0; i < 16; ++i) all[i] = build(i & 7, i & 8);
    return all;
  }();
  return patterns[marked | (second_diagonal ? 8u : 0u)];
}

}  // namespace isoskin
