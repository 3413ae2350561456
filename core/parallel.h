// Host loops whose results do not depend on the number of threads (design 11).
#pragma once

#include <cstddef>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace isoskin {

/// body(i) for every i in [0, count), in parallel; each call must write only what belongs to its i.
template <class Body>
void for_each_index(std::size_t count, const Body& body) {
  constexpr std::size_t kGrain = 256;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kGrain), [&](const tbb::blocked_range<std::size_t>& r) {
    for (std::size_t i = r.begin(); i != r.end(); ++i) body(i);
  });
}

}  // namespace isoskin
