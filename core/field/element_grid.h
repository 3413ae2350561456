// Which of many boxes may hold a point: a skeleton's cost then does not grow with the elements far away (design 9).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// A uniform grid of lists of boxes. Each query visits, in ascending order, at least the boxes it asks for, so sums
/// over those that matter come out as if all were asked.
class ElementGrid {
public:
  ElementGrid() = default;
  /// Boxes without bound are in every list, so with one of them all lists are all boxes.
  explicit ElementGrid(const std::vector<Box>& boxes) : count_(Index(boxes.size())) {
    constexpr std::size_t kFewest = 16;   // for fewer a list costs more than it saves
    constexpr double kMostAcross = 64.0;  // cells
    if (boxes.size() < kFewest) return;
    DVec3 size(0.0);
    for (const Box& box : boxes) {
      if (!(glm::length(box.size()) < kUnbounded)) return;
      bounds_.add(box);
      size += box.size();
    }
    side_ = glm::max(size / double(boxes.size()), bounds_.size() / kMostAcross);
    if (!(side_.x > 0.0 && side_.y > 0.0 && side_.z > 0.0)) return;
    count_in_ = cell(bounds_.high) + 1;
    first_.assign(std::size_t(count_in_.x) * count_in_.y * count_in_.z + 1, 0);
    for (const Box& box : boxes) for_each_cell(cell(box.low), cell(box.high), [&](std::size_t c) { ++first_[c + 1]; });
    for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
    list_.resize(first_.back());
    std::vector<Index> slot(first_.begin(), first_.end() - 1);
    for (Index i = 0; i < boxes.size(); ++i)
      for_each_cell(cell(boxes[i].low), cell(boxes[i].high), [&](std::size_t c) { list_[slot[c]++] = i; });
  }

  /// The boxes that may hold p.
  template <class Visit>
  void for_each_at(const DVec3& p, const Visit& visit) const {
    if (first_.empty()) return for_all(visit);
    if (!(glm::all(glm::lessThanEqual(bounds_.low, p)) && glm::all(glm::lessThanEqual(p, bounds_.high)))) return;
    for_each_cell(cell(p), cell(p), [&](std::size_t c) {
      for (Index k = first_[c]; k < first_[c + 1]; ++k) visit(list_[k]);
    });
  }

  /// The boxes that may reach into `box`.
  template <class Visit>
  void for_each_in(const Box& box, const Visit& visit) const {
    constexpr std::size_t kMostCells = 27;
    if (first_.empty()) return for_all(visit);
    const DVec3 low = glm::max(box.low, bounds_.low), high = glm::min(box.high, bounds_.high);
    if (!glm::all(glm::lessThanEqual(low, high))) return;
    const IVec3 from = cell(low), to = cell(high), n = to - from + 1;
    if (std::size_t(n.x) * n.y * n.z > kMostCells) return for_all(visit);
    if (count_ <= kFewBoxes) return for_each_of_few(from, to, visit);
    std::vector<Index> some;
    for_each_cell(from, to, [&](std::size_t c) {
      some.insert(some.end(), list_.begin() + first_[c], list_.begin() + first_[c + 1]);
    });
    std::sort(some.begin(), some.end());
    some.erase(std::unique(some.begin(), some.end()), some.end());
    for (const Index i : some) visit(i);
  }

private:
  static constexpr double kUnbounded = 1e50;
  static constexpr Index kFewBoxes = 1 << 12;

  IVec3 cell(const DVec3& p) const { return IVec3(glm::floor((p - bounds_.low) / side_)); }
  template <class Visit>
  void for_each_cell(const IVec3& from, const IVec3& to, const Visit& visit) const {
    for (int x = from.x; x <= to.x; ++x)
      for (int y = from.y; y <= to.y; ++y)
        for (int z = from.z; z <= to.z; ++z) visit((std::size_t(x) * count_in_.y + y) * count_in_.z + z);
  }
  /// Those in some cells.
  template <class Visit>
  void for_each_of_few(const IVec3& from, const IVec3& to, const Visit& visit) const {
    std::array<std::uint64_t, kFewBoxes / 64> seen;  // a bit a box: quicker than sorting
    const std::size_t words = count_ / 64 + 1;
    std::fill_n(seen.begin(), std::min(words, seen.size()), 0);
    for_each_cell(from, to, [&](std::size_t c) {
      for (Index k = first_[c]; k < first_[c + 1]; ++k) seen[list_[k] / 64] |= std::uint64_t(1) << list_[k] % 64;
    });
    for (std::size_t w = 0; w < std::min(words, seen.size()); ++w)
      for (std::uint64_t bits = seen[w]; bits != 0; bits &= bits - 1)
        visit(Index(64 * w) + Index(std::countr_zero(bits)));
  }
  template <class Visit>
  void for_all(const Visit& visit) const {
    for (Index i = 0; i < count_; ++i) visit(i);
  }

  Index count_ = 0;
  Box bounds_;
  DVec3 side_{0.0};
  IVec3 count_in_{0};         // cells on each axis
  std::vector<Index> first_;  // per cell, CSR; empty: every list is all boxes
  std::vector<Index> list_;
};

}  // namespace isoskin
