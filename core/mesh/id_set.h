// Which ids there are.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// One bit an id.
class IdSet {
public:
  IdSet() = default;
  explicit IdSet(std::span<const Index> ids) {
    for (const Index id : ids) {
      if (id / 64 >= bits_.size()) bits_.resize(id / 64 + 1 + bits_.size() / 2);
      bits_[id / 64] |= std::uint64_t(1) << id % 64;
    }
  }

  bool contains(Index id) const { return id / 64 < bits_.size() && (bits_[id / 64] >> id % 64 & 1) != 0; }
  /// How many are in both.
  std::size_t count_shared(const IdSet& other) const {
    std::size_t count = 0;
    for (std::size_t w = 0; w < std::min(bits_.size(), other.bits_.size()); ++w)
      count += std::size_t(std::popcount(bits_[w] & other.bits_[w]));
    return count;
  }

private:
  std::vector<std::uint64_t> bits_;
};

}  // namespace isoskin
