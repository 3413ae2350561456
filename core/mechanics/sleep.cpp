#include "core/mechanics/sleep.h"

#include <algorithm>
#include <atomic>

#include "core/parallel.h"

namespace isoskin {

void wake(VertexTable& vertices, const ChangeMask& changed) {
  if (changed.empty()) return;
  for_each_index(vertices.size(), [&](std::size_t v) {
    if (vertices.age[v] > 1 && changed.contains(DVec3(vertices.position[v]))) vertices.age[v] = 1;
  });
}

std::vector<std::uint8_t> sleeping(const VertexTable& vertices, const SleepOptions& options) {
  std::vector<std::uint8_t> asleep(vertices.size());
  std::atomic<bool> any{false};
  for_each_index(asleep.size(), [&](std::size_t v) {
    asleep[v] = vertices.age[v] > options.rest_frames;
    if (asleep[v] && !any.load(std::memory_order_relaxed)) any.store(true, std::memory_order_relaxed);
  });
  if (!any) asleep.clear();
  return asleep;
}

}  // namespace isoskin
