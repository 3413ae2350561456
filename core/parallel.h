// Host loops whose results do not depend on the number of threads (design 11).
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace isoskin {

/// body(i) for every i in [0, count), in parallel; each call must write only what belongs to its i.
template <class Body>
void for_each_index(std::size_t count, const Body& body, std::size_t grain = 256) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, grain), [&](const tbb::blocked_range<std::size_t>& r) {
    for (std::size_t i = r.begin(); i != r.end(); ++i) body(i);
  });
}

/// The same where most calls take a microsecond or more, as what is done to a lattice brick does: a few are shared out.
template <class Body>
void for_each_heavy(std::size_t count, const Body& body) {
  constexpr std::size_t kGrain = 8;
  for_each_index(count, body, kGrain);
}

/// to = from in parallel, to where there is memory already: as fast as memory is.
template <class T>
void copy_column(const std::vector<T>& from, std::vector<T>& to) {
  constexpr std::size_t kRun = 16384;
  to.resize(from.size());
  tbb::parallel_for(std::size_t{0}, (from.size() + kRun - 1) / kRun, [&](std::size_t b) {
    const std::size_t first = b * kRun, count = std::min(kRun, from.size() - first);
    std::copy_n(from.begin() + std::ptrdiff_t(first), count, to.begin() + std::ptrdiff_t(first));
  });
}

}  // namespace isoskin
