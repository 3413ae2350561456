// Random numbers without a state: the i-th of a seed is a function of both, so no order of drawing matters (design 11).
#pragma once

#include <cstdint>

#include "core/types.h"

namespace isoskin {

/// splitmix64 of Steele, Lea and Flood 2014: entry `index` of the sequence of `seed`.
inline std::uint64_t counter_random(std::uint64_t seed, std::uint64_t index) {
  std::uint64_t x = seed + (index + 1) * 0x9e3779b97f4a7c15ull;
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ x >> 27) * 0x94d049bb133111ebull;
  return x ^ x >> 31;
}

/// Uniform in [0, 1), 53 bits.
inline double counter_uniform(std::uint64_t seed, std::uint64_t index) {
  return double(counter_random(seed, index) >> 11) * 0x1p-53;
}

/// Uniform in the unit cube; uses entries 3 index .. 3 index + 2.
inline DVec3 counter_point(std::uint64_t seed, std::uint64_t index) {
  return {counter_uniform(seed, 3 * index), counter_uniform(seed, 3 * index + 1), counter_uniform(seed, 3 * index + 2)};
}

}  // namespace isoskin
