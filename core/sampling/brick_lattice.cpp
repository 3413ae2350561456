#include "core/sampling/brick_lattice.h"

#include <algorithm>
#include <atomic>
#include <bit>

#include "core/parallel.h"

namespace isoskin {
namespace {

constexpr int kBits = 20;  // of each coordinate in a key

std::uint64_t hash(const IVec3& c) {
  std::uint64_t k = static_cast<std::uint32_t>(c.x);
  k = k * 0x9E3779B97F4A7C15ull + static_cast<std::uint32_t>(c.y);
  k = k * 0x9E3779B97F4A7C15ull + static_cast<std::uint32_t>(c.z);
  k *= 0x9E3779B97F4A7C15ull;
  return k ^ (k >> 29);
}

}  // namespace

void BrickLattice::build_index() {
  const std::size_t slots = std::bit_ceil(std::max<std::size_t>(16, 2 * coordinate.size()));
  slot_.assign(slots, kNone);
  for (std::size_t b = 0; b < coordinate.size(); ++b) {
    std::size_t s = hash(coordinate[b]) & (slots - 1);
    while (slot_[s] != kNone) s = (s + 1) & (slots - 1);
    slot_[s] = static_cast<Index>(b);
  }
}

Index BrickLattice::find(const IVec3& brick) const {
  if (slot_.empty()) return kNone;
  std::size_t s = hash(brick) & (slot_.size() - 1);
  while (slot_[s] != kNone && coordinate[slot_[s]] != brick) s = (s + 1) & (slot_.size() - 1);
  return slot_[s];
}

std::uint64_t BrickLattice::face_key(const IVec3& corner, int axis) {
  constexpr int kOffset = kFarthestCorner;
  static_assert(2 * kOffset <= 1 << kBits);
  std::uint64_t key = 0;
  for (int a = 0; a < 3; ++a) key = key << kBits | static_cast<std::uint64_t>(corner[a] + kOffset);
  return key << 2 | static_cast<std::uint64_t>(axis);
}

IVec3 BrickLattice::corner_of(std::uint64_t key) {
  constexpr std::uint64_t kMask = (1u << kBits) - 1;
  key >>= 2;
  return IVec3(int(key >> 2 * kBits & kMask), int(key >> kBits & kMask), int(key & kMask)) - kFarthestCorner;
}

const BrickLattice::Face* BrickLattice::find_face(const IVec3& corner, int axis) const {
  const std::uint64_t key = face_key(corner, axis);
  const auto at =
      std::lower_bound(face.begin(), face.end(), key, [](const Face& f, std::uint64_t k) { return f.key < k; });
  return at != face.end() && at->key == key ? &*at : nullptr;
}

std::vector<std::uint8_t> with_neighbours(const BrickLattice& lattice, const std::vector<std::uint8_t>& bricks) {
  std::vector<std::uint8_t> all = bricks;
  for_each_heavy(bricks.size(), [&](std::size_t b) {
    if (!bricks[b]) return;
    for (int i = 0; i < 27; ++i) {
      const Index other = lattice.find(lattice.coordinate[b] + IVec3(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1));
      if (other != kNone) std::atomic_ref(all[other]).store(1, std::memory_order_relaxed);
    }
  });
  return all;
}

bool BrickLattice::has_tunnel(const IVec3& cell) const {
  return !tunnel.empty() && std::binary_search(tunnel.begin(), tunnel.end(), face_key(cell, 3));
}

}  // namespace isoskin
