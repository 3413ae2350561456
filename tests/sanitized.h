// How often a test repeats itself: sanitizers slow everything down several times, and see in the first turns what there
// is to see. Nothing that is asserted may depend on it.
#pragma once

namespace isoskin::test {

constexpr int repeats([[maybe_unused]] int whole, [[maybe_unused]] int sanitized) {
#ifdef ISOSKIN_SANITIZED
  return sanitized;
#else
  return whole;
#endif
}

}  // namespace isoskin::test
