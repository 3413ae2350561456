// Points in cells as wide as a search radius.
#pragma once

#include <algorithm>
#include <atomic>
#include <bit>
#include <deque>
#include <utility>
#include <vector>

#include <tbb/parallel_sort.h>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/types.h"

namespace isoskin {

/// Finds the points within the radius of a place. Building and the order of visits do not depend on threads; queries
/// may run in parallel. `points` must outlive it.
class PointGrid {
public:
  PointGrid(const std::vector<Vec3>& points, float radius) : points_(points), radius_(radius), entry_(points.size()) {
    for_each_index(entry_.size(), [&](std::size_t i) { entry_[i] = {key(cell(points[i])), Index(i)}; });
    tbb::parallel_sort(entry_);
    const std::vector<Index> first = indices_where(
        entry_.size(), [&](Index i) { return i == 0 || column_of(entry_[i].first) != column_of(entry_[i - 1].first); });
    for (const Index i : first) column_.push_back({column_of(entry_[i].first), i});
    column_.push_back({kEnd, Index(entry_.size())});
    near_.assign(std::bit_ceil(std::max<std::size_t>(1, points.size())), 0);
    for_each_index(points.size(), [&](std::size_t i) { mark_about(points[i]); });
  }

  /// Calls function(index, squared distance) for every point no farther than the radius.
  template <class Function>
  void near(const Vec3& p, const Function& function) const {
    visit(p, [&](Index i, float square) {
      function(i, square);
      return false;
    });
  }

  bool any_near(const Vec3& p) const {
    return visit(p, [](Index, float) { return true; });
  }

private:
  /// Visits until `visitor` returns true; whether it did. Cells of one column along z lie side by side.
  template <class Visitor>
  bool visit(const Vec3& p, const Visitor& visitor) const {
    if (!may_be_near(p)) return false;
    const IVec3 c = cell(p);
    for (int x = c.x - 1; x <= c.x + 1; ++x) {
      const std::uint64_t first = column_of(key({x, c.y - 1, 0})), last = first + 2;
      auto column = std::lower_bound(column_.begin(), column_.end(), std::pair{first, Index(0)});
      for (; column->first <= last; ++column) {
        const auto begin = entry_.begin() + column->second, end = entry_.begin() + column[1].second;
        const std::uint64_t low = begin->first - (begin->first & kZ) + (key({0, 0, c.z - 1}) & kZ), high = low + 2;
        for (auto it = std::lower_bound(begin, end, std::pair{low, Index(0)}); it != end && it->first <= high; ++it) {
          const Vec3 d = points_[it->second] - p;
          if (const float square = glm::dot(d, d); square <= radius_ * radius_ && visitor(it->second, square))
            return true;
        }
      }
    }
    return false;
  }

  // Most places asked about are far from every point. A set of bits, by a hash of cells twice as wide that points may
  // reach into, tells so for one look.
  void mark_about(const Vec3& p) {
    constexpr double kSlack = 1.001;  // wider than rounding
    const IVec3 low = wide_cell(DVec3(p) - kSlack * radius_), high = wide_cell(DVec3(p) + kSlack * radius_);
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y)
        for (int z = low.z; z <= high.z; ++z) {
          const std::uint64_t hashed = hash({x, y, z}), bit = std::uint64_t(1) << (hashed & 63);
          const std::atomic_ref word(near_[hashed >> 6 & (near_.size() - 1)]);
          if (!(word.load(std::memory_order_relaxed) & bit)) word.fetch_or(bit, std::memory_order_relaxed);
        }
  }
  bool may_be_near(const Vec3& p) const {
    const std::uint64_t bit = hash(wide_cell(DVec3(p)));
    return near_[bit >> 6 & (near_.size() - 1)] >> (bit & 63) & 1;
  }
  IVec3 wide_cell(const DVec3& p) const { return IVec3(glm::floor(p * (0.5 / double(radius_)))); }
  static std::uint64_t hash(const IVec3& c) {
    const std::uint64_t k = key(c) * 0x9E3779B97F4A7C15ull;
    return k ^ k >> 29;
  }

  IVec3 cell(const Vec3& p) const { return IVec3(glm::floor(p / radius_)); }
  /// Sorts by x, y, z; 2^20 cells each way.
  static std::uint64_t key(const IVec3& c) {
    constexpr int kOffset = 1 << 20;
    return (std::uint64_t(c.x + kOffset) << 42) | (std::uint64_t(c.y + kOffset) << 21) | std::uint64_t(c.z + kOffset);
  }

  static constexpr std::uint64_t kZ = (1u << 21) - 1;  // of a key
  static constexpr auto kEnd = ~std::uint64_t(0);
  static std::uint64_t column_of(std::uint64_t key) { return key >> 21; }

  const std::vector<Vec3>& points_;
  float radius_;
  std::vector<std::pair<std::uint64_t, Index>> entry_;
  std::vector<std::pair<std::uint64_t, Index>> column_;  // along z, each with its first entry; then the end
  std::vector<std::uint64_t> near_;                      // a power of two of words
};

/// The same of points that are added in lots, which are numbered one after the other. The order of visits is that of
/// the lots.
class GrowingPointGrid {
public:
  explicit GrowingPointGrid(float radius) : radius_(radius) {}

  void add(std::vector<Vec3> points) {
    const Index first = lots_.empty() ? 0 : lots_.back().first + Index(lots_.back().points.size());
    lots_.emplace_back(first, std::move(points), radius_);
  }

  /// As PointGrid::near().
  template <class Function>
  void near(const Vec3& p, const Function& function) const {
    for (const Lot& lot : lots_) lot.grid.near(p, [&](Index i, float square) { function(lot.first + i, square); });
  }

private:
  struct Lot {
    Lot(Index number, std::vector<Vec3> place, float radius)
        : first(number), points(std::move(place)), grid(points, radius) {}
    Lot(const Lot&) = delete;
    Lot& operator=(const Lot&) = delete;

    Index first;
    std::vector<Vec3> points;
    PointGrid grid;
  };

  float radius_;
  std::deque<Lot> lots_;
};

}  // namespace isoskin
