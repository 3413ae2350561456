// Places of some numbers among each other.
#pragma once

#include <atomic>
#include <bit>
#include <cstdint>
#include <vector>

#include "core/parallel.h"
#include "core/types.h"

namespace isoskin {

/// Some numbers below n, which may be given repeatedly and in any order. Costs little when they are few.
class Ranks {
public:
  Ranks(std::size_t n, const std::vector<Index>& numbers) : bits_(n / 64 + 1), before_(n / 64 + 1) {
    for_each_index(numbers.size(), [&](std::size_t k) {
      const std::uint64_t bit = std::uint64_t(1) << numbers[k] % 64;
      const std::atomic_ref<std::uint64_t> word(bits_[numbers[k] / 64]);
      if ((word.load(std::memory_order_relaxed) & bit) == 0) word.fetch_or(bit, std::memory_order_relaxed);
    });
    for (std::size_t w = 1; w < bits_.size(); ++w) before_[w] = before_[w - 1] + Index(std::popcount(bits_[w - 1]));
  }

  /// How many of the numbers are below i.
  Index below(Index i) const {
    const std::uint64_t lower = (std::uint64_t(1) << i % 64) - 1;
    return before_[i / 64] + Index(std::popcount(bits_[i / 64] & lower));
  }
  bool contains(Index i) const { return (bits_[i / 64] >> i % 64 & 1) != 0; }
  /// All of them, ascending, each once.
  std::vector<Index> numbers() const {
    std::vector<Index> all;
    all.reserve(before_.back() + std::size_t(std::popcount(bits_.back())));
    for (std::size_t w = 0; w < bits_.size(); ++w)
      for (std::uint64_t bits = bits_[w]; bits != 0; bits &= bits - 1)
        all.push_back(Index(64 * w) + Index(std::countr_zero(bits)));
    return all;
  }

private:
  std::vector<std::uint64_t> bits_;
  std::vector<Index> before_;
};

}  // namespace isoskin
