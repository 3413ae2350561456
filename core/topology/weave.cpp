#include "core/topology/weave.h"

#include <algorithm>
#include <cstdint>
#include <limits>

namespace isoskin {

void weave(MeshPatch& patch, const std::vector<Index>& loop, const std::vector<DVec3>& p,
           const std::vector<Index>& ring, const std::vector<DVec3>& q, std::size_t starts) {
  const std::size_t n = loop.size(), m = ring.size();
  const auto cost = [&](std::size_t i, std::size_t j) {
    const DVec3 d = p[i % n] - q[j % m];
    return glm::dot(d, d);
  };
  constexpr double kNever = std::numeric_limits<double>::infinity();
  std::vector<std::uint8_t> best_steps;
  std::size_t best_start = 0;
  double best = kNever;
  std::vector<double> sum((n + 1) * (m + 1));
  std::vector<std::uint8_t> from_loop(sum.size());
  for (std::size_t start = 0; start < starts; ++start) {
    for (std::size_t i = 0; i <= n; ++i)
      for (std::size_t j = 0; j <= m; ++j) {
        const std::size_t at = i * (m + 1) + j;
        // No edge is made twice: what hangs on the common start is before the middle when it is seen first and after it
        // when it is seen last.
        const bool first_half_j = 2 * j < m, first_half_i = 2 * i < n;
        const bool twice = (i == 0 && !first_half_j) || (i == n && first_half_j) || (j == 0 && !first_half_i) ||
                           (j == m && first_half_i);
        if (i + j == 0) {
          sum[at] = cost(0, start);
          continue;
        }
        const double along_loop = i > 0 ? sum[at - (m + 1)] : kNever, along_ring = j > 0 ? sum[at - 1] : kNever;
        from_loop[at] = along_loop <= along_ring;
        sum[at] = twice ? kNever : std::min(along_loop, along_ring) + cost(i, start + j);
      }
    if (!(sum.back() < best)) continue;
    best = sum.back();
    best_start = start;
    best_steps.clear();
    for (std::size_t i = n, j = m; i + j > 0;) {
      best_steps.push_back(from_loop[i * (m + 1) + j]);
      --(best_steps.back() ? i : j);
    }
  }
  std::size_t i = 0, j = best_start;
  for (auto step = best_steps.rbegin(); step != best_steps.rend(); ++step) {
    if (*step) {
      patch.add_triangle(loop[i % n], loop[(i + 1) % n], ring[j % m]);
      ++i;
    } else {
      patch.add_triangle(ring[(j + 1) % m], ring[j % m], loop[i % n]);
      ++j;
    }
  }
}

}  // namespace isoskin
