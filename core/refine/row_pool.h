// Rows of growing columns, handed out and given back in stretches.
#pragma once

#include <map>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// A stretch of rows.
struct Rows {
  Index first = 0, count = 0;
};

/// Rows that have been given back, by the length of their stretches. Deterministic.
class RowPool {
public:
  void give_back(const Rows& rows) {
    if (rows.count > 0) free_[rows.count].push_back(rows.first);
  }

  /// Of the shortest stretch that is long enough; from `end` on, which moves, where there is none.
  Rows take(Index count, Index& end) {
    if (count == 0) return {};
    const auto at = free_.lower_bound(count);
    if (at == free_.end()) {
      end += count;
      return {end - count, count};
    }
    const Rows rows{at->second.back(), count}, rest{rows.first + count, at->first - count};
    at->second.pop_back();
    if (at->second.empty()) free_.erase(at);
    give_back(rest);
    return rows;
  }

private:
  std::map<Index, std::vector<Index>> free_;
};

}  // namespace isoskin
